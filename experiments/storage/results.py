"""Folders of results: one per command, complete or not at all."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.parallel import interrupts_later
from experiments.storage.lock import locked
from experiments.storage.plain_json import write_json
from trackslip.errors import OutputError, first_line
from trackslip.logs.file_format import MANIFEST

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
_PARTIAL, _OLD = ".partial-", ".old"


@contextlib.contextmanager
def results_folder(out: Path, then: Callable[[], None] = lambda: None) -> Iterator[Path]:
    """A folder to write into; its files are moved to `out` if the block succeeds, and deleted if it doesn't.

    `then` is called once they are in place, before another command can write to `out`. Until then no other command can;
    what killed commands left there is deleted.

    Raises OutputError: at once, before anything is computed, if `out` can't be written or another command is writing
    there; later, if the disk is full.
    """
    made: list[Path] = []
    try:
        made = [folder for folder in (out, *out.parents) if not folder.exists()]
        out.mkdir(parents=True, exist_ok=True)
        with locked(out):
            _require_files(out, (MANIFEST_FILE, *_FILES))
            _require_own_folders(out)
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
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"out = {str(out)!r}: can't be written ({_reason(error)})") from error
    finally:
        for folder in made:  # leave no empty folders of ours behind
            with contextlib.suppress(OSError):
                folder.rmdir()


def _reason(error: OSError) -> str:
    """Why a file cannot be written, in the system's words; pyarrow's are longer."""
    if isinstance(error, FileExistsError):
        return "it is not a folder"
    return os.strerror(error.errno) if error.errno else str(error)


def _require_files(out: Path, names: Iterable[str]) -> None:
    for name in names:
        if (out / name).is_dir():
            raise OutputError(f"out = {str(out)!r}: {name} is a folder there, and must be a file or absent")


def _replace(staging: Path, out: Path) -> None:
    """Replace the old files by the new ones, the manifest last, which marks them as complete.

    If that fails, the old ones are put back.
    """
    new = {file.name for file in staging.iterdir()}
    _require_files(out, sorted(new - set(FOLDERS)))
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


def _require_own_folders(out: Path) -> None:
    """Refuse those of FOLDERS that no command has made, because they would be deleted."""
    for name, endings in FOLDERS.items():
        if (out / name).exists() and not (out / name).is_dir():
            raise OutputError(f"out = {str(out)!r}: {name} is a file there, and must be a folder or absent")
        files = [file for file in (out / name).rglob("*") if not file.is_dir()]
        if files and not ((out / MANIFEST_FILE).is_file() and all(file.suffix in endings for file in files)):
            why = "contains files that aren't part of results; move it away"
            raise OutputError(f"out = {str(out)!r}: {name} there {why}")


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

    with arrow_errors(folder / RUNS_FILE):
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
    with arrow_errors(folder / RUNS_FILE):
        pa.parquet.write_table(table, folder / RUNS_FILE, write_page_checksum=True)


@contextlib.contextmanager
def arrow_errors(file: Path) -> Iterator[None]:
    """Turn pyarrow's own errors, unlike those of the system, into OutputErrors."""
    import pyarrow as pa

    try:
        yield
    except OSError:
        raise
    except pa.ArrowException as error:
        raise OutputError(f"{file.name}: can't be written ({first_line(error)})") from error
