"""Drawbar tests of a grid: what is measured on soft soil, beside theory."""

from dataclasses import asdict

import numpy as np
import pyarrow.parquet
import pytest

from experiments.cli import parse
from experiments.common.run_table import SOIL_COLUMNS
from experiments.grid.drawbar import drawbar_charts, drawbar_tests, soil_columns
from experiments.grid.plan import plan
from sim import Fleet, Ground, RobotParameters, load_robot, open_loop
from sim.runs.run_recorder import SINKING, Sinking
from trackslip.logs.runlog import RunLog, Truth

STRAIGHT = ("--ground", "dry_sand", "--radii", "1000", "--speeds", "0.12")
PULLS = (0.0, 40.0, 90.0)


@pytest.fixture(scope="module")
def planned():
    arguments = ("--pull.since", "1", "--vary", "pull.force=0,40,172")
    return plan(parse(["grid", *STRAIGHT, *arguments]))


def row(run, slip, sinkage, *, immobilised=False, slip_grows=False):
    return {
        "run": run.name,
        "error": None,
        "drawbar_slip": slip,
        "sinkage": sinkage,
        "resistance": None if immobilised else 2.0,
        "efficiency": None if immobilised else 0.8,
        "slip_grows": slip_grows,
        "immobilised": immobilised,
    }


def rows_of(planned):
    free, pulled, stuck = planned
    return [
        row(free, 0.001, 0.005),
        row(pulled, 0.037, 0.0068, slip_grows=True),
        row(stuck, 1.01, 0.05, immobilised=True),
    ]


def test_a_table_has_theory_at_the_same_pull(planned):
    (test,) = drawbar_tests(planned, rows_of(planned))
    free, pulled, stuck = test.table().texts
    assert pulled[:6] == ["40.0", "0.163", "0.037", "0.037", "6.8", "6.8"]
    rising = slice(test.curve.most + 1)
    efficiency = np.interp(40.0, test.curve.pull[rising], test.curve.efficiency[rising])
    assert pulled[8:10] == ["0.80", f"{efficiency:.2f}"]
    assert pulled[-1] == "slip still grows"
    assert stuck[-1] == "immobilised"
    assert stuck[3] == "-"  # theory has no slip that suffices
    assert free[-1] == ""
    assert test.answer == ("largest pull / weight", "0.163 driven; 0.635 by theory")


def test_charts_mark_immobilised_runs_at_slip_1(planned):
    tests = drawbar_tests(planned, rows_of(planned))
    pull, efficiency, sinkage, resistance = drawbar_charts(tests)
    by_label = {curve.label: curve for curve in pull.curves}
    assert set(by_label) == {"theory", "measured", "slip still grows", "immobilised"}
    np.testing.assert_allclose(by_label["immobilised"].x, [1.0])
    np.testing.assert_allclose(by_label["slip still grows"].y, [40 / (25 * 9.81)])
    assert {chart.title for chart in (efficiency, sinkage, resistance)} == {
        "Tractive efficiency",
        "Sinkage",
        "Resistance",
    }


def test_turns_slopes_and_firm_ground_are_no_drawbar_tests():
    for options in (
        ("--ground", "dry_sand", "--radii", "1", "--speeds", "0.1"),
        (*STRAIGHT, "--ground.slope", "0.1"),
        ("--ground", "stone", "--radii", "1000", "--speeds", "0.1"),
    ):
        (run,) = plan(parse(["grid", *options]))
        assert drawbar_tests([run], [row(run, 0.01, 0.005)]) == []


def test_soils_are_tests_of_their_own():
    grounds = ("--grounds", "regolith", "dry_sand", "--vary", "pull.force=20,0")
    runs = plan(parse(["grid", *grounds, "--radii", "1000", "--speeds", "0.1"]))
    tests = drawbar_tests(runs, [row(run, 0.01, 0.005) for run in runs])
    assert [test.label for test in tests] == ["ground=dry_sand", "ground=regolith"]
    assert all(test.pull.tolist() == [0.0, 20.0] for test in tests)


