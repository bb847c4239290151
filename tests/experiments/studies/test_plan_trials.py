"""The law that moves the robot in trials of a plan."""

from types import SimpleNamespace

import numpy as np

from experiments.studies.plan_trials import truth_of
from trackslip.kinematics import RobotGeometry
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning.limits import first_knowledge


def plan(known=None):
    knowledge = first_knowledge(RobotGeometry(0.336, 0.06))
    sizes = {"offset": 0.4, "radius_error": 1.0}
    return SimpleNamespace(
        law="icr_radius", values=np.array([0.08, 0.01]), known=known, knowledge=knowledge, sizes=sizes
    )


def test_without_knowledge_it_is_the_shipped_robot_s_to_scale():
    np.testing.assert_allclose(truth_of(plan(), np.random.default_rng(0)), [0.09, 0.0066])


def test_after_an_identification_it_is_drawn_from_what_that_leaves_open():
    covariance = np.array([[4e-6, 1e-6], [1e-6, 1e-6]])
    known = LawErrors(("offset", "radius_error"), covariance)
    drawn = np.array([truth_of(plan(known), np.random.default_rng(seed)) for seed in range(2000)])
    np.testing.assert_allclose(drawn.mean(axis=0), [0.08, 0.01], atol=2e-4)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, rtol=0.15)


def test_parameters_of_which_nothing_is_known_stay():
    known = LawErrors(("offset",), np.array([[1e-6]]))
    offset, radius_error = truth_of(plan(known), np.random.default_rng(0))
    assert offset != 0.08
    assert radius_error == 0.01
