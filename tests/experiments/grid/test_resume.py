"""Grids that were interrupted or killed, and runs that fail."""

import subprocess
import sys
import time

import pyarrow.parquet as pq
import pytest
from sweeps import SHORT, SWEEP, fragile, logs

from experiments.cli import main
from experiments.common import sweep
from experiments.common.sweep import STORE, Store

VARY = ("--vary", "scanner.noise=0.001,0.002,0.003,0.004")


def same_results(whole, resumed):
    for name in ("runs.parquet", "table.parquet"):
        assert (whole / name).read_bytes() == (resumed / name).read_bytes(), name
    assert not (resumed / STORE).exists()


def test_an_interrupted_grid_goes_on(trackslip, tmp_path, monkeypatch, capsys):
    arguments = ("grid", *SHORT, *VARY)
    whole = trackslip(*arguments, "--out", str(tmp_path / "whole")).folder
    real, driven = sweep.drive_fleet, []

    def twice(*arguments, **options):
        if len(driven) == 2:
            raise KeyboardInterrupt
        driven.append(1)
        return real(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(sweep, "drive_fleet", twice)
        with pytest.raises(SystemExit) as stop:
            main([*arguments, "--out", str(tmp_path / "part")])
    assert stop.value.code == 130
    assert "interrupted with 4 of 8 runs driven; the same command resumes" in capsys.readouterr().err
    cut = min((tmp_path / "part" / STORE).glob("*.json"))
    cut.write_text(cut.read_text()[:50])  # by a disk that was full
    result = trackslip(*arguments, "--out", str(tmp_path / "part"))
    assert result.summary["timing"]["resumed"] == 2
    same_results(whole, result.folder)


def test_overwrite_drives_anew(trackslip, refused, tmp_path):
    out = tmp_path / "out"
    Store(out, {"id"}, anew=True).keep([{"id": "id", "run": "a", "error": None}])
    assert Store(out, {"id"}, anew=False).rows.keys() == {"id"}
    assert not Store(out, {"id"}, anew=True).rows
    assert not Store(out, {"other"}, anew=False).rows
    trackslip("grid", *SHORT, "--out", str(out))
    assert not (out / STORE).exists()
    assert "contains results; --overwrite replaces them" in refused("grid", *SHORT, "--out", str(out))
    assert trackslip("grid", *SHORT, "--overwrite", "--out", str(out)).summary["timing"]["driven"] == 2


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_nothing(trackslip, tmp_path):
    """On a Dask cluster of two, whose other worker drives the rest."""
    distributed = pytest.importorskip("distributed")
    arguments = ("grid", *SHORT[:-2], *VARY, "--seeds", "0", "1")
    whole = trackslip(*arguments, "--executor", "inline", "--out", str(tmp_path / "whole")).folder
    with distributed.LocalCluster(
        2, processes=True, threads_per_worker=1, dashboard_address="127.0.0.1:0", protocol="tcp"
    ) as cluster:
        address = cluster.scheduler_address.removeprefix("tcp://")
        command = [sys.executable, "-m", "experiments", *arguments, "--executor", f"dask://{address}"]
        driving = subprocess.Popen([*command, "--out", str(tmp_path / "dask")], stdout=subprocess.DEVNULL)
        while not list((tmp_path / "dask" / STORE).glob("*.json")):
            assert driving.poll() is None
            time.sleep(0.01)
        cluster.workers[0].process.process.kill()
        assert driving.wait(timeout=120) == 0
    same_results(whole, tmp_path / "dask")


def test_failed_runs_are_rows_and_are_driven_again(trackslip, tmp_path):
    """On a slope steeper than its friction angle a robot can't be parked."""
    arguments = ("grid", *SHORT, "--vary", "slope=0,0.9")
    result = trackslip(*arguments)
    rows = pq.read_table(result.folder / "table.parquet").to_pylist()
    assert [row["error"] is None for row in rows] == [True, True, False, False]
    assert rows[2]["error"].startswith("slope = 0.9: must be less, to park")
    assert rows[2]["slip_l"] is None
    assert len(logs(result.folder)) == 2
    assert [failure["run"] for failure in result.summary["failures"]] == [row["run"] for row in rows[2:]]
    assert "failed: radius=0.6 speed=0.2 slope=0.9: slope = 0.9" in result.printed
    store = Store(tmp_path, set(), anew=False)
    store.keep(result.summary["runs"])
    assert len(Store(tmp_path, {row["id"] for row in rows}, anew=False).rows) == 2


def test_a_grid_whose_runs_all_fail_is_refused(refused):
    assert "all 2 runs fail" in refused("grid", *SHORT, "--vary", "slope=0.9")


def test_a_failing_run_does_not_take_its_fleet_with_it(trackslip, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("experiments.grid.runs.drive_cells", fragile)
        result = trackslip("grid", *SWEEP)
    assert {row["error"] for row in result.summary["runs"]} == {None, "MemoryError: too wide"}
    assert len(logs(result.folder)) == 4
