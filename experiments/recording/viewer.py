"""The rerun viewer: which runs it shows, and how it is started, native or in the browser."""

import contextlib
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import threading
import urllib.parse
from collections.abc import Sequence
from pathlib import Path
from time import monotonic, sleep

from experiments.storage.results import DRIVE_RECORDING, MANIFEST_FILE, RECORDINGS_FOLDER
from trackslip.errors import LogError, OutputError, TrackslipError
from trackslip.logs.runlog import RunLog
from trackslip.slip.law_file import load_laws

_NAMED = 5  # runs listed in an error message
_SHORT = 12  # characters shown of an id
_LOCAL = "127.0.0.1"
_PAGE, _STREAM = 9090, 9876  # default ports of the viewer's page and of its data
_MAX_MESSAGE = 300  # characters quoted from the viewer's error
_PATIENCE, _BETWEEN = 30.0, 0.1  # how long to wait for the viewer to start, and how often to look [s]


def drive_recording(path: Path) -> Path | None:
    """The recording that `trackslip drive` left in a folder, which shows the course; None in any other place."""
    try:
        about = json.loads((path / MANIFEST_FILE).read_text(encoding="utf-8"))
        file = path / RECORDINGS_FOLDER / DRIVE_RECORDING
        return file if about["command"] == "drive" and file.is_file() else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def copy(recording: Path, file: Path) -> None:
    """Copy a recording to a file; raises OutputError if it can't be written."""
    try:
        shutil.copyfile(recording, file)
    except OSError as error:
        raise OutputError(f"{file}: can't be written ({error.strerror or error})") from error


def choose(logs: Sequence[RunLog], wanted: Sequence[str], path: Path) -> list[RunLog]:
    """The wanted runs, in that order, by default the first; raises LogError unless each name or id matches one run."""
    chosen = [_find(logs, one, path) for one in wanted] or [logs[0]]
    if len({log.run for log in chosen}) < len(chosen):
        raise LogError(f"{path}: two of the runs {', '.join(map(repr, wanted))} are the same")
    return chosen


def _find(logs: Sequence[RunLog], wanted: str, path: Path) -> RunLog:
    """The run with that name or, in a sweep, with that id or the only id that begins with it."""
    found = [log for log in logs if log.run == wanted]
    found = found or [log for log in logs if wanted and str(log.metadata.get("id", "")).startswith(wanted)]
    if len(found) != 1:
        some = found or logs
        names = ", ".join(_called(log) for log in some[:_NAMED])
        more = f" and {len(some) - _NAMED} more" if len(some) > _NAMED else ""
        what = f"{len(found)} runs whose id begins with" if found else "no run"
        raise LogError(f"{path}: {what} {wanted!r}; there are {names}{more}")
    return found[0]


def _called(log: RunLog) -> str:
    return repr(log.run) + (f" (id {str(log.metadata['id'])[:_SHORT]})" if "id" in log.metadata else "")


def has_laws(path: Path) -> bool:
    """Whether a folder has identified laws."""
    try:
        return path.is_dir() and bool(load_laws(path))
    except TrackslipError:
        return False


def show(file: Path, web: bool, begin: float) -> None:
    """Show a recording in a new viewer, native or in the browser, until it is closed or interrupted.

    The native viewer starts at `begin` [s]; in the browser, playback starts at zero and then repeats the loop.
    Raises TrackslipError if there is no viewer, or it doesn't start.
    """
    beside = Path(sys.executable).with_name("rerun")  # found even if the environment isn't active
    viewer = str(beside) if beside.exists() else shutil.which("rerun")
    if viewer is None:
        raise TrackslipError("the rerun viewer isn't installed; --save FILE writes the recording to a file")
    port = free_port(_STREAM)
    stream = f"rerun+http://{_LOCAL}:{port}/proxy"
    command = [viewer, "--bind", _LOCAL, "--port", str(port), str(file)]
    if web:
        page = free_port(_PAGE)
        command += ["--web-viewer", "--web-viewer-port", str(page)]
        source = urllib.parse.quote(stream, safe="")
        print(f"showing in the browser until interrupted: http://{_LOCAL}:{page}?url={source}", flush=True)
    quiet = {"RUST_LOG": "error", "RERUN_APP_ONLY": "true"}
    with subprocess.Popen(command, env={**quiet, **os.environ}, stderr=subprocess.PIPE, text=True) as process:
        if not web:
            threading.Thread(target=put_time, args=(stream, begin, process), daemon=True).start()
        try:
            _, said = process.communicate()
        except BaseException:
            process.terminate()
            raise
    if process.returncode != 0:
        why = next((line for line in said.splitlines() if line.startswith("Error: ")), said).removeprefix("Error: ")
        why = re.sub(r"\S*/\S+: ", "", why)  # a place in the viewer's source
        other = "" if web else "--web, or "
        raise TrackslipError(f"the rerun viewer doesn't start; try {other}--save FILE ({why.strip()[:_MAX_MESSAGE]})")


def put_time(stream: str, time: float, viewer: subprocess.Popen[str]) -> None:
    """Move the viewer at `stream` to a time [s] once it has opened the recording, which cannot specify it itself."""
    from rerun.experimental import ViewerClient

    end = monotonic() + _PATIENCE
    while monotonic() < end and viewer.poll() is None:
        with contextlib.suppress(Exception):  # not ready yet, or this experimental interface has changed
            client = ViewerClient.connect(stream)
            if client.get_state().recordings:
                client.set_time(duration=time)
                return
        sleep(_BETWEEN)


def free_port(usual: int) -> int:
    """The usual port or, if it is taken, any free one."""
    for port in (usual, 0):
        with socket.socket() as test, contextlib.suppress(OSError):
            test.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the viewer will
            test.bind((_LOCAL, port))
            return int(test.getsockname()[1])
    raise TrackslipError("no free port on this machine; --save FILE writes the recording to a file")
