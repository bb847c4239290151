import numpy as np
import pytest

from trackslip import se2
from trackslip.errors import LogError
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady import compare_laws, fit_law
from trackslip.kinematics import RobotGeometry, body_twist
from trackslip.laws.icr import MAX_LOAD, ConstantIcr, IcrLoad
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.online.compensation import MAX_CRAB_ANGLE, LoadedLaw, LoadedOnlineIcr
from trackslip.online.filter import FilterTuning

GEOMETRY = RobotGeometry(0.168, 0.06)
LAW = IcrLoad(0.04, GEOMETRY.half_gauge, 0.01, 0.1, 0.2)
LOADS = np.column_stack([np.tile([-0.2, 0.0, 0.2], 10), np.tile([0.1, -0.2], 15)])


def test_a_robot_that_pulls_nothing_has_constant_icrs():
    icr = ConstantIcr(0.04, GEOMETRY.half_gauge, 0.01)
    omega = np.random.default_rng(0).normal(size=(50, 2))
    np.testing.assert_allclose(LAW.twist(omega, GEOMETRY), icr.twist(omega, GEOMETRY), rtol=1e-13)
    kappa = np.array([0.0, 0.4, -2.0, np.inf])
    np.testing.assert_allclose(LAW(kappa), icr(kappa), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("compliance", [0.0, 0.1, 1.2])
@pytest.mark.parametrize("load", [(0.3, 0.1), (-0.5, 0.0), (MAX_LOAD, 0.0), (-MAX_LOAD, 0.3)])
def test_speeds_and_twists_are_inverse(compliance, load):
    law = IcrLoad(0.04, GEOMETRY.half_gauge, 0.01, compliance, 0.2, load)
    omega = np.random.default_rng(1).normal(size=(200, 2))
    twist = law.twist(omega, GEOMETRY)
    np.testing.assert_allclose(law.sprocket_speeds(twist, GEOMETRY), omega, rtol=1e-9, atol=1e-12)
    by_slip = body_twist(omega, law.slip(twist), GEOMETRY)
    np.testing.assert_allclose(by_slip, twist, rtol=1e-8, atol=1e-12)


def test_a_robot_slips_uphill_and_is_helped_downhill():
    belts = np.array([[1.0, 1.0], [-1.0, -1.0]])
    twist = LAW.under((0.2, 0.0)).twist(belts / GEOMETRY.sprocket_radius, GEOMETRY)
    loss = LAW.compliance * 0.2
    uphill = 1.01 * (1 - loss)
    downhill = -1.01 * (1 + loss)
    np.testing.assert_allclose(twist[:, 0], [uphill, downhill])


def test_before_a_run_the_law_is_that_without_load():
    law = LoadedLaw(LAW).law()
    omega = np.array([[1.0, 2.0], [-1.0, 3.0]])
    np.testing.assert_array_equal(law.twist(omega, GEOMETRY), LAW.twist(omega, GEOMETRY))


def test_the_heading_is_corrected_by_the_crab_angle():
    """Its tangent is the lateral load times the compliance, which grows with the turn w / v by the
    turn compliance: 0.1 and 0.2.
    """
    known = LoadedLaw(LAW)
    known.reset(np.zeros((4, 3)))
    known.sense(np.array([[0.0, 0.2], [0.0, 0.2], [0.0, -0.2], [0.0, 5.0]]))
    twist = np.array([[0.2, 0.0], [-0.2, 0.0], [0.2, 0.1], [0.01, 0.3]])
    forwards = np.arctan(-0.1 * 0.2)
    backwards = np.arctan(0.1 * 0.2)
    in_a_turn = np.arctan(0.2 * (0.1 + 0.2 * 0.5))
    expected = [forwards, backwards, in_a_turn, -MAX_CRAB_ANGLE]
    np.testing.assert_allclose(known.crab_angle(twist), expected)
    np.testing.assert_allclose(known.crab_angle(np.zeros((4, 2))), 0.0)


def test_the_filter_learns_what_load_does_not_explain():
    """Two robots drive a circle on a slope, exactly as the law says; the law is known, but its D
    and epsilon aren't.
    """
    exact = FilterTuning(
        gain_walk=0.0, radius_error_walk=0.0, position_walk=0.0, heading_walk=0.0, centre_walk=0.0
    )
    wrong = IcrLoad(0.05, GEOMETRY.half_gauge, 0.0, LAW.compliance, LAW.turn_compliance)
    learning = LoadedOnlineIcr(GEOMETRY, wrong, exact)
    pose = np.zeros((2, 3))
    omega = np.array([[2.0, 2.9], [3.1, 2.4]])
    period = 0.05
    learning.reset(pose)
    covariance = np.tile(1e-6 * np.eye(3), (2, 1, 1))
    for _ in range(400):
        heading = pose[:, 2]
        load = 0.2 * np.column_stack([np.cos(heading), -np.sin(heading)])
        law = LAW.under(load)
        learning.sense(load)
        twist = law.twist(omega, GEOMETRY)
        v, w = twist.T
        motion = np.column_stack([v, law.sideslip(twist), w]) * period
        pose, *_ = se2.drive(pose, motion)
        learning.observe(omega, period, PoseEstimate(pose, covariance, np.ones(2, bool)))
    found = learning.law()
    np.testing.assert_allclose(found.offset, LAW.offset, atol=2e-4)
    np.testing.assert_allclose(found.radius_error, LAW.radius_error, atol=2e-4)


def _samples(load: np.ndarray | None, noise: float = 1e-4) -> SlipSamples:
    rng = np.random.default_rng(4)
    omega = rng.uniform(1.0, 4.0, (30, 2)) * np.array([1.0, rng.choice([-1.0, 1.0])])
    omega[:10, 1] = omega[:10, 0]
    law = LAW if load is None else LAW.under(load)
    twist = law.twist(omega, GEOMETRY) + noise * rng.standard_normal((30, 2))
    covariance = np.tile(noise**2 * np.eye(2), (30, 1, 1))
    names = [f"run {k}" for k in range(30)]
    return SlipSamples.of(omega, twist, GEOMETRY, names, covariance, load=load)


def test_the_law_is_found_from_runs_under_different_loads():
    samples = _samples(LOADS)
    fitted = fit_law("icr_load", samples, GEOMETRY)
    for name, value in fitted.values.items():
        assert abs(value - getattr(LAW, name)) < 4 * fitted.stderr[name]
        low, high = fitted.interval95[name]
        assert low < value < high
    assert fitted.stderr["compliance"] < 0.01
    found = compare_laws(samples, GEOMETRY)
    assert found.best == "icr_load"
    assert found.laws["icr_radius"].rms > 10 * found.laws["icr_load"].rms


def test_without_loads_the_law_is_not_tried():
    assert "icr_load" not in compare_laws(_samples(None), GEOMETRY).laws


def test_equal_loads_do_not_determine_the_law():
    with pytest.raises(LogError, match="don't determine"):
        fit_law("icr_load", _samples(np.zeros((30, 2))), GEOMETRY)
