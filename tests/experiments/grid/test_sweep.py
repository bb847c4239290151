import contextlib
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from experiments.cli import main
from experiments.common import sweep
from experiments.common.run_table import chosen
from experiments.common.sweep import Store
from experiments.simulate.grid_runs import drive_cells
from trackslip.errors import LogError, OutputError
from trackslip.logs.logfile import read_runs
from trackslip.replacement import STORE

SHORT = ("--radii", "0.6", "1.5", "--speeds", "0.2", "--duration", "4", "--executor", "inline")
ONE = ("--radii", "0.6", *SHORT[3:])
VARY = ("--vary", "scanner.noise=0.001,0.002,0.003")
SWEEP = (*SHORT, "--vary", "friction_ratio=1.0,1.2", "--seeds", "0", "1")


def logs(folder):
    return {log.metadata["id"]: log for log in read_runs(folder / "runs.parquet")}


def fragile(cells, *rest):
    if any(cell.radius == 1.5 for cell in cells):
        raise MemoryError("too wide")
    return drive_cells(cells, *rest)


def test_every_combination_is_a_run_with_a_row(trackslip):
    result = trackslip("grid", *ONE, *SWEEP[-5:], "--grounds", "stone", "ice")
    rows = pq.read_table(result.folder / "table.parquet").to_pylist()
    stored = logs(result.folder)
    assert len(rows) == len(stored) == 8
    assert len({row["id"] for row in rows}) == len({row["run"] for row in rows}) == 8
    for row in rows:
        log = stored[row["id"]]
        assert log.run == row["run"]
        ground = log.metadata["ground"]
        along = {"stone": 0.7, "ice": 0.12}[row["ground"]]
        assert ground["along"] == along
        assert ground["across"] == pytest.approx(row["friction_ratio"] * along)
        assert log.metadata["seed"] == row["seed"]
        assert log.metadata["radius"] == row["radius"]
        assert row["slip_l"] == pytest.approx(row["true_slip_l"], abs=0.01)
        assert row["omega_r"] == pytest.approx(log.omega[-20:, 1].mean(), rel=1e-3)
    assert [grid["runs"] for grid in result.summary["grids"]] == [1] * 8
    assert "8 runs in 8 grids" in result.printed
    schema = pq.read_schema(result.folder / "table.parquet")
    for field in schema:
        assert set(field.metadata) == {b"unit", b"description"}, field.name
        assert field.metadata[b"description"], field.name


def test_runs_keep_their_ids_and_bits_when_others_come(trackslip, tmp_path):
    small = ("grid", *SHORT, "--vary", "slope=0.05", "--out", str(tmp_path / "few"))
    few = logs(trackslip(*small).folder)
    varied = ("--seeds", "3", "0", "--vary", "slope=0,0.05", "drive.lag=0.05,0.08")
    more = logs(trackslip("grid", *SHORT, *varied).folder)
    assert set(few) < set(more)
    for key, log in few.items():
        np.testing.assert_array_equal(log.pose, more[key].pose)
        np.testing.assert_array_equal(log.truth.pose, more[key].truth.pose)
    noise = [log.pose[:, :2] - log.truth.pose[:, :2] for log in more.values()]
    assert len({part.tobytes() for part in noise}) == len(more)


def test_methods_are_compared_on_the_same_scans(trackslip, tmp_path):
    found = []
    for k, options in enumerate(
        ((), ("--motion", "arc"), ("--localization", "line"), ("--seed", "1"))
    ):
        folder = trackslip("grid", *ONE, *options, "--out", str(tmp_path / str(k))).folder
        found += read_runs(folder / "runs.parquet")
    usual, *same, other = (log.scans.cluster.range for log in found)
    for ranges in same:
        np.testing.assert_array_equal(ranges, usual)
    assert not np.array_equal(other, usual)
    assert len({log.metadata["id"] for log in found}) == 4


@pytest.mark.slow
def test_a_law_is_identified_from_runs_of_one_setting(trackslip, refused):
    small = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
    small += ("--executor", "inline")
    varied = ("--vary", "friction_ratio=1.0,1.2", "--seeds", "0", "1")
    folder = str(trackslip("grid", *small, *varied).folder)
    assert "its runs differ in ground (across): choose with --where" in refused("identify", folder)
    unknown = refused("identify", folder, "--where", "colour=red")
    assert "must be NAME=VALUE with one of seed, friction_ratio, " in unknown
    missing = refused("identify", folder, "--where", "friction_ratio=1.1")
    assert "must be friction_ratio=one of 1.0, 1.2" in missing
    found = trackslip("identify", folder, "--where", "friction_ratio=1.2", "seed=1")
    assert found.summary["samples"] == 4
    # 40 % more friction across doubles it
    assert found.summary["slip_laws"]["icr"]["values"]["offset"] > 0.05
    assert len(chosen(Path(folder), ["friction_ratio=1", "radius=0.6"])) == 4


