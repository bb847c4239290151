"""`trackslip view`: stored runs in the rerun viewer, the browser, or a file."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import urllib.parse
from collections.abc import Sequence
from pathlib import Path
from time import monotonic, sleep

from experiments.options.view import ViewConfig
from experiments.recording import file_names, record, title
from trackslip.errors import LogError, TrackslipError
from trackslip.logs.logfile import load
from trackslip.logs.runlog import RunLog
from trackslip.slip.law_file import load_laws

_NAMED = 5  # runs that an error names
_SHORT = 12  # characters of an id that are shown
_LOCAL = "127.0.0.1"
_PAGE, _STREAM = 9090, 9876
"""Usual ports of the viewer's page and of what it is sent."""
_MAX_MESSAGE = 300  # characters of what the viewer said
_PATIENCE, _BETWEEN = 30.0, 0.1  # with a viewer that starts, and between two looks at it [s]


def run(config: ViewConfig) -> None:
    """Read, choose, show."""
    logs = load(config.path)
    chosen = choose(logs, config.run, config.path)
    if not config.run and len(logs) > 1:
        print(f"{len(logs)} runs, shown is {chosen[0].run!r}; --run ID chooses, --run ID --run ID compares")
    laws = config.path if _has_laws(config.path) else None
    if config.save is not None:
        record(config.save, chosen, laws)
        print(f"{config.save}: {title(chosen)}; rerun {shlex.quote(str(config.save))}")
    else:
        with tempfile.TemporaryDirectory(prefix="trackslip-view-") as folder:
            file = Path(folder) / file_names([title(chosen)])[0]
            begin = record(file, chosen, laws)
            _open(file, config.web, begin)


def choose(logs: Sequence[RunLog], wanted: Sequence[str], path: Path) -> list[RunLog]:
    """The runs that `wanted` says, in that order, or else the first; raises LogError unless each says one."""
    chosen = [_find(logs, one, path) for one in wanted] or [logs[0]]
    if len({log.run for log in chosen}) < len(chosen):
        raise LogError(f"{path}: two of the runs {', '.join(map(repr, wanted))} are the same")
    return chosen


def _find(logs: Sequence[RunLog], wanted: str, path: Path) -> RunLog:
    """The run of that name or, in a sweep, of that id or the only one whose id begins so."""
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
    identity = log.metadata.get("id")
    return repr(log.run) if identity is None else f"{log.run!r} (id {str(identity)[:_SHORT]})"


def _has_laws(path: Path) -> bool:
    try:
        return path.is_dir() and bool(load_laws(path))
    except TrackslipError:
        return False


def _open(file: Path, web: bool, begin: float) -> None:
    """Show a recording in a new viewer, native or in the browser, until that is closed or interrupted.

    The native one is put to `begin` [s]; that in the browser plays from the start until it comes to its loop.

    Raises:
        TrackslipError: when there is no viewer, or it doesn't start.
    """
    beside = Path(sys.executable).with_name("rerun")  # also in an environment that isn't active
    viewer = str(beside) if beside.exists() else shutil.which("rerun")
    if viewer is None:
        raise TrackslipError("the rerun viewer isn't installed; --save FILE writes what it would show")
    port = free_port(_STREAM)
    stream = f"rerun+http://{_LOCAL}:{port}/proxy"
    command = [viewer, "--bind", _LOCAL, "--port", str(port), str(file)]
    if web:
        page = free_port(_PAGE)
        command += ["--web-viewer", "--web-viewer-port", str(page)]
        source = urllib.parse.quote(stream, safe="")
        print(f"in the browser, until interrupted: http://{_LOCAL}:{page}?url={source}", flush=True)
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
        why = re.sub(r"\S*/\S+: ", "", why)  # where in the viewer's source
        other = "" if web else "--web, or "
        raise TrackslipError(f"the rerun viewer doesn't start; try {other}--save FILE ({why.strip()[:_MAX_MESSAGE]})")


def put_time(stream: str, time: float, viewer: subprocess.Popen[str]) -> None:
    """Put the viewer that listens at `stream` to a time [s] once it has opened its recording, which can't say so."""
    from rerun.experimental import ViewerClient

    end = monotonic() + _PATIENCE
    while monotonic() < end and viewer.poll() is None:
        with contextlib.suppress(Exception):  # not there yet; or another version of what is experimental
            client = ViewerClient.connect(stream)
            if client.get_state().recordings:
                client.set_time(duration=time)
                return
        sleep(_BETWEEN)


def free_port(usual: int) -> int:
    """The usual port, or where that is taken any other."""
    for port in (usual, 0):
        with socket.socket() as test, contextlib.suppress(OSError):
            test.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the viewer will
            test.bind((_LOCAL, port))
            return int(test.getsockname()[1])
    raise TrackslipError("no port is free on this machine; --save FILE writes what the viewer would show")
