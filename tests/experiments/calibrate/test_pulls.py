"""Soft soil calibrated to a table of pulls and slips."""

import numpy as np
import pytest

from sim.calibration.candidate import Candidate
from sim.calibration.pull_test import PullTest
from sim.ground.ground import NAMED_GROUNDS, load_ground
from sim.robot.parameters import RobotParameters

WEIGHT = 25 * 9.81
SOIL = ("--ground", "dry_sand")
ROWS = "pull,slip\n20,0.02\n40,0.04\n80,0.09\n110,0.14\n"


def table_of(path, *weights, soil="regolith"):
    """Pulls of the shipped robot in a soil, without noise."""
    slip = np.tile([0.02, 0.06, 0.12, 0.2], len(weights))
    weight = np.repeat(weights, 4).astype(float)
    test = PullTest(slip, np.zeros_like(slip), weight, 0.1)
    pull = test.predicted(Candidate(RobotParameters(), NAMED_GROUNDS[soil]))
    table = np.column_stack([pull, slip, weight])
    np.savetxt(path, table, delimiter=",", header="pull,slip,weight", comments="")
    return str(path)


def test_a_soil_is_found_and_predict_takes_it(trackslip, tmp_path):
    target = table_of(tmp_path / "pulls.csv", WEIGHT, 2 * WEIGHT, soil="dry_sand")
    start = tmp_path / "start.toml"
    start.write_text(
        'base = "dry_sand"\n[soil]\ncohesion = 500.0\nfriction_angle = 0.6\nshear = 0.015\n'
    )
    found = trackslip("calibrate", "--target", target, "--ground", str(start))
    true = NAMED_GROUNDS["dry_sand"].soil
    parameters = found.summary["parameters"]
    for name in ("cohesion", "friction_angle", "shear"):
        assert parameters[name]["identifiable"]
        assert parameters[name]["value"] == pytest.approx(getattr(true, name), rel=1e-3)
    assert "pull / weight, rms" in found.printed
    assert (found.folder / "report.html").exists()
    assert not (found.folder / "robot.toml").exists()  # the robot is as it was
    ground = load_ground(str(found.folder / "ground.toml"))
    assert ground.soil.cohesion == parameters["cohesion"]["value"]
    assert ground.soil.k_phi == true.k_phi
    predicted = trackslip("predict", "--ground", str(found.folder / "ground.toml"))
    assert predicted.summary["soil"]["shear"] == parameters["shear"]["value"]


def test_one_weight_gives_no_interval_of_cohesion(trackslip, tmp_path):
    path = tmp_path / "pulls.csv"
    path.write_text(ROWS)
    found = trackslip("calibrate", "--target", str(path), *SOIL)
    parameters = found.summary["parameters"]
    for name in ("cohesion", "friction_angle"):
        assert not parameters[name]["identifiable"]
        assert parameters[name]["low"] is None
        assert f"{name}: all rows have one weight" in found.printed
    assert parameters["strength"]["identifiable"]
    assert "(not determined)" in found.printed
    alone = trackslip("calibrate", "--target", str(path), *SOIL, "--free", "friction_angle")
    assert set(alone.summary["parameters"]) == {"friction_angle"}


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("pull,slope\n20,0.1\n", "has no column slip"),
        ("pull,slip\n", "has no rows"),
        ("pull,slip\n20,0.02\nmuch,0.04\n", "row 2, column pull: 'much' is not a finite number"),
        ("pull,slip\n20,0.02\n,0.04\n", "row 2, column pull: is empty"),
        (
            "pull,slip\n20,2\n40,4\n",
            "row 1, column slip: 2 must be above 0 and at most 1: slip is a share, not in per cent",
        ),
        ("pull,slip\n20,0.02\n40,-0.1\n", "row 2, column slip: -0.1 must be above 0"),
        ("pull,slip,weight\n20,0.1,0\n", "row 1, column weight: 0 must be positive [N]"),
        ("pull,slip\n2000,0.1\n", "row 1, column pull: 2000 must be at most 3 times the weight"),
        ("pull,slip\n20,0.02\n40,0.04\n", "one to 1 parameters for 2 pulls"),
        ("pull,slip,slip\n20,0.1,0.1\n", "column slip is there 2 times"),
    ],
)
def test_bad_tables_are_refused_in_one_line(refused, tmp_path, rows, message):
    path = tmp_path / "pulls.csv"
    path.write_text(rows)
    assert message in refused("calibrate", "--target", str(path), *SOIL)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--free", "cohesion"), "left out on firm ground: --ground dry_sand"),
        (SOIL, "target = 'published': must be on soft soil a table of a pull test"),
        ((*SOIL, "--target", "nowhere.csv"), "nowhere.csv: no such file"),
        ((*SOIL, "--target", "pulls.csv", "--free", "com_x"), "must be one of cohesion"),
        ((*SOIL, "--target", "pulls.csv", "--gear", "2"), "gear = 2.0: must be left out"),
        ((*SOIL, "--target", "pulls.csv", "--folds", "2"), "folds = 2: must be left out"),
        ((*SOIL, "--target", "pulls.csv", "--robot", "husky"), "robot.contact = 'wheels'"),
    ],
)
def test_options_that_do_not_fit_are_refused(refused, tmp_path, options, message):
    (tmp_path / "pulls.csv").write_text(ROWS)
    assert message in refused("calibrate", *options)
