"""Commands that are killed or terminated at each of their file operations lose nothing."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
COMMANDS = {
    "grid": "--radii 0.6 --speeds 0.2 --duration 4 --executor inline "
    "--vary scanner.noise=0.001,0.002,0.003",
    "benchmark": "--controllers linear --compensations none --references circle --grounds stone "
    "--seeds 0 --localization truth --jobs 1",
    "tune": "linear --compensations none --evaluations 12 --threads 1 --localization truth",
    "train": "--robots 4 --horizon 32 --batch 64 --epochs 1 --network 8 --references slalom "
    "--steps 256 --threads 1",
}


@pytest.mark.slow
@pytest.mark.parametrize("signal", [9, 15], ids=["SIGKILL", "SIGTERM"])
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_stopped_at_any_file_operation_goes_on(command, signal):
    if command == "train":
        pytest.importorskip("stable_baselines3")
    script = ROOT / "tests" / "helpers" / "kills.py"
    done = subprocess.run(
        [sys.executable, str(script), str(signal), command, *COMMANDS[command].split()],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["operations"] >= 8
    assert result["failures"] == {}
