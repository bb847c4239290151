"""Damaged and hostile files of all kinds are read or refused: no traceback, crash, hang or glut."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


COUNT = 10_000


@pytest.mark.slow
def test_mutants_are_read_or_refused(tmp_path):
    command = [sys.executable, str(ROOT / "tests" / "helpers" / "file_mutants.py"), str(COUNT)]
    done = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    *_, counts, _ = done.stdout.splitlines()
    assert json.loads(counts) == {"mutants": COUNT, "failures": {}}, done.stdout
