"""Results on disk: folders, one per command, complete or not at all; files that are written whole; bags of runs."""

import contextlib
import errno
import itertools
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from filelock import FileLock, Timeout

from experiments.common.plain_json import write_json
from experiments.common.pool import interrupts_later
from trackslip.errors import LogError, OutputError, first_line
from trackslip.logs.file_format import MANIFEST, known_manifest

if TYPE_CHECKING:
    from trackslip.identification.samples import SlipSamples
    from trackslip.logs.runlog import RunLog

SUMMARY_FILE = "summary.json"
RUNS_FILE = "runs.parquet"
MANIFEST_FILE = MANIFEST
REPORT_FILE = "report.html"
LEADERBOARD_FILE = "leaderboard.md"
TABLE_FILE = "table.parquet"
FIGURES_FOLDER = "figures"
RECORDINGS_FOLDER = "recordings"
BAGS_FOLDER = "bags"
PICTURES_FOLDER = "pictures"
DRIVE_RECORDING = "drive.rrd"
TRAJECTORIES_FOLDER = "trajectories"
FOLDERS = {
    FIGURES_FOLDER: (".svg", ".pdf"),
    RECORDINGS_FOLDER: (".rrd",),
    BAGS_FOLDER: (".mcap", ".yaml"),
    PICTURES_FOLDER: (".png",),
    TRAJECTORIES_FOLDER: (".tum",),
}
"""Folders among the results, and the suffixes of the files in them; everything else is a file."""

_FILES = (SUMMARY_FILE, RUNS_FILE, REPORT_FILE, LEADERBOARD_FILE, TABLE_FILE)
_PARTIAL, _OLD, _LOCK = ".partial-", ".old", ".lock"
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)  # of the file system
_MAX_NAME = 120  # characters


@contextlib.contextmanager
def results_folder(out: Path, then: Callable[[], None] = lambda: None, command: str | None = None) -> Iterator[Path]:
    """A folder to write into; its files are moved to `out` if the block succeeds, and deleted if it doesn't.

    Only results of `command`, if it is given, are replaced. `then` is called once the files are in place, before
    another command can write to `out`. Until then no other command can; what killed commands left there is deleted.

    Raises OutputError: at once, before anything is computed, if `out` can't be written, another command is writing
    there, or the results there are another's; later, if the disk is full.
    """
    with output_errors(f"out = {str(out)!r}"), _folders(out), locked(out):
        _require_own(out, command)
        for left in out.glob(f"{_PARTIAL}*"):
            _restore(left, out)
            shutil.rmtree(left, ignore_errors=True)
        staging = Path(tempfile.mkdtemp(prefix=_PARTIAL, dir=out))
        try:
            yield staging
            with interrupts_later():
                _replace(staging, out)
                then()
        finally:
            shutil.rmtree(staging, ignore_errors=True)


@contextlib.contextmanager
def output_errors(what: str) -> Iterator[None]:
    """Turn failures to write, of the system or of pyarrow, into OutputErrors that say what can't be written."""
    try:
        yield
    except OutputError:
        raise
    except FileExistsError as error:
        raise OutputError(f"{what}: can't be written (a folder of its path is a file or a broken link)") from error
    except RecursionError as error:  # of mkdir
        raise OutputError(f"{what}: can't be written (its path is too deep)") from error
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)  # pyarrow's words are longer
        raise OutputError(f"{what}: can't be written ({reason})") from error
    except Exception as error:
        if not type(error).__module__.startswith("pyarrow"):
            raise
        raise OutputError(f"{what}: can't be written ({first_line(error)})") from error


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other commands out of a folder, which must exist, until the block ends.

    The operating system holds the lock, so it ends with the process, however that ends; a file left behind by a killed
    process locks nothing. A file system without locks is used without one. Raises OutputError, at once, if another
    command is using the folder, OSError if it isn't writable.
    """
    lock, ours = FileLock(folder / _LOCK, blocking=False, fallback_to_soft=False), False
    try:
        with interrupts_later():
            try:
                lock.acquire()
            except Timeout as error:
                raise OutputError(f"out = {str(folder)!r}: another command is writing there") from error
            except OSError as error:
                if error.errno not in _NO_LOCKS:
                    raise
            ours = True
        yield
    finally:
        if ours:
            with contextlib.suppress(OSError):
                (folder / _LOCK).unlink()  # while it is ours; Windows deletes it on release
            lock.release()


@contextlib.contextmanager
def _folders(folder: Path) -> Iterator[None]:
    """Make a folder and those around it for a block; if the block leaves them empty, they go."""
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for one in made:
            with contextlib.suppress(OSError):
                one.rmdir()


def _require_own(out: Path, command: str | None) -> None:
    """Refuse files and FOLDERS that no command, or another one, has made where results must go: they'd be deleted."""
    for name in (MANIFEST_FILE, *_FILES):
        if (out / name).is_dir():
            raise OutputError(f"out = {str(out)!r}: {name} is a folder there, and must be a file or absent")
    for name, endings in FOLDERS.items():
        if (out / name).exists() and not (out / name).is_dir():
            raise OutputError(f"out = {str(out)!r}: {name} is a file there, and must be a folder or absent")
        files = [file for file in (out / name).rglob("*") if not file.is_dir()]
        if files and not ((out / MANIFEST_FILE).is_file() and all(file.suffix in endings for file in files)):
            why = "contains files that aren't part of results; move it away"
            raise OutputError(f"out = {str(out)!r}: {name} there {why}")
    with contextlib.suppress(LogError):  # damaged, or of a newer version
        if command is not None and (other := known_manifest(out).get("command", command)) != command:
            raise OutputError(f"out = {str(out)!r}: contains results of `{other}`; --overwrite replaces them")


