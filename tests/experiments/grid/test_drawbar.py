"""Drawbar tests of a grid: what is measured on soft soil, beside theory."""

import numpy as np
import pyarrow.parquet
import pytest

from experiments.cli import parse
from experiments.common.run_table import SOIL_COLUMNS
from experiments.grid.drawbar import drawbar_charts, drawbar_tests, soil_columns
from experiments.grid.plan import plan
from sim import Fleet, Ground, RobotParameters, load_robot, open_loop
from trackslip.logs.runlog import RunLog, Truth

STRAIGHT = ("--ground", "dry_sand", "--radii", "1000", "--speeds", "0.12")
GROUNDS = ("--grounds", "regolith", "dry_sand", "--vary", "pull.force=20,0")
PULLS = (0.0, 40.0, 90.0)
WEIGHT = 25 * 9.81  # of the shipped robot [N]


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
    resistance = np.interp(40.0, test.curve.pull[rising], test.curve.resistance[rising])
    assert pulled[6:8] == ["2.0", f"{resistance:.1f}"]
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
    np.testing.assert_allclose(by_label["slip still grows"].y, [40 / WEIGHT])
    titles = [chart.title for chart in (efficiency, sinkage, resistance)]
    assert titles == ["Tractive efficiency", "Sinkage", "Resistance"]


def test_charts_have_the_columns_of_the_runs_and_theory(planned):
    (test,) = drawbar_tests(planned, rows_of(planned))
    pull, efficiency, sinkage, resistance = drawbar_charts([test])
    for chart, unit, values, theory in (
        (pull, 1 / WEIGHT, [0.0, 40.0, 172.0], test.curve.pull),
        (efficiency, 1.0, [0.8, 0.8, np.nan], test.curve.efficiency),
        (sinkage, 1e3, [0.005, 0.0068, 0.05], test.curve.sinkage),
        (resistance, 1 / WEIGHT, [2.0, 2.0, np.nan], test.curve.resistance),
    ):
        by_theory, *measured = chart.curves
        np.testing.assert_allclose(by_theory.x, test.curve.slip)
        np.testing.assert_allclose(by_theory.y, np.maximum(unit * theory, 0.0))
        drawn = [curve.y.item() for curve in measured]
        np.testing.assert_allclose(drawn, unit * np.array(values))


def test_curves_of_several_tests_have_labels_and_colours():
    runs = plan(parse(["grid", *GROUNDS, "--radii", "1000", "--speeds", "0.1"]))
    tests = drawbar_tests(runs, [row(run, 0.01, 0.005) for run in runs])
    for chart in drawbar_charts(tests):
        labels = [curve.label for curve in chart.curves]
        of_sand = ["ground=dry_sand, theory", "ground=dry_sand, measured"]
        of_regolith = ["ground=regolith, theory", "ground=regolith, measured"]
        assert labels == [*of_sand, *of_regolith]
        sand, _, regolith, _ = [curve.colour for curve in chart.curves]
        assert sand != regolith
        assert sand == chart.curves[1].colour


def test_turns_slopes_stone_and_six_wheels_are_no_drawbar_tests(tmp_path):
    """Theory shares the weight among two axles, not three."""
    six_wheels = tmp_path / "rover.toml"
    six_wheels.write_text('contact = "wheels"\naxles = [-0.2, 0, 0.2]\n')
    for options in (
        (*STRAIGHT, "--robot", str(six_wheels)),
        ("--ground", "dry_sand", "--radii", "1", "--speeds", "0.1"),
        (*STRAIGHT, "--ground.slope", "0.1"),
        ("--ground", "stone", "--radii", "1000", "--speeds", "0.1"),
    ):
        (run,) = plan(parse(["grid", *options]))
        assert drawbar_tests([run], [row(run, 0.01, 0.005)]) == []