def test_an_empty_run_in_a_sweeps_table_is_one_line(tmp_path):
    table = pa.table({"run": ["a", None], "id": ["1", "2"], "seed": [0, 1]})
    pq.write_table(table, tmp_path / "table.parquet")
    with pytest.raises(LogError, match=r"table\.parquet: column run: empty in a chosen row$"):
        chosen(tmp_path, ["seed=1"])
    assert chosen(tmp_path, ["seed=0"]) == {"a"}


@pytest.mark.parametrize("where", ["speed=0.1", "speed=.10", "speed=1e-1"])
def test_runs_are_chosen_by_number_however_it_is_written(tmp_path, where):
    table = pa.table({"run": ["a", "b"], "speed": [0.1, 0.2]})
    pq.write_table(table, tmp_path / "table.parquet")
    assert chosen(tmp_path, [where]) == {"a"}


def same_results(whole, resumed):
    for name in ("runs.parquet", "table.parquet"):
        assert (whole / name).read_bytes() == (resumed / name).read_bytes(), name
    assert not (resumed / STORE).exists()


def test_an_interrupted_grid_goes_on(trackslip, tmp_path, monkeypatch, capsys):
    arguments = ("grid", *SHORT, *VARY)
    whole = trackslip(*arguments, "--out", str(tmp_path / "whole")).folder
    real = sweep.drive_fleet
    driven = []

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
    assert (
        "interrupted with 4 of 6 runs driven; the same command resumes" in capsys.readouterr().err
    )
    cut = min((tmp_path / "part" / STORE).glob("*.json"))
    cut.write_text(cut.read_text()[:50])  # by a disk that was full
    result = trackslip(*arguments, "--out", str(tmp_path / "part"))
    assert result.summary["timing"]["resumed"] == 2
    same_results(whole, result.folder)


def test_a_store_keeps_the_runs_of_the_same_grid(tmp_path):
    out = tmp_path / "out"
    Store(out, {"id"}, anew=True).keep([{"id": "id", "run": "a", "error": None}])
    assert Store(out, {"id"}, anew=False).rows.keys() == {"id"}
    assert not Store(out, {"id"}, anew=True).rows
    with pytest.raises(OutputError, match="contains 1 run of other options"):
        Store(out, {"other"}, anew=False)


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
        command = [
            sys.executable,
            "-m",
            "experiments",
            *arguments,
            "--executor",
            f"dask://{address}",
        ]
        driving = subprocess.Popen(
            [*command, "--out", str(tmp_path / "dask")], stdout=subprocess.DEVNULL
        )
        while not list((tmp_path / "dask" / STORE).glob("*.json")):
            assert driving.poll() is None
            time.sleep(0.01)
        cluster.workers[0].process.process.kill()
        assert driving.wait(timeout=120) == 0
    same_results(whole, tmp_path / "dask")


@contextlib.contextmanager
def dask(*arguments):
    """A process of Dask, and the lines that it logs."""
    command = [sys.executable, "-m", "dask", *arguments]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@contextlib.contextmanager
