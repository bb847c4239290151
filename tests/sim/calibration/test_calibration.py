from dataclasses import replace

import numpy as np
import pytest

from sim.calibration.calibration import (
    Candidate,
    bounds,
    calibrate,
    simulated_twist,
    starts,
    theoretical_twist,
)
from sim.calibration.target import MeasuredTurns, TurnTable
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from trackslip.errors import InvalidValueError
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import RobotGeometry

NO_FURTHER = np.empty((0, 3))
BASE = Candidate(RobotParameters(), Ground().across / Ground().along)
TRUE = Candidate(RobotParameters(half_gauge=0.2, contact_length=0.42, radius_error=-0.012, com_y=0.015), 1.3)


def measured(candidate, twist_of, rng=None, noise=0.0):
    """Turns to both sides of a candidate, with a noise on the tracks' speeds relative to the faster one."""
    left = np.array([[2.0, 3.0], [3.0, 4.0], [1.0, 3.0], [2.5, 3.0], [1.5, 2.2]])
    omega = np.concatenate([left, left[:, ::-1], -left])
    bare = MeasuredTurns(SlipSamples(omega, omega, omega, ()), candidate.geometry)
    twist = twist_of(candidate, bare)
    if rng is not None:
        speeds = rng.normal(0, noise, omega.shape) * np.abs(omega).max(axis=1, keepdims=True) * 0.06
        b = candidate.robot.half_gauge
        twist = twist + np.stack([speeds.mean(axis=1), (speeds[:, 1] - speeds[:, 0]) / (2 * b)], axis=-1)
    names = [f"{k}" for k in range(len(omega))]
    return MeasuredTurns(SlipSamples.of(omega, twist, candidate.geometry, names), candidate.geometry)


FREE = ("friction_ratio", "radius_error", "com_y")
START = Candidate(replace(TRUE.robot, radius_error=0.0, com_y=0.0), 1.0)


@pytest.mark.slow
def test_a_known_robot_is_found_again_by_simulation():
    fit = calibrate(START, FREE, measured(TRUE, simulated_twist), simulated_twist, NO_FURTHER)
    assert fit.tied == ()
    for name in FREE:
        assert abs(fit.candidate.value(name) - TRUE.value(name)) < 3 * fit.stderr[name]
        assert fit.stderr[name] < 0.002  # the error is the simulator's own


@pytest.mark.slow
def test_standard_errors_cover_what_noise_does():
    """Over repeats, errors in units of the stated ones have a mean square of one; by theory, which is quick."""
    errors = []
    for seed in range(24):
        target = measured(TRUE, theoretical_twist, np.random.default_rng(seed), 0.002)
        fit = calibrate(START, FREE, target, theoretical_twist, NO_FURTHER)
        errors.append([(fit.candidate.value(name) - TRUE.value(name)) / fit.stderr[name] for name in FREE])
    # chi-square with 24 degrees of freedom, over 24: within 0.41 and 1.90 in 99 of 100 cases
    mean_square = np.mean(np.square(errors), axis=0)
    assert np.all((mean_square > 0.41) & (mean_square < 1.90)), mean_square


@pytest.fixture(scope="module")
def published():
    """The fit of theory to the paper's turns, from six starts."""
    further = starts(FREE, 5, np.random.default_rng(1))
    return calibrate(BASE, FREE, TurnTable.published(), theoretical_twist, further)


def test_every_start_ends_at_the_same_optimum(published):
    assert len(published.ends) == 6
    for name in FREE:
        ends = [end.value(name) for end, _ in published.ends]
        assert np.ptp(ends) < 0.05 * published.stderr[name]


def test_ratio_and_length_are_told_to_be_one_parameter():
    free = ("friction_ratio", "contact_length", "radius_error")
    fit = calibrate(BASE, free, TurnTable.published(), theoretical_twist, NO_FURTHER)
    assert set(fit.tied) == {"friction_ratio", "contact_length"}
    assert set(fit.stderr) == {"radius_error"}
    assert fit.candidate.robot.contact_length == BASE.robot.contact_length  # held
    alone = calibrate(BASE, ("friction_ratio", "radius_error"), TurnTable.published(), theoretical_twist, NO_FURTHER)
    assert fit.slip_rms == pytest.approx(alone.slip_rms, rel=1e-3)


def straight_runs():
    omega = np.array([[2.0, 2.0], [3.0, 3.0], [4.0, 4.0]])
    twist = np.column_stack([0.06 * omega[:, 0], np.zeros(3)])
    return MeasuredTurns(SlipSamples.of(omega, twist, BASE.geometry, list("abc")), BASE.geometry)


@pytest.mark.parametrize(("name", "target"), [("com_x", TurnTable.published()), ("shear", straight_runs())])
def test_a_parameter_without_effect_is_told(name, target):
    fit = calibrate(BASE, (name, "radius_error"), target, theoretical_twist, NO_FURTHER[:, :2])
    assert fit.tied == (name,)
    assert set(fit.stderr) == {"radius_error"}


@pytest.mark.parametrize(
    ("free", "message"),
    [
        (("mass",), "free = 'mass': must be one of half_gauge"),
        (("com_y", "com_y"), "free = 'com_y': must be named once"),
        ((), r"free = \[\]"),
    ],
)
def test_impossible_calibrations_are_refused(free, message):
    with pytest.raises(InvalidValueError, match=message):
        calibrate(BASE, free, TurnTable.published(), theoretical_twist, np.empty((0, len(free))))


def test_bounds_hold_robots_that_stand():
    low, high = ({name: limit[k] for name, limit in bounds(BASE).items()} for k in (0, 1))
    for values in (low, high, low | {"com_x": high["com_x"]}):
        assert isinstance(BASE.with_values(values).geometry, RobotGeometry)


def test_no_weight_brings_a_calibrations_motors_to_their_limits():
    heavy = Candidate(RobotParameters(mass=400.0, sprocket_radius=0.03), 1.1)
    target = TurnTable.published()
    np.testing.assert_allclose(simulated_twist(heavy, target), theoretical_twist(heavy, target), rtol=0.01)


def test_shear_is_found_in_turns_that_theory_drives_with_it():
    target = measured(Candidate(RobotParameters(), 1.15, 0.008), theoretical_twist)
    fit = calibrate(BASE, ("shear", "friction_ratio"), target, theoretical_twist, np.empty((0, 2)))
    assert fit.candidate.shear == pytest.approx(0.008, rel=0.02)
    assert fit.candidate.friction_ratio == pytest.approx(1.15, rel=0.01)
    assert set(fit.stderr) == {"shear", "friction_ratio"}
    both = fit.correlation["shear"]["friction_ratio"]
    assert fit.correlation["friction_ratio"]["shear"] == pytest.approx(both, rel=1e-12)
    assert abs(both) < 1
