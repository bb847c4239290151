"""Coverage of laws identified from drives: checks that can fail, and trials with a known law."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.common.check import Check
from experiments.studies.drive_coverage import CASES, TRUE_LAW, CoverageCase, checks_of, fitted_drive, steady_laws
from experiments.studies.trials import Estimate, Trial, TrialOutcome
from trackslip.kinematics import RobotGeometry

GEOMETRY = RobotGeometry(0.168, 0.06)
NORMAL = 1.959964
FIRST = next(iter(CASES))
CASE = CoverageCase(
    "a case", CASES[FIRST].source, rms={"offset": 0.00112}, covered=("offset",), over_model=1.5, standard_errors=5.0
)
"""Errors of 1 mm may exceed their bound by 12 %, five standard errors of the RMS of 1000 repeats."""
EXACT = Estimate(TRUE_LAW["radius_error"], 0.001, 0.0, 1.0)
FAILED = TrialOutcome(notes=("why",))


def estimated(bias: float = 0.0, stderr: float = 0.001, count: int = 1000) -> list[TrialOutcome]:
    """Estimates of D with errors of 1 mm."""
    values = TRUE_LAW["offset"] + np.random.default_rng(0).normal(bias, 0.001, count)
    estimates = [Estimate(x, stderr, x - NORMAL * stderr, x + NORMAL * stderr) for x in values.tolist()]
    return [TrialOutcome({"offset": one, "radius_error": EXACT}) for one in estimates]


def checked(
    outcomes: list[TrialOutcome], case: CoverageCase = CASE, aim: dict[str, float] | None = None
) -> dict[str, Check]:
    return {check.what: check for check in checks_of(case, outcomes, aim or TRUE_LAW, TRUE_LAW)}


def test_honest_estimates_hold():
    checks = checked(estimated())
    assert all(check.holds for check in checks.values())
    assert checks["rms error of offset"].measured == pytest.approx(0.001, rel=0.1)
    assert checks["coverage of offset"].measured == pytest.approx(0.95, abs=0.02)
    assert checks["half width of offset over the model's"].measured == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("found", "broken"),
    [
        (estimated(bias=0.001), {"rms error of offset", "coverage of offset"}),
        (estimated(stderr=0.0003), {"coverage of offset", "largest error of offset in standard errors"}),
        (estimated(stderr=0.01), {"coverage of offset"}),
        ([*estimated()[1:], FAILED], {"fits without D or epsilon"}),
        ([FAILED] * 3, "all"),
    ],
)
def test_dishonest_ones_do_not(found, broken):
    checks = checked(found)
    assert {what for what, check in checks.items() if not check.holds} == (set(checks) if broken == "all" else broken)


def test_errors_are_measured_from_the_aim_and_intervals_from_the_truth_of_each_drive():
    aim = {"offset": TRUE_LAW["offset"] + 0.01, "radius_error": 0.0}
    checks = checked(estimated(), aim=aim)
    assert checks["rms error of offset"].measured == pytest.approx(0.01, rel=0.01)
    assert checks["coverage of offset"].holds


def test_a_drive_by_the_law_is_fitted_within_its_bound():
    outcome = fitted_drive(Trial(FIRST), np.random.default_rng(0), GEOMETRY)
    assert set(outcome.numbers) == set(TRUE_LAW)
    for name, true in TRUE_LAW.items():
        assert abs(outcome.estimates[name].value - true) < 4 * outcome.numbers[name]
        assert outcome.estimates[name].stderr > 0.8 * outcome.numbers[name]


def test_steady_circles_of_the_same_speeds_have_icrs_farther_out(robot):
    """The tracks slip faster at a higher yaw rate, and the simulated friction grows a little with the speed of slip."""
    same, paper = steady_laws(robot, 1)
    assert 0.044 < paper["offset"] < same["offset"] < 0.047
    assert paper["radius_error"] == pytest.approx(0.0066, abs=5e-4)
