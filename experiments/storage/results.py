"""Where results go: one folder a command, complete or not at all."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.metadata
import json
import math
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.parallel.interrupts import interrupts_later
from experiments.storage.lock import locked
from trackslip.errors import OutputError, first_line
from trackslip.logs import file_format as fileformat

if TYPE_CHECKING:
    from trackslip.identification.samples import SlipSamples
    from trackslip.logs.runlog import RunLog

SUMMARY = "summary.json"
RUNS = "runs.parquet"
MANIFEST = fileformat.MANIFEST
REPORT = "report.html"
LEADERBOARD = "leaderboard.md"
TABLE = "table.parquet"
FIGURES = "figures"
"""A folder of figures as files."""
RECORDINGS = "recordings"
"""A folder of recordings for the rerun viewer."""

FOLDERS = {FIGURES: (".svg", ".pdf"), RECORDINGS: (".rrd",)}
"""Folders among the results, and how the names of what is in them end; the rest are files."""

_PARTIAL, _OLD = ".partial-", ".old"
_PACKAGES = ("trackslip", "mujoco", "numpy", "scipy", "pyarrow", "matplotlib", "casadi")


@contextlib.contextmanager
def results(out: Path, then: Callable[[], None] = lambda: None) -> Iterator[Path]:
    """A folder to write into, whose files are moved to `out` when the block ends well, else deleted.

    `then` is called once they are there, before another command can write to `out`.

    Until the block ends no other command can write to `out`; what killed ones left there is deleted.

    Raises:
        OutputError: at once, before anything is computed, when `out` can't be written or another command writes to it;
            later, when the disk is full.
    """
    made: list[Path] = []
    try:
        made = [folder for folder in (out, *out.parents) if not folder.exists()]
        out.mkdir(parents=True, exist_ok=True)
        with locked(out):
            _require_files(out, (MANIFEST, SUMMARY, RUNS, REPORT, LEADERBOARD, TABLE))
            for name, endings in FOLDERS.items():
                _require_own(out, name, endings)
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
    """Why a file can't be written, in the system's words; pyarrow has longer ones."""
    if isinstance(error, FileExistsError):
        return "it is not a folder"
    return os.strerror(error.errno) if error.errno else str(error)


def _require_files(out: Path, names: Iterable[str]) -> None:
    for name in names:
        if (out / name).is_dir():
            raise OutputError(f"out = {str(out)!r}: {name} is a folder there, and must be a file or absent")


def _replace(staging: Path, out: Path) -> None:
    """Put the new files in place of the old ones, the manifest last: what it stands beside is complete.

    When that fails, the old ones are put back.
    """
    new = {file.name for file in staging.iterdir()}
    _require_files(out, sorted(new - set(FOLDERS)))
    old = staging / _OLD
    old.mkdir()
    moved: list[str] = []
    placed: list[str] = []
    try:
        for name in (MANIFEST, *sorted({SUMMARY, RUNS, REPORT, LEADERBOARD, TABLE, *FOLDERS} | new - {MANIFEST})):
            if (out / name).exists():
                os.replace(out / name, old / name)
                moved.append(name)
        for name in sorted(new - {MANIFEST}) + sorted(new & {MANIFEST}):
            os.replace(staging / name, out / name)
            placed.append(name)
    except OSError:
        for name in placed:
            os.replace(out / name, staging / name)
        for name in moved:
            os.replace(old / name, out / name)
        raise


def _restore(left: Path, out: Path) -> None:
    """Put back the results that a command had moved out of the way when it was killed."""
    if not (left / _OLD / MANIFEST).exists() or (out / MANIFEST).exists():
        return
    for old in sorted((left / _OLD).iterdir(), key=lambda file: file.name == MANIFEST):
        if (out / old.name).is_dir():
            shutil.rmtree(out / old.name)
        os.replace(old, out / old.name)


def _require_own(out: Path, name: str, endings: tuple[str, ...]) -> None:
    """Refuse a folder of FOLDERS that no command made: it would be deleted."""
    folder = out / name
    if not folder.exists():
        return
    if not folder.is_dir():
        raise OutputError(f"out = {str(out)!r}: {name} is a file there, and must be a folder or absent")
    files = list(folder.iterdir())
    if files and not ((out / MANIFEST).is_file() and all(file.suffix in endings for file in files)):
        raise OutputError(f"out = {str(out)!r}: {name} there holds files that aren't of these results; move it away")


def write_results(folder: Path, logs: Sequence[RunLog], summary: Mapping[str, Any], about: Mapping[str, Any]) -> None:
    """Write what every command that drives leaves: RUNS, SUMMARY and MANIFEST."""
    write_parquet(folder, logs)
    write_json(folder / SUMMARY, summary)
    write_json(folder / MANIFEST, about)


def write_parquet(folder: Path, logs: Sequence[RunLog]) -> None:
    """Write runs as the folder's RUNS."""
    from trackslip.logs import logfile  # late: not every command has runs to write

    with arrow_errors(folder / RUNS):
        logfile.write_parquet(logs, folder / RUNS)


def write_samples(folder: Path, samples: SlipSamples) -> None:
    """Write steady samples as the folder's RUNS."""
    import pyarrow as pa
    import pyarrow.parquet

    from trackslip.logs.schema import with_units
    from trackslip.logs.table import SAMPLE_COLUMNS

    columns = np.concatenate([samples.omega, samples.twist, samples.slip], axis=1)
    names = (*SAMPLE_COLUMNS, "slip_l", "slip_r")
    table = pa.table({"run": list(samples.run)} | {n: columns[:, k] for k, n in enumerate(names)})
    table = table.cast(pa.schema(with_units(table.schema)))
    with arrow_errors(folder / RUNS):
        pa.parquet.write_table(table, folder / RUNS, write_page_checksum=True)


@contextlib.contextmanager
def arrow_errors(file: Path) -> Iterator[None]:
    """Make OutputErrors of pyarrow's own errors, those that aren't the system's."""
    import pyarrow as pa

    try:
        yield
    except OSError:
        raise
    except pa.ArrowException as error:
        raise OutputError(f"{file.name}: can't be written ({first_line(error)})") from error


def command_line(command: str) -> str:
    """The command as it was given."""
    return shlex.join(["trackslip", *(sys.argv[1:] or [command])])


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON with NaN as null and numpy's numbers as plain ones."""
    path.write_text(json.dumps(plain(content), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def plain(value: Any) -> Any:
    """`value` as what JSON knows; dataclasses become mappings, numbers that aren't finite None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def manifest(command: str, config: Any, wall_s: float, **more: Any) -> dict[str, Any]:
    """What is needed to make a result again: resolved options, versions, git state, and what is in `more`."""
    return {
        "format": fileformat.FORMAT,
        "command": command,
        "arguments": sys.argv[1:],
        "config": plain(config),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "wall_s": round(wall_s, 3),
        "versions": versions(),
        "platform": platform.platform(),
        "git": _git_state(),
        **plain(more),
    }


def versions() -> dict[str, str | None]:
    """Of Python and of the packages that results depend on."""
    return {"python": platform.python_version()} | {p: _version(p) for p in _PACKAGES}


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _git_state() -> dict[str, Any] | None:
    """Commit of trackslip's own checkout and whether it was changed; None when installed from a wheel."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return None
    try:
        commit = _git(root, "rev-parse", "HEAD")
        return {"commit": commit, "dirty": bool(_git(root, "status", "--porcelain"))}
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=True)
    return done.stdout.strip()
