"""Ctrl-C and SIGTERM at any moment of a command: it ends at once, and leaves no process and no half of a file."""

import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from experiments.commands import benchmark, grid
from experiments.studies import trials

SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
COMMANDS = {
    "reproduce": (*SMALL, "--threads", "2"),
    "grid": (*SMALL, "--vary", "scanner.noise=0.001,0.002,0.003,0.004", "--jobs", "2"),
    "benchmark": ("--controllers", "linear", "lqr", "--references", "circle", "--seeds", "0", "1", "--jobs", "2"),
    "coverage": (*SMALL, "--repeats", "20", "--run-repeats", "4", "--grids", "2", "--threads", "2"),
    "track": (),
}
KEPT = {benchmark.PARTS, grid.PARTS, trials.FILE}  # in OUT, with which an interrupted command resumes
PROGRESS = re.compile(r"(?!trackslip).+: [\d.]+(/[\d.]+)? \w+.*")
LONGEST = 5.0  # until an interrupted command has ended [s]
STARTED = 1.0  # until when Python may not have got as far as our first lines on a busy machine [s]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(("number", "send"), [(signal.SIGINT, os.killpg), (signal.SIGTERM, os.kill)])
def test_an_interrupted_command_ends_at_once_and_leaves_nothing(command, number, send, tmp_path):
    after = random.Random(f"{command} {number}").uniform(0.1, 3.0)
    environment = {**os.environ, "TMPDIR": str(tmp_path / "tmp"), "PYTHONPATH": str(Path(__file__).parents[2])}
    (tmp_path / "tmp").mkdir()
    whole = [sys.executable, "-m", "experiments", command, *COMMANDS[command], "--out", str(tmp_path / "out")]
    with subprocess.Popen(
        whole, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        time.sleep(after)
        if process.poll() is None:
            send(process.pid, number)
        try:
            said = process.communicate(timeout=LONGEST)[1]
        finally:
            left = processes_of(process.pid, time.monotonic() + LONGEST)
            if left:
                os.killpg(process.pid, signal.SIGKILL)
    assert left == []
    if process.returncode == -number and after < STARTED:
        return
    lines = [re.sub(" with .*", "", line) for line in said.splitlines() if not PROGRESS.fullmatch(line)]
    assert (process.returncode, lines) in ((0, []), (130, ["trackslip: interrupted"]))
    assert unfinished(tmp_path / "out", tmp_path / "tmp") == []


def processes_of(group, until):
    """The processes of a group that don't end until then."""
    while True:
        listed = subprocess.run(["ps", "-A", "-o", "pgid=,stat=,args="], capture_output=True, text=True, check=True)
        rows = [line.split(maxsplit=2) for line in listed.stdout.splitlines()]
        there = [" ".join(row) for row in rows if row[0] == str(group) and not row[1].startswith("Z")]
        if not there or time.monotonic() > until:
            return there
        time.sleep(0.05)


def unfinished(out, temporary):
    """Files that an interrupted command has left and shouldn't have."""
    files = [*temporary.iterdir(), *(out.iterdir() if out.exists() else ())]
    if (out / "manifest.json").exists():  # it had just ended
        return [file for file in files if file.name.startswith(".")]
    parts = [file for file in files if file.name in KEPT]
    drafts = [draft for part in parts for draft in part.glob(".*")]
    empty = [out] if out.exists() and not parts else []
    return [file for file in (*files, *drafts, *empty) if file not in parts]
