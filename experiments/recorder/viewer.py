"""The rerun viewer: the choice of runs to show, and the start of the viewer, native or in the
browser.
"""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

from experiments.common.leftovers import undone
from trackslip.errors import LogError, TrackslipError
from trackslip.logs.runlog import RunLog


def choose(logs: Iterable[RunLog], names: Sequence[str], path: Path) -> tuple[list[RunLog], int]:
    """The runs with these names, in that order, by default the first run, and the number of all
    runs; raises LogError for an unknown name.

    Only the chosen runs are kept in memory.
    """
    chosen: dict[str, RunLog] = {}
    others: list[str] = []
    for log in logs:
        if log.run in names or not (names or chosen):
            chosen[log.run] = log
        else:
            others.append(log.run)
    for name in names:
        if name not in chosen:
            there = ", ".join(map(repr, [*chosen, *others][:5]))
            raise LogError(f"{path}: no run {name!r}; there are {there}")
    return [chosen[name] for name in names or chosen], len(chosen) + len(others)


def show(file: Path, web: bool) -> None:
    """Show a recording in a new viewer until that is closed or interrupted; raises TrackslipError
    if it can't start.
    """
    program = Path(sys.executable).with_name("rerun")  # the environment needn't be active
    command = [
        str(program) if program.exists() else "rerun",
        "--bind",
        "127.0.0.1",
        "--new",
        str(file),
    ]
    if web:
        print("showing in the browser until interrupted", flush=True)
        command += ["--web-viewer", "--web-viewer-port", "0"]
    log = "error,re_sdk::web_viewer=info"  # which prints the page's address
    environment = {"RUST_LOG": log, "RERUN_APP_ONLY": "true", **os.environ}
    try:
        with (
            subprocess.Popen(command, env=environment, process_group=0) as viewer,
            undone(partial(_end, viewer)),
        ):
            code = viewer.wait()
    except OSError as error:
        raise _not_started(web) from error
    if code:
        raise _not_started(web)


def _end(viewer: subprocess.Popen[bytes]) -> None:
    """End the viewer, which is a child of the process that was started."""
    if sys.platform == "win32":
        viewer.kill()
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(viewer.pid, signal.SIGKILL)


def _not_started(web: bool) -> TrackslipError:
    other = "" if web else "--web, or "
    return TrackslipError(f"the rerun viewer doesn't start; try {other}--save FILE")
