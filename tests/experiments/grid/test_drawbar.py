"""Drawbar tests of a grid: what is measured on soft soil, beside theory."""

import numpy as np
import pyarrow.parquet
import pytest

from experiments.cli import parse
from experiments.common.run_table import SOIL_COLUMNS
from experiments.grid.drawbar import drawbar_charts, drawbar_tests, soil_columns
from experiments.grid.plan import plan
from sim import Fleet, Ground, RobotParameters, load_robot, open_loop

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
