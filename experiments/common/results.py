"""Writing of results: single files, each written completely or not at all, and bags."""

import contextlib
import filecmp
import itertools
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.common.leftovers import temporary, undone
from trackslip.errors import OutputError, first_line
from trackslip.identification.samples import SlipSamples
from trackslip.logs.runlog import RunLog
from trackslip.replacement import MANIFEST

SUMMARY_FILE: Final = "summary.json"
RUNS_FILE: Final = "runs.parquet"
MANIFEST_FILE: Final = MANIFEST
REPORT_FILE: Final = "report.html"
TABLE_FILE: Final = "table.parquet"
FIGURES_FOLDER: Final = "figures"
RECORDINGS_FOLDER: Final = "recordings"
BAGS_FOLDER: Final = "bags"
PICTURES_FOLDER: Final = "pictures"
DRIVE_RECORDING: Final = "drive.rrd"
TRAJECTORIES_FOLDER: Final = "trajectories"

_LONGEST_NAME: Final = 120  # bytes in a file name without its ending; file systems allow 255
_drafts = itertools.count(1)  # numbers of the drafts of this process


@contextlib.contextmanager
def output_errors(what: str) -> Iterator[None]:
    """Turn write errors from the system or pyarrow into OutputErrors that say what can't be
    written.
    """
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        # pyarrow's own text is longer
        reason = os.strerror(error.errno) if error.errno else first_line(error)
        raise OutputError(f"{what}: can't be written ({reason})") from error
    except RecursionError as error:  # from mkdir
        raise OutputError(f"{what}: can't be written (its path is too deep)") from error


@contextlib.contextmanager
def new_folders(folder: Path) -> Iterator[None]:
    """Make a folder and its parents for a block, and remove new folders that the block leaves
    empty.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    with undone(partial(_remove_empty, made)):
        folder.mkdir(parents=True, exist_ok=True)
        yield


def _remove_empty(folders: Iterable[Path]) -> None:
    for folder in folders:
        with contextlib.suppress(OSError):
            folder.rmdir()


def write_whole(file: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a draft next to `file`, and move the draft into place; a failure leaves
    nothing behind.
    """
    with new_folders(file.parent), temporary(_draft_of(file)) as draft:
        write(draft)
        draft.replace(file)


def _draft_of(file: Path) -> Path:
    """A draft beside a file, not named after it: a name may be as long as a file system allows."""
    return file.with_name(f".draft-{os.getpid()}-{next(_drafts)}")


def write_output(file: Path, write: Callable[[Path], object]) -> None:
    """Write or replace a file named by the user; raises OutputError if it can't be written or isn't
    a regular file.
    """
    write_outputs({file: write}, overwrite=True)


def write_outputs(writers: Mapping[Path, Callable[[Path], object]], overwrite: bool) -> None:
    """Write files named by the user, all or none; each of the `writers` gets the path of a draft.

    Without `overwrite`, a file that exists must have the content that would be written, and stays.
    Raises OutputError otherwise, and for a file that can't be written or isn't a regular file.
    """
    with contextlib.ExitStack() as stack:
        drafts = {}
        for file, write in writers.items():
            stack.enter_context(output_errors(str(file)))
            _require_replaceable(file)
            stack.enter_context(new_folders(file.parent))
            drafts[file] = stack.enter_context(temporary(_draft_of(file)))
            write(drafts[file])
        for file, draft in drafts.items():
            if file.exists() and not overwrite and not filecmp.cmp(file, draft, shallow=False):
                raise OutputError(
                    f"{file}: exists already, with other content; --overwrite replaces it"
                )
        for file, draft in drafts.items():
            draft.replace(file)


def _require_replaceable(file: Path) -> None:
    """Raise OutputError if something other than a regular file has a file's name."""
    if file.is_symlink():
        raise OutputError(f"{file}: can't be replaced (it is a symbolic link)")
    if file.exists() and not file.is_file():
        raise OutputError(f"{file}: can't be replaced (it is not a regular file)")


def file_names(names: Sequence[str], ending: str = "") -> list[str]:
    """File names (n,) with this ending for run names (n,), all different even on file systems that
    ignore case.
    """
    used: dict[str, str] = {}
    for name in names:
        plain = _shortened(re.sub(r"[^\w.=+-]+", "_", name).strip("._")) or "run"
        file = f"{plain}{ending}"
        for k in itertools.count(2):
            if file.lower() not in used:
                break
            file = f"{plain}_{k}{ending}"
        used[file.lower()] = file
    return list(used.values())


def _shortened(name: str) -> str:
    """The beginning of a file name that has at most _LONGEST_NAME bytes, of characters that names
    of files may have here.
    """
    encoding = sys.getfilesystemencoding()
    known = name.encode(encoding, "ignore")
    return known[:_LONGEST_NAME].decode(encoding, "ignore")


def write_runs(folder: Path, logs: Sequence[RunLog]) -> None:
    """Write runs as the folder's RUNS_FILE."""
    from trackslip.logs.logfile import write_parquet  # imported late, because pyarrow takes 0.1 s

    write_parquet(logs, folder / RUNS_FILE)


def write_samples(folder: Path, samples: SlipSamples) -> None:
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
    logs: Iterable[RunLog],
    options: Callable[[RunLog], dict[str, Any]] = lambda log: {},
    done: Callable[[float], None] = lambda bags: None,
) -> dict[str, str]:
    """Write each run as a bag, named as in `names`, to `folder`/BAGS_FOLDER; returns paths in
    `folder` by name.

    `options` returns further arguments of `write_bag` for a run; `done` is called with 1 after each
    bag.
    """
    from sim.bags.writer import write_bag  # imported late, because few commands need it

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
