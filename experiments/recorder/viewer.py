"""The rerun viewer: the choice of runs to show, and the start of the viewer, native or in the
browser.
"""

import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

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
    viewer = Path(sys.executable).with_name("rerun")  # the environment needn't be active
    command = [
        str(viewer) if viewer.exists() else "rerun",
        "--bind",
        "127.0.0.1",
        "--new",
        str(file),
    ]
    if web:
        print("showing in the browser until interrupted", flush=True)
        command += ["--web-viewer", "--web-viewer-port", "0"]
    log = "error,re_sdk::web_viewer=info"  # which prints the page's address
    try:
        subprocess.run(
            command, check=True, env={"RUST_LOG": log, "RERUN_APP_ONLY": "true", **os.environ}
        )
    except (OSError, subprocess.CalledProcessError) as error:
        other = "" if web else "--web, or "
        raise TrackslipError(f"the rerun viewer doesn't start; try {other}--save FILE") from error
