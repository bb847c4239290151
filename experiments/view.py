"""`trackslip view`: stored runs in the rerun viewer, the browser, or a file."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from experiments import store
from experiments.recording import file_names, record, title
from experiments.view_config import ViewConfig
from trackslip.errors import LogError, TrackslipError
from trackslip.lawfile import load_laws
from trackslip.logfile import read_runs
from trackslip.runlog import RunLog

_NAMED = 5  # runs that an error names
_LONGEST = 300  # characters of what the viewer said


def run(config: ViewConfig) -> None:
    """Read, choose, show."""
    logs = read(config.path)
    chosen = choose(logs, config.run, config.path)
    if not config.run and len(logs) > 1:
        print(f"{len(logs)} runs, shown is {chosen[0].run!r}; --run ID chooses, --run ID --run ID compares")
    laws = config.path if _has_laws(config.path) else None
    if config.save is not None:
        record(config.save, chosen, laws)
        print(f"{config.save}: {title(chosen)}; rerun {config.save}")
    else:
        with tempfile.TemporaryDirectory(prefix="trackslip-view-") as folder:
            file = Path(folder) / file_names([title(chosen)])[0]
            record(file, chosen, laws)
            if config.web:
                print("in the browser, at http://localhost:9090, until interrupted", flush=True)
            _open(file, config.web)


def read(path: Path) -> list[RunLog]:
    """The runs in a folder of results, or in a log; raises LogError where there are none."""
    if path.is_dir():
        if not (path / store.RUNS).is_file():
            raise LogError(f"{path}: no runs in it ({store.RUNS} is missing)")
        path = path / store.RUNS
    return read_runs(path)


def choose(logs: Sequence[RunLog], names: Sequence[str], path: Path) -> list[RunLog]:
    """The runs called `names`, in that order, or else the first; raises LogError for a name that none has."""
    known = {log.run: log for log in logs}
    for name in names:
        if name not in known:
            some = ", ".join(repr(other) for other in list(known)[:_NAMED])
            more = f" and {len(known) - _NAMED} more" if len(known) > _NAMED else ""
            raise LogError(f"{path}: no run {name!r}; there are {some}{more}")
    return [known[name] for name in names] or [logs[0]]


def _has_laws(path: Path) -> bool:
    try:
        return path.is_dir() and bool(load_laws(path))
    except TrackslipError:
        return False


def _open(file: Path, web: bool) -> None:
    """Show a recording in a new viewer, native or in the browser, until that is closed or interrupted.

    Raises:
        TrackslipError: when there is no viewer, or it doesn't start.
    """
    beside = Path(sys.executable).with_name("rerun")  # also in an environment that isn't active
    viewer = str(beside) if beside.exists() else shutil.which("rerun")
    if viewer is None:
        raise TrackslipError("the rerun viewer isn't installed; --save FILE writes what it would show")
    command = [viewer, "--new", *(["--web-viewer"] if web else []), str(file)]
    quiet = {"RUST_LOG": "warn" if web else "error", "RERUN_APP_ONLY": "true"}
    with subprocess.Popen(command, env={**quiet, **os.environ}, stderr=subprocess.PIPE, text=True) as process:
        try:
            _, said = process.communicate()
        except BaseException:
            process.terminate()
            raise
    if process.returncode != 0:
        why = next((line for line in said.splitlines() if line.startswith("Error: ")), said).removeprefix("Error: ")
        why = re.sub(r"\S*/\S+: ", "", why)  # where in the viewer's source
        other = "" if web else "--web, or "
        raise TrackslipError(f"the rerun viewer doesn't start; try {other}--save FILE ({why.strip()[:_LONGEST]})")
