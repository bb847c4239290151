"""Trials of a plan: the law that moves the robot, and checks that can fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.studies.plan_trials import MIN_REPEATS, PAPER, PLAN, plan_study, truth_of
from experiments.studies.trials import Estimate, Outcome
from trackslip.kinematics import RobotGeometry
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning import plan as planning
from trackslip.planning.information import Expectation, PoseQuality
from trackslip.planning.limits import DriveLimits
from trackslip.planning.plan import plan_drive

PREDICTED = {"offset": 2e-4, "radius_error": 6e-4}
TRUTH = np.array([0.045, 0.0066])


@pytest.fixture(scope="module")
def plan():
    """A plan for a robot of twice the gauge, whose errors are said to be PREDICTED."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "_EVALUATIONS", 30)
        patch.setattr(planning, "_FEWEST", 30)
        limits, poses = DriveLimits(0.3, 0.5, (4.0, 4.0), 120.0), PoseQuality(10.0, 0.02, 0.017)
        found = plan_drive(RobotGeometry(0.336, 0.06), limits, poses, values=[0.08, 0.01])
    return replace(found, expectation=Expectation(PREDICTED, ()))


def trials(plan, size=1.0, paper=1.0, reach=0.9, speed=1.0):
    """Estimates with errors of `size` times those predicted; the paper's runs are expected to have `paper` times."""
    errors = size * np.array([*PREDICTED.values()]) * np.random.default_rng(0).standard_normal((4 * MIN_REPEATS, 2))
    outcomes = []
    for values in (TRUTH + errors).tolist():
        known = {name: Estimate(one, PREDICTED[name], 0.0, 1.0) for name, one in zip(PREDICTED, values, strict=True)}
        outcomes.append(Outcome(known, {"reach": reach, "speed": speed}))
    expected = Expectation({name: paper * value for name, value in PREDICTED.items()}, ())
    truth = dict(zip(PREDICTED, TRUTH.tolist(), strict=True))
    return plan_study(plan, expected, truth, MIN_REPEATS, {PLAN: outcomes, PAPER: outcomes[:MIN_REPEATS]})


def broken(found):
    return {check.what.split(" of ")[0].split(",")[0] for check in found.checks if not check.holds}


def test_honest_trials_hold(plan):
    found = trials(plan, paper=1.2)
    assert broken(found) == set()
    assert len(found.checks) == 3 + 2 + 2
    assert found.summary["uncertainty_of_real"][PLAN] == pytest.approx(1 / np.sqrt(2 * 400))
    for case in (PLAN, PAPER):
        for name, (low, high) in found.summary["interval95_of_real"][case].items():
            assert low < PREDICTED[name] < high


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"size": 1.5}, {"real over predicted error", "error"}),
        ({"size": 0.5, "paper": 1.0}, {"real over predicted error"}),
        ({"paper": 0.5}, {"error"}),
        ({"reach": 1.01}, {"farthest from the middle"}),
        ({"speed": 1.01}, {"largest speed"}),
    ],
)
def test_dishonest_ones_do_not(plan, change, what):
    assert broken(trials(plan, **{"paper": 1.2} | change)) == what


def test_without_knowledge_the_truth_is_the_shipped_robot_s_to_scale(plan):
    np.testing.assert_allclose(truth_of(plan, np.random.default_rng(0)), [0.09, 0.0066])


def test_after_an_identification_it_is_drawn_from_its_uncertainty(plan):
    covariance = np.array([[4e-6, 1e-6], [1e-6, 1e-6]])
    known = replace(plan, known=LawErrors(("offset", "radius_error"), covariance))
    drawn = np.array([truth_of(known, np.random.default_rng(seed)) for seed in range(2000)])
    np.testing.assert_allclose(drawn.mean(axis=0), [0.08, 0.01], atol=2e-4)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, rtol=0.15)
