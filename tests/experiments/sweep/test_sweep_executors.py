"""The same grid wherever it is driven: on processes that are killed, on a cluster."""

import json
import os
import random
import signal
import subprocess
import sys
import time

import pytest
from sweeps import SHORT

from experiments.commands.grid import PARTS


def killed_and_resumed(arguments, out, kills, rng):
    """Run a command in a process of its own, kill it: first when a part is there, then at random; and let it end."""
    command = [sys.executable, "-m", "experiments", *arguments, "--out", str(out)]
    for kill in range(kills):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if kill:
            time.sleep(rng.uniform(0.5, 6.0))
        while not kill and not list((out / PARTS).glob("*.json")):
            assert process.poll() is None
            time.sleep(0.01)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def same_bytes(one, other):
    for name in ("runs.parquet", "table.parquet"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    assert not (other / PARTS).exists()
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (one, other)]
    assert summaries[0]["runs"] == summaries[1]["runs"]


def test_two_processes_killed_and_resumed(trackslip, tmp_path):
    arguments = ("grid", *SHORT[:-1], "processes", "--jobs", "2", "--vary", "scanner.noise=0.001,0.002,0.003,0.004")
    inline = ("grid", *SHORT, *arguments[-2:])
    whole = trackslip(*inline, "--out", str(tmp_path / "whole")).folder
    killed_and_resumed(arguments, tmp_path / "killed", 1, random.Random(0))
    same_bytes(whole, tmp_path / "killed")


@pytest.mark.slow
def test_a_thousand_runs_killed_ten_times(tmp_path):
    """A minute a kill, about."""
    arguments = (
        "grid",
        "--duration",
        "8",
        "--jobs",
        "2",
        "--vary",
        f"friction_ratio={','.join(str(1 + k / 40) for k in range(40))}",
    )
    killed_and_resumed(arguments, tmp_path / "killed", 10, random.Random(1))
    killed_and_resumed(arguments, tmp_path / "whole", 0, random.Random(1))
    same_bytes(tmp_path / "whole", tmp_path / "killed")


def test_a_dask_cluster_gives_the_same(trackslip, tmp_path):
    distributed = pytest.importorskip("distributed")
    arguments = ("grid", *SHORT[:-2], "--vary", "scanner.noise=0.001,0.002")
    whole = trackslip(*arguments, "--executor", "inline", "--out", str(tmp_path / "whole")).folder
    with distributed.LocalCluster(
        1, processes=False, threads_per_worker=1, dashboard_address="127.0.0.1:0", protocol="tcp"
    ) as cluster:
        address = cluster.scheduler_address
        result = trackslip(
            *arguments, "--executor", f"dask://{address.removeprefix('tcp://')}", "--out", str(tmp_path / "dask")
        )
    same_bytes(whole, result.folder)


def test_no_scheduler(refused, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("experiments.parallel._CONNECT_TIMEOUT", 1)
    assert "no scheduler answers there" in refused("grid", *SHORT[:-2], "--executor", "dask://127.0.0.1:1")
