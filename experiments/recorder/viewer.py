"""The rerun viewer: which runs it shows, and how it is started, native or in the browser."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from experiments.common.results import DRIVE_RECORDING, RECORDINGS_FOLDER
from trackslip.errors import LogError, TrackslipError
from trackslip.logs.runlog import RunLog

_NAMED = 5  # runs listed in an error message


def drive_recording(path: Path) -> Path | None:
    """The recording that `trackslip drive` left in a folder, which shows the course; None in any other place."""
    file = path / RECORDINGS_FOLDER / DRIVE_RECORDING
    return file if file.is_file() else None


def choose(logs: Sequence[RunLog], names: Sequence[str], path: Path) -> list[RunLog]:
    """The runs of these names, in that order, by default the first; raises LogError unless each is one run."""
    chosen = [_find(logs, name, path) for name in names] or [logs[0]]
    if len({log.run for log in chosen}) < len(chosen):
        raise LogError(f"{path}: two of the runs {', '.join(map(repr, names))} are the same")
    return chosen


def _find(logs: Sequence[RunLog], name: str, path: Path) -> RunLog:
    """The run with that name or, in a sweep, the only one whose id begins with it."""
    ids = {log.run: str(log.metadata.get("id", "")) for log in logs}
    matches = [log for log in logs if log.run == name]
    matches = matches or [log for log in logs if name and ids[log.run].startswith(name)]
    if len(matches) == 1:
        return matches[0]
    what = f"{len(matches)} runs whose id begins with" if matches else "no run"
    known = [f"{log.run!r} (id {ids[log.run]})" if ids[log.run] else repr(log.run) for log in matches or logs]
    raise LogError(f"{path}: {what} {name!r}; there are {', '.join(known[:_NAMED])}")


def show(file: Path, web: bool) -> None:
    """Show a recording in a new viewer, native or in the browser, until it is closed or interrupted.

    Raises TrackslipError if there is no viewer, or it doesn't start.
    """
    beside = Path(sys.executable).with_name("rerun")  # found even if the environment isn't active
    viewer = str(beside) if beside.exists() else shutil.which("rerun")
    if viewer is None:
        raise TrackslipError("the rerun viewer isn't installed; --save FILE writes the recording to a file")
    command = [viewer, "--bind", "127.0.0.1", "--new", str(file)]
    if web:
        print("showing in the browser until interrupted", flush=True)
        command += ["--web-viewer", "--web-viewer-port", "0"]
    log = "error,re_sdk::web_viewer=info"  # which names the page
    with subprocess.Popen(command, env={"RUST_LOG": log, "RERUN_APP_ONLY": "true", **os.environ}) as process:
        try:
            process.wait()
        except BaseException:  # `rerun` is a script that starts the viewer, and ends it only when interrupted itself
            process.send_signal(signal.SIGINT if os.name == "posix" else signal.SIGTERM)
            raise
    if process.returncode != 0:
        other = "" if web else "--web, or "
        raise TrackslipError(f"the rerun viewer doesn't start; try {other}--save FILE")
