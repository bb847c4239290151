"""A grid on MPI ranks leaves the same bytes as one in this process."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

GRID = ("grid", "--radii", "0.6", "1.5", "--speeds", "0.2", "--duration", "4", "--vary", "scanner.noise=0.001,0.002")


@pytest.fixture(scope="module")
def mpiexec():
    """The launcher that belongs to this Python, or the system's; MPI needs one and mpi4py."""
    if importlib.util.find_spec("mpi4py") is None:
        pytest.skip("mpi4py isn't installed (extra `mpi`)")
    launcher = shutil.which("mpiexec", path=os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"])))
    if launcher is None:
        pytest.skip("there is no mpiexec: install an MPI library")
    return launcher


def test_two_ranks_give_the_same_bytes(trackslip, tmp_path, mpiexec):
    whole = trackslip(*GRID, "--executor", "inline", "--out", str(tmp_path / "whole")).folder
    command = [mpiexec, "-n", "2", sys.executable, "-m", "mpi4py.futures", "-m", "experiments", *GRID]
    done = subprocess.run(
        [*command, "--executor", "mpi", "--out", str(tmp_path / "ranks")], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    for name in ("runs.parquet", "table.parquet"):
        assert (tmp_path / "ranks" / name).read_bytes() == (whole / name).read_bytes(), name
