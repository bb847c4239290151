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
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from trackslip import logfile
from trackslip.errors import OutputError
from trackslip.identification import SlipSamples
from trackslip.runlog import RunLog

SUMMARY = "summary.json"
RUNS = "runs.parquet"
MANIFEST = "manifest.json"
REPORT = "report.html"
LEADERBOARD = "leaderboard.md"
RECORDINGS = "recordings"
"""A folder of recordings for the rerun viewer."""

_PACKAGES = ("trackslip", "mujoco", "numpy", "scipy", "lmfit", "pyarrow", "matplotlib", "casadi")


@contextlib.contextmanager
def results(out: Path) -> Iterator[Path]:
    """A folder to write into, whose files are moved to `out` when the block ends well, else deleted.

    Raises:
        OutputError: at once, before anything is computed, when `out` can't be written.
    """
    made: list[Path] = []
    staging = None
    try:
        try:
            made = [folder for folder in (out, *out.parents) if not folder.exists()]
            out.mkdir(parents=True, exist_ok=True)
            for name in (MANIFEST, SUMMARY, RUNS, REPORT, LEADERBOARD):
                if (out / name).is_dir():
                    raise OutputError(f"out = {str(out)!r}: {name} is a folder there, and must be a file or absent")
            if (out / RECORDINGS).exists() and not (out / RECORDINGS).is_dir():
                raise OutputError(f"out = {str(out)!r}: {RECORDINGS} is a file there, and must be a folder or absent")
            staging = Path(tempfile.mkdtemp(prefix=".partial-", dir=out))
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(f"out = {str(out)!r}: can't be written ({error.strerror})") from error
        yield staging
        _replace(staging, out)
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"out = {str(out)!r}: can't be written ({error.strerror or error})") from error
    finally:
        if staging is not None:
            shutil.rmtree(staging, ignore_errors=True)
        for folder in made:  # leave no empty folders of ours behind
            with contextlib.suppress(OSError):
                folder.rmdir()


def _replace(staging: Path, out: Path) -> None:
    """Put the new files in place of the old ones, the manifest last: what it stands beside is complete."""
    (out / MANIFEST).unlink(missing_ok=True)
    new = {file.name for file in staging.iterdir()}
    for name in {SUMMARY, RUNS, REPORT, LEADERBOARD} - new:
        (out / name).unlink(missing_ok=True)
    _replace_recordings(staging / RECORDINGS, out / RECORDINGS)
    for name in sorted(new - {MANIFEST, RECORDINGS}) + sorted(new & {MANIFEST}):
        os.replace(staging / name, out / name)


def _replace_recordings(staging: Path, out: Path) -> None:
    """Put new recordings, if there are any, in place of all old ones; other files in the folder stay."""
    for old in out.glob("*.rrd"):
        old.unlink()
    if staging.is_dir():
        out.mkdir(exist_ok=True)
        for file in staging.iterdir():
            os.replace(file, out / file.name)
    with contextlib.suppress(OSError):
        out.rmdir()


def write_results(folder: Path, logs: Sequence[RunLog], summary: Mapping[str, Any], about: Mapping[str, Any]) -> None:
    """Write what every command that drives leaves: RUNS, SUMMARY and MANIFEST."""
    write_parquet(folder, logs)
    write_json(folder / SUMMARY, summary)
    write_json(folder / MANIFEST, about)


def write_parquet(folder: Path, logs: Sequence[RunLog]) -> None:
    """Write runs as the folder's RUNS."""
    logfile.write_parquet(logs, folder / RUNS)


def write_samples(folder: Path, samples: SlipSamples) -> None:
    """Write steady samples as the folder's RUNS."""
    columns = np.concatenate([samples.omega, samples.twist, samples.slip], axis=1)
    names = (*logfile.SAMPLE_COLUMNS, "slip_l", "slip_r")
    table = pa.table({"run": list(samples.run)} | {n: columns[:, k] for k, n in enumerate(names)})
    pa.parquet.write_table(table, folder / RUNS)


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
    root = Path(__file__).parent.parent
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