def test_soils_are_tests_of_their_own():
    runs = plan(parse(["grid", *GROUNDS, "--radii", "1000", "--speeds", "0.1"]))
    tests = drawbar_tests(runs, [row(run, 0.01, 0.005) for run in runs])
    assert [test.label for test in tests] == ["ground=dry_sand", "ground=regolith"]
    assert all(test.pull.tolist() == [0.0, 20.0] for test in tests)
    for test in tests:
        name, text = test.answer
        assert name == f"largest pull / weight, {test.label}"
        assert text.startswith(f"{20 / WEIGHT:.3f} driven; ")
        assert test.table().title.endswith(f"at the same pull; {test.label}")


def test_a_robot_that_no_pull_lets_drive_is_immobilised(planned):
    rows = [row(run, 1.0, 0.05, immobilised=True) for run in planned]
    (test,) = drawbar_tests(planned, rows)
    assert test.answer == ("largest pull / weight", "immobilised by all pulls; 0.635 by theory")


def test_runs_on_firm_ground_have_no_columns_of_soil():
    fleet = Fleet(load_robot(RobotParameters()), np.zeros((1, 3)), Ground())
    (log,) = open_loop(fleet, [2.0, 2.0], 1.0)
    assert soil_columns(log) == {}


RADIUS = 0.08  # of the sprockets, with an error of 25 % [m]
BELT = 0.2  # speed of both belts: 2 rad/s on 0.1 m [m/s]


def soil_log(slip, *, pull=40.0, turning=2.0, end_slip=0.0):
    """A straight run of 30 s, in a rut of 7 mm on the left and 9 mm on the right, against 5 and 7 N
    of compaction. Before its last third, it neither slips nor sinks.
    """
    time = np.linspace(0.0, 30.0, 301)
    is_late = time >= 20.0
    three = np.zeros((301, 3))
    speed = np.where(is_late, BELT * (1 - slip), BELT)
    twist = np.column_stack([speed, 0 * time, 0 * time])
    truth = Truth(
        pose=three,
        twist=twist,
        traction=np.where(is_late[:, None], [20.0, 32.0], 100.0),
        sinkage=np.where(is_late[:, None], [0.007, 0.009], 0.0),
        resistance=np.where(is_late[:, None], [-5.0, -7.0], 0.0),
    )
    metadata = {
        "geometry": {"sprocket_radius": RADIUS},
        "radius_error": 0.25,
        "pull": {"force": pull},
        "sinking": {"sinkage": 0.008, "resistance": 12.0, "pitch": 0.0, "slip": end_slip},
    }
    omega = np.full((301, 2), turning)
    return RunLog("a", time, omega, three, truth=truth, metadata=metadata)


def test_columns_are_means_over_the_last_third():
    """Of 52 N of traction at 0.2 m/s, 10.4 W, a pull of 40 N at 0.15 m/s takes 6 W."""
    found = soil_columns(soil_log(0.25))
    assert found == {
        "sinkage": pytest.approx(0.008),
        "resistance": pytest.approx(12.0),
        "drawbar_slip": pytest.approx(0.25),
        "efficiency": pytest.approx(6.0 / 10.4),
        "slip_grows": False,
        "immobilised": False,
    }
    assert soil_columns(soil_log(0.25, pull=0.0))["efficiency"] == 0.0


def test_slip_grows_if_halves_of_the_last_third_differ():
    """A slip that grows by 0.03 over 10 s is 0.015 higher in the second half than in the first, one
    that grows by 0.01 is 0.005 higher.
    """
    share = np.clip((np.linspace(0.0, 30.0, 301) - 20.0) / 10.0, 0.0, 1.0)
    assert soil_columns(soil_log(0.1 + 0.03 * share))["slip_grows"]
    assert soil_columns(soil_log(0.1 - 0.03 * share))["slip_grows"]
    assert not soil_columns(soil_log(0.1 + 0.01 * share))["slip_grows"]


def test_what_has_no_meaning_without_motion_is_empty():
    stuck = soil_columns(soil_log(1.0, end_slip=1.0))
    assert stuck["immobilised"]
    assert stuck["drawbar_slip"] == pytest.approx(1.0)
    assert stuck["resistance"] is stuck["efficiency"] is None
    parked = soil_columns(soil_log(0.0, turning=0.0))
    assert parked["sinkage"] == pytest.approx(0.008)
    assert parked["drawbar_slip"] is parked["resistance"] is parked["efficiency"] is None


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