def driving_on_dask(out, *options):
    """A scheduler, its only worker, and a grid that drives there, with runs stored."""
    pytest.importorskip("distributed")
    local = ("--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0")
    with dask("scheduler", *local) as scheduler:
        line = next(line for line in scheduler.stderr if "Scheduler at:" in line)
        address = line.split()[-1]
        single = ("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
        with dask(*single) as worker:
            where = ("--executor", address.replace("tcp", "dask"), "--out", str(out))
            noises = ",".join(str(0.001 * k) for k in range(1, 60))
            grid = ("grid", *SHORT[:-2], "--vary", f"scanner.noise={noises}", *where, *options)
            command = [sys.executable, "-m", "experiments", *grid]
            with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as driving:
                while not list((out / STORE).glob("*.json")):
                    assert driving.poll() is None
                    time.sleep(0.01)
                try:
                    yield driving, worker, scheduler, single
                finally:
                    driving.kill()


@pytest.mark.slow
def test_a_cluster_whose_workers_have_all_died(tmp_path):
    with driving_on_dask(tmp_path / "out") as (driving, worker, _, _):
        worker.kill()
        message = driving.communicate(timeout=10)[1]
    assert driving.returncode == 2
    assert re.fullmatch(
        r"trackslip: dask://\S+: all workers have died with \d+ of \d+ runs driven; "
        "the same command resumes\n",
        message,
    )


@pytest.mark.slow
def test_other_workers_are_waited_for_on_request(tmp_path):
    with driving_on_dask(tmp_path / "out", "--wait") as (driving, worker, _, single):
        worker.kill()
        line = driving.stderr.readline()
        assert line.endswith(": all workers have died; waiting for others\n")
        with dask(*single):
            assert driving.wait(timeout=120) == 0


@pytest.mark.slow
def test_a_cluster_whose_scheduler_has_died(tmp_path):
    with driving_on_dask(tmp_path / "out") as (driving, _, scheduler, _):
        scheduler.kill()
        message = driving.communicate(timeout=10)[1]
    assert driving.returncode == 2
    assert message.startswith("trackslip: the scheduler has stopped with ")
    assert message.count("\n") == 1


def test_failed_runs_are_rows_and_are_driven_again(trackslip, refused, tmp_path):
    """On a slope steeper than its friction angle a robot can't be parked."""
    arguments = ("grid", *SHORT, "--vary", "slope=0,0.9")
    result = trackslip(*arguments)
    rows = pq.read_table(result.folder / "table.parquet").to_pylist()
    assert [row["error"] is None for row in rows] == [True, True, False, False]
    assert rows[2]["error"].startswith("slope = 0.9: must be less, to park")
    assert rows[2]["slip_l"] is None
    assert len(logs(result.folder)) == 2
    assert [failure["run"] for failure in result.summary["failures"]] == [
        row["run"] for row in rows[2:]
    ]
    assert "failed: radius=0.6 speed=0.2 slope=0.9: slope = 0.9" in result.printed
    store = Store(tmp_path, set(), anew=False)
    store.keep(result.summary["runs"])
    assert len(Store(tmp_path, {row["id"] for row in rows}, anew=False).rows) == 2
    assert "all 2 runs fail" in refused("grid", *SHORT, "--vary", "slope=0.9", "--out", "all")


def test_a_failing_run_does_not_take_its_fleet_with_it(trackslip, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("experiments.grid.runs.drive_cells", fragile)
        result = trackslip("grid", *SWEEP)
    assert {row["error"] for row in result.summary["runs"]} == {None, "MemoryError: too wide"}
    assert len(logs(result.folder)) == 4


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('radius = ["0.5"]', "radius = '0.5': must be a number"),
        ("radius = true", "radius = True: must be a number"),
        ("seed = [1.5]", "seed = 1.5: must be a whole number"),
        ("radius = 1979-05-27", "radius = datetime.date(1979, 5, 27): must be a number"),
        ('drive.lag = "fast"', "drive.lag = 'fast': must be a number"),
        ('localization = ["sonar"]', "localization = 'sonar': must be one of plate, line"),
        ("motion = [3]", "motion = 3: must be one of paper, arc, bundle"),
        ("ground = []", "ground = (): must be at least one value"),
        ("wheels = [1]", "wheels is unknown; known are radius, speed, "),
        ("drive = 3", "drive is unknown; known are radius, speed, "),
        ("scanner.noise = -1", "scanner.noise = -1.0: must be a finite number >= 0"),
        ("friction_ratio = [inf]", "across = inf: must be a finite number > 0"),
        ("robot.half_gauge = [0.2, -1]", "half_gauge = -1.0: must be from 0.001 to 10 m"),
        ("ground.uphill = [1.0]", "ground.uphill = 1.0: must be left out on level ground"),
        ("pull.height = [0.3]", "pull.height = 0.3: must be left out without --pull"),
    ],
)
def test_a_mistake_in_a_sweep_file_names_the_file(refused, tmp_path, line, message):
    (tmp_path / "sweep.toml").write_text(line)
    assert f"sweep.toml: {message}" in refused("grid", "--sweep", "sweep.toml")


def test_a_sweep_over_slopes_may_have_a_level_one(trackslip):
    varied = ("slope=0,0.05", "ground.uphill=0,3.14")
    result = trackslip("grid", *ONE, "--vary", *varied)
    assert "4 runs in 4 grids" in result.printed
