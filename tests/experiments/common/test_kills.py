"""Commands that are killed or terminated at each of their file operations lose nothing."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from trackslip.replacement import DRAFT, LOCK, MOVING

ROOT = Path(__file__).parents[3]
# counts the file operations of a command and, at one of them, sends a signal to itself
STOPPING = """
import os, sys, threading
from pathlib import Path

out, operation, number, log, *arguments = sys.argv[1:]
begun = []

def stopping(name):
    real = getattr(os, name)
    def do(path, *rest, **options):
        if threading.current_thread() is threading.main_thread() and out in str(path):
            begun.append(name)
            Path(log).write_text(str(len(begun)))
            if len(begun) == int(operation):
                os.kill(os.getpid(), int(number))
        return real(path, *rest, **options)
    return do

for name in ("mkdir", "rename", "replace", "unlink", "rmdir"):
    setattr(os, name, stopping(name))
sys.argv = ["trackslip", *arguments]
from experiments.__main__ import main
main()
"""
GRID = ("grid", "--radii", "0.6", "--speeds", "0.2", "--duration", "4", "--executor", "inline")
BENCHMARK = (
    *("benchmark", "--controllers", "linear", "--compensations", "none", "--grounds", "stone"),
    *("--references", "circle", "--seeds", "0", "--localization", "truth", "--jobs", "1"),
)
TUNE = (
    *("tune", "linear", "--compensations", "none", "--seeds", "100", "--evaluations", "12"),
    *("--threads", "1"),
)
COMMANDS = {
    "grid": (*GRID, "--vary", "scanner.noise=0.001,0.002,0.003"),
    "benchmark": BENCHMARK,
    "tune": TUNE,
}


def start(arguments, out, operation=0, signal=0):
    log = out.with_suffix(".operations")
    command = [sys.executable, "-c", STOPPING, str(out), str(operation), str(signal), str(log)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [*command, *arguments, "--out", str(out)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )


def numbers(out):
    """The results, without times and paths."""
    summary = json.loads((out / "summary.json").read_text())
    return {key: value for key, value in summary.items() if key not in ("timing", "stages")}


@pytest.mark.slow
@pytest.mark.parametrize("signal", [9, 15], ids=["SIGKILL", "SIGTERM"])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_stopped_at_any_file_operation_goes_on(tmp_path, name, signal):
    whole = tmp_path / "whole"
    assert start(COMMANDS[name], whole).returncode == 0
    count = int(whole.with_suffix(".operations").read_text())
    assert count >= 8
    for operation in range(1, count + 1):
        out = tmp_path / f"stopped_{operation}"
        stopped = start(COMMANDS[name], out, operation, signal)
        assert stopped.returncode in ((-9,) if signal == 9 else (130, 0)), stopped.stderr
        assert "Traceback" not in stopped.stderr
        again = start(COMMANDS[name], out)
        done = "contains results; --overwrite" in again.stderr
        assert again.returncode == (2 if done else 0), again.stderr
        assert numbers(out) == numbers(whole)
        assert not {DRAFT, MOVING, LOCK, ".runs"} & {path.name for path in out.iterdir()}
