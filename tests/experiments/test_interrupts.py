"""Ctrl-C and SIGTERM at any moment of a command: it ends at once, and leaves no process and no half of a file."""

import os
import random
import re
import signal
import subprocess
import sys
import tempfile
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
_PROGRESS = re.compile(r".+: [\d.]+(/[\d.]+)? \w+.*")
_SECONDS = 5.0  # within which an interrupted command ends
_EARLIEST = 0.1  # after the start of Python, which must have got as far as the command line's first lines [s]
_NOT_YET = 1.0  # until when Python may not have got there on a busy machine [s]


def started(command, folder):
    environment = {**os.environ, "TMPDIR": str(folder / "tmp"), "PYTHONPATH": str(Path(__file__).parents[2])}
    (folder / "tmp").mkdir()
    return subprocess.Popen(
        [sys.executable, "-m", "experiments", command, *COMMANDS[command], "--out", str(folder / "out")],
        env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )  # fmt: skip


def interrupted(command, after, number, group, folder):
    """Start a command, interrupt it, and return what is wrong with its end, line by line."""
    wrong = []
    with started(command, folder) as process:
        time.sleep(after)
        ended = process.poll() is not None
        began = time.monotonic()
        if not ended:
            (os.killpg if group else os.kill)(process.pid, number)
        try:
            said = process.communicate(timeout=_SECONDS)[1]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return [f"hangs; it said {process.communicate()[1]!r}"]
        wrong += [f"left {line}" for line in left_of(process.pid, began + _SECONDS)]
    if process.returncode == -number and after < _NOT_YET:
        return wrong
    lines = [line for line in said.splitlines() if not _PROGRESS.fullmatch(line) or line.startswith("trackslip")]
    expected = [] if process.returncode == 0 else ["trackslip: interrupted"]
    if process.returncode not in (0, 130) or [re.sub(" with .*", "", line) for line in lines] != expected:
        wrong.append(f"code {process.returncode}, said {said!r}")
    return wrong + unfinished(folder)


def left_of(group, until):
    """The processes of a group that don't end until then."""
    while True:
        listed = subprocess.run(["ps", "-A", "-o", "pgid=,stat=,args="], capture_output=True, text=True, check=True)
        rows = [line.split(maxsplit=2) for line in listed.stdout.splitlines()]
        there = [" ".join(row) for row in rows if row[0] == str(group) and not row[1].startswith("Z")]
        if not there or time.monotonic() > until:
            return there
        time.sleep(0.05)


def unfinished(folder):
    """What an interrupted command has left and shouldn't have."""
    out = folder / "out"
    files = [*(folder / "tmp").iterdir(), *(out.iterdir() if out.exists() else ())]
    if (out / "manifest.json").exists():  # it had just ended
        return [f"left {file}" for file in files if file.name.startswith(".")]
    parts = [file for file in files if file.name in KEPT]
    drafts = [draft for part in parts for draft in part.glob(".*")]
    empty = [out] if out.exists() and not parts else []
    return [f"left {file}" for file in (*files, *drafts, *empty) if file not in parts]


def check(seed, each, seconds):
    """Interrupt every command so often, within its `seconds`; nothing must be wrong."""
    rng, wrong = random.Random(seed), []
    for command, most in seconds.items():
        for k in range(each):
            after, group = rng.uniform(_EARLIEST, most), rng.random() < 0.5
            number = rng.choice([signal.SIGINT, signal.SIGTERM])
            with tempfile.TemporaryDirectory() as folder:
                found = interrupted(command, after, number, group, Path(folder))
            who = "group" if group else "process"
            wrong += [f"{command} {k}, {number.name} to the {who} after {after:.3f} s: {line}" for line in found]
    assert not wrong, "\n".join(wrong)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_interrupted_commands_end_at_once_and_leave_nothing():
    check(0, each=2, seconds=dict.fromkeys(COMMANDS, 3.0))
