import pytest

from experiments.options.grid import SweepConfig
from experiments.speed.grid import SENSING, GridSpeed, bare_seconds
from experiments.sweep.plan import plan
from experiments.sweep.summary import Timing


def test_what_is_written(trackslip):
    result = trackslip("bench", "--grid", "--grid-runs", "25", "--grid-duration", "4", "--thread-counts", "1")
    (only,) = result.summary["rows"]
    assert (only["processes"], only["runs"]) == (1, 25)
    assert set(SENSING) | {"physics", "storing", "gathering"} <= set(only["stages"])
    assert 0 < sum(only["stages"].values()) <= only["wall_s"]
    assert only["bare_s"] > 0
    assert "Seconds of work by stage" in result.printed


def test_what_the_bare_engine_does_not_do_is_left_out():
    stages = {"physics": 10.0, "scans": 1.0, "localization": 4.0, "slips": 2.0, "storing": 1.0}
    timing = Timing(simulated_s=8000.0, driving_s=9.0, stages=stages, driven=1000, taken=0, wall_s=10.0)
    assert GridSpeed.of(2, 1000, timing, 5.0).ratio_to_bare == pytest.approx((10.0 - 3.5) / 5.0)


def test_bare_time_is_that_of_all_runs(monkeypatch):
    """Of more runs than are stepped at once, each that is stands for several."""
    runs = plan(SweepConfig(radii=(1.0, 1.2, 1.4, 1.6, 1.8), speeds=(0.1,), duration=4.0))
    monkeypatch.setattr("experiments.speed.grid._MAX_BARE_ROBOTS", 4)
    monkeypatch.setattr("experiments.speed.grid.perf_counter", iter((0.0, 2.4)).__next__)
    assert bare_seconds(runs, 1) == pytest.approx(3.0)