def test_runs_on_firm_ground_have_no_columns_of_soil():
    fleet = Fleet(load_robot(RobotParameters()), np.zeros((1, 3)), Ground())
    (log,) = open_loop(fleet, [2.0, 2.0], 1.0)
    assert soil_columns(log) == {}


TIME = np.arange(31) * 0.1
LATE = TIME >= 1.999  # of 3 s


def drawbar_log(belts=0.2, speed=0.18, slip=0.1):
    """A run with a pull of 20 N on soft soil, whose last third has these speeds [m/s]."""
    radius = 0.06 * 1.01
    by_row = LATE[:, None]
    truth = Truth(
        pose=np.zeros((31, 3)),
        twist=np.where(by_row, [speed, 0.0, 0.0], [0.05, 0.0, 0.1]),
        sinkage=np.where(by_row, [0.01, 0.02], 0.5),
        resistance=np.where(by_row, [-3.0, -4.0], -100.0),
        traction=np.where(by_row, [10.0, 12.0], 500.0),
    )
    metadata = {
        "geometry": {"half_gauge": 0.168, "sprocket_radius": 0.06},
        "radius_error": 0.01,
        "pull": {"force": 20.0},
        SINKING: asdict(Sinking(sinkage=0.015, resistance=7.0, pitch=0.0, slip=slip)),
    }
    omega = np.where(by_row, belts / radius, [9.0, 11.0])
    return RunLog("by hand", TIME, omega, truth.pose, truth=truth, metadata=metadata)


def test_soil_is_measured_over_the_last_third():
    assert soil_columns(drawbar_log()) == {
        "sinkage": pytest.approx(0.015),
        "resistance": pytest.approx(3 + 4),
        "drawbar_slip": pytest.approx(1 - 0.18 / 0.2),
        "efficiency": pytest.approx(20 * 0.18 / ((10 + 12) * 0.2)),  # power out over power in
        "slip_grows": False,
        "immobilised": False,
    }


@pytest.mark.parametrize(("loss", "grows"), [(0.001, False), (0.003, True)])
def test_a_slip_that_grows_by_a_hundredth_is_told(loss, grows):
    """Between the halves of the last third, where the belts run at 0.2 m/s."""
    last = np.flatnonzero(LATE)[5:]
    log = drawbar_log()
    log.truth.twist[last, 0] -= loss
    row = soil_columns(log)
    assert row["slip_grows"] == grows


def test_robots_that_dig_or_rest_have_no_efficiency():
    digging = soil_columns(drawbar_log(speed=0.0, slip=1.0))
    assert digging["immobilised"]
    assert digging["drawbar_slip"] == 1.0
    resting = soil_columns(drawbar_log(belts=0.0, speed=0.0))
    assert not resting["immobilised"]
    assert resting["drawbar_slip"] is None
    for row in (digging, resting):
        assert row["sinkage"] == pytest.approx(0.015)
        assert row["resistance"] is None
        assert row["efficiency"] is None


@pytest.mark.slow
def test_a_grid_measures_what_theory_predicts(trackslip):
    forces = ",".join(map(str, PULLS))
    pulls = ("--pull.since", "1", "--vary", f"pull.force={forces}")
    options = (*pulls, "--duration", "16", "--jobs", "1")
    result = trackslip("grid", *STRAIGHT, *options)
    table = pyarrow.parquet.read_table(result.folder / "table.parquet")
    assert set(SOIL_COLUMNS) <= set(table.column_names)
    (test,) = result.summary["drawbar"]
    theory = test["theory"]
    slip = np.array(test["drawbar_slip"])[1:]  # without a pull, it is below theory's first, 0.005

    def expected(name):
        return np.interp(slip, theory["slip"], theory[name])

    def measured(name):
        return np.array(test[name])[1:]

    weight = test["weight"]
    np.testing.assert_allclose(expected("pull") / weight, measured("pull") / weight, atol=0.002)
    np.testing.assert_allclose(measured("sinkage"), expected("sinkage"), rtol=0.01)
    np.testing.assert_allclose(measured("resistance"), expected("resistance"), rtol=0.02)
    np.testing.assert_allclose(measured("efficiency"), expected("efficiency"), atol=0.01)
    assert "Drawbar tests: last third of each run" in result.printed
