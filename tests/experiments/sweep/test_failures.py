"""Runs that fail, among others and alone."""

import pyarrow.parquet as pq
from sweeps import SHORT, SWEEP, fragile, logs

from experiments.driving.grid_runs import drive_cells
from trackslip.errors import RunFailedError
from trackslip.logs.logfile import read_runs


def tips_over(cells, worlds, *rest):
    """A fleet that fails if there is a wide radius in it."""
    logs = drive_cells(cells, worlds, *rest)
    wide = [log for log in logs if log.metadata["radius"] == 1.5]
    if wide:
        error = RunFailedError(f"run {wide[0].run!r}: the robot tips over")
        error.logs = logs
        raise error
    return logs


def test_failed_runs_are_rows_and_are_driven_again(trackslip, monkeypatch):
    """On a slope steeper than its friction angle a robot can't be parked."""
    arguments = ("grid", *SHORT, "--vary", "slope=0,0.9")
    result = trackslip(*arguments)
    rows = pq.read_table(result.folder / "table.parquet").to_pylist()
    assert [row["error"] is None for row in rows] == [True, True, False, False]
    assert rows[2]["error"].startswith("slope = 0.9: must be less than the friction angle")
    assert rows[2]["slip_l"] is None
    assert len(logs(result.folder)) == 2
    assert [failure["run"] for failure in result.summary["failures"]] == [row["run"] for row in rows[2:]]
    assert "failed: radius=0.6 speed=0.2 slope=0.9: slope = 0.9" in result.printed
    again = trackslip(*arguments)
    assert again.summary["timing"]["taken"] == 2
    assert pq.read_table(result.folder / "table.parquet").to_pylist() == rows


def test_a_radius_too_tight_for_some_robots_is_a_run_that_fails(trackslip):
    result = trackslip("grid", *SHORT[3:], "--radii", "0.25", "1", "--vary", "robot.half_gauge=0.168,0.3")
    failures = [(failure["run"], failure["error"]) for failure in result.summary["failures"]]
    why = "radii = 0.25: must be greater than the half gauge, 0.3 m: else the inner track must stand or reverse"
    assert failures == [("radius=0.25 speed=0.2 robot.half_gauge=0.3", why)]


def test_a_failing_run_does_not_take_its_fleet_with_it(trackslip, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("experiments.sweep.drive.drive_cells", fragile)
        result = trackslip("grid", *SWEEP)
    assert {row["error"] for row in result.summary["runs"]} == {None, "MemoryError: too wide"}
    assert len(logs(result.folder)) == 4
    assert len(logs(trackslip("grid", *SWEEP).folder)) == 8


def test_a_run_that_fails_leaves_a_recording(trackslip, monkeypatch):
    monkeypatch.setattr("experiments.sweep.drive.drive_cells", tips_over)
    result = trackslip("grid", *SHORT, "--rrd")
    assert [log.metadata["radius"] for log in read_runs(result.folder / "runs.parquet")] == [0.6]
    assert {path.name for path in (result.folder / "recordings").iterdir()} == {
        "radius=0.6_speed=0.2.rrd",
        "radius=1.5_speed=0.2.rrd",
    }