def _replace(staging: Path, out: Path) -> None:
    """Replace the old files by the new ones, the manifest last, which marks them as complete.

    If that fails, the old ones are put back.
    """
    new = {file.name for file in staging.iterdir()}
    old = staging / _OLD
    old.mkdir()
    others = sorted({*_FILES, *FOLDERS, *new} - {MANIFEST_FILE})
    moves = [(out / name, old / name) for name in (MANIFEST_FILE, *others) if (out / name).exists()]
    moves += [(staging / name, out / name) for name in (*others, MANIFEST_FILE) if name in new]
    done: list[tuple[Path, Path]] = []
    try:
        for source, target in moves:
            os.replace(source, target)
            done.append((source, target))
    except OSError:
        for source, target in reversed(done):
            os.replace(target, source)
        raise


def _restore(left: Path, out: Path) -> None:
    """Put back the results that a killed command had moved out of the way."""
    if not (left / _OLD / MANIFEST_FILE).exists() or (out / MANIFEST_FILE).exists():
        return
    for old in sorted((left / _OLD).iterdir(), key=lambda file: file.name == MANIFEST_FILE):
        if (out / old.name).is_dir():
            shutil.rmtree(out / old.name)
        os.replace(old, out / old.name)


def write_whole(file: Path, write: Callable[[Path], object]) -> None:
    """Have `write` fill a draft in the file's folder, and move it into place; a failure leaves nothing behind."""
    draft = file.with_name(f".{file.name}-{os.getpid()}")
    with _folders(file.parent):
        try:
            write(draft)
            os.replace(draft, file)
        finally:
            draft.unlink(missing_ok=True)


def write_output(file: Path, write: Callable[[Path], object]) -> None:
    """Replace a file that the user has named; raises OutputError if it can't be written, or is a device or the like."""
    with output_errors(str(file)):
        if file.exists() and not file.is_file():
            raise OutputError(f"{file}: can't be replaced (it is not a regular file)")
        write_whole(file, write)


def file_names(names: Sequence[str], ending: str = "") -> list[str]:
    """File names (n,) with an ending for runs, all different whatever the runs are called."""
    found: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"[^\w.=+-]+", "_", name).strip("._")[:_MAX_NAME] or "run"
        candidates = (f"{plain}{ending}" if k == 1 else f"{plain}_{k}{ending}" for k in itertools.count(1))
        file = next(file for file in candidates if file.lower() not in found)
        found[file.lower()] = file
    return list(found.values())


def write_results(
    folder: Path, summary: Mapping[str, Any], about: Mapping[str, Any], logs: Sequence["RunLog"] = ()
) -> None:
    """Write what every command leaves: summary, manifest and, if it has any, runs."""
    if logs:
        write_runs(folder, logs)
    write_json(folder / SUMMARY_FILE, summary)
    write_json(folder / MANIFEST_FILE, about)


def write_runs(folder: Path, logs: Sequence["RunLog"]) -> None:
    """Write runs as the folder's RUNS_FILE."""
    from trackslip.logs.logfile import write_parquet  # late: not every command has runs to write

    write_parquet(logs, folder / RUNS_FILE)


def write_samples(folder: Path, samples: "SlipSamples") -> None:
    """Write steady samples as the folder's RUNS_FILE."""
    import pyarrow as pa
    import pyarrow.parquet

    from trackslip.logs.schema import with_units
    from trackslip.logs.table import SAMPLE_COLUMNS

    columns = np.concatenate([samples.omega, samples.twist, samples.slip], axis=1).T
    numbers = dict(zip((*SAMPLE_COLUMNS, "slip_l", "slip_r"), columns, strict=True))
    table = with_units(pa.table({"run": list(samples.run), **numbers}))
    pa.parquet.write_table(table, folder / RUNS_FILE, write_page_checksum=True)


def write_bags(
    folder: Path,
    names: Sequence[str],
    logs: Iterable["RunLog"],
    options: Callable[["RunLog"], dict[str, Any]] = lambda log: {},
    done: Callable[[float], None] = lambda bags: None,
) -> dict[str, str]:
    """Write a bag of each run, called `names`, to BAGS_FOLDER in `folder`; returns their places in it by these names.

    `options` gives more arguments of `write_bag`; `done` is called with the number of bags since the last call.
    """
    from trackslip.ros.writer import write_bag  # late: few need it

    places = {}
    for log, name, file in zip(logs, names, file_names(names), strict=True):
        write_bag(log, folder / BAGS_FOLDER / file, **options(log))
        places[name] = f"{BAGS_FOLDER}/{file}"
        done(1)
    return places


def bags_text(out: Path, bags: Mapping[str, str]) -> str:
    """A line that says where the bags are."""
    if len(bags) == 1:
        return f"{out / next(iter(bags.values()))}: a ROS 2 bag"
    return f"{out / BAGS_FOLDER}: {len(bags)} ROS 2 bags"
