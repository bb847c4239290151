"""The same grid wherever it is driven: on processes that are killed, on a cluster."""

import json
import subprocess
import sys
import time

import pytest
from sweeps import SHORT

from experiments.commands.grid import PARTS


def test_two_processes_killed_and_resumed(trackslip, tmp_path):
    vary = ("--vary", "scanner.noise=0.001,0.002,0.003,0.004")
    whole = trackslip("grid", *SHORT, *vary, "--out", str(tmp_path / "whole")).folder
    out = tmp_path / "killed"
    arguments = ("grid", *SHORT[:-1], "processes", "--jobs", "2", *vary, "--out", str(out))
    command = [sys.executable, "-m", "experiments", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not list((out / PARTS).glob("*.json")):
        assert process.poll() is None
        time.sleep(0.01)
    process.kill()
    process.wait()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    same_bytes(whole, out)


def same_bytes(one, other):
    for name in ("runs.parquet", "table.parquet"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    assert not (other / PARTS).exists()
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (one, other)]
    assert summaries[0]["runs"] == summaries[1]["runs"]


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
