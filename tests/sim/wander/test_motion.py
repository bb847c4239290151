"""Motion by a law, against the law and its variation, and in MuJoCo; poses between rows."""

from __future__ import annotations

import numpy as np
import pytest

from sim.wander.motion import LASTING, WHITE, Driver, LawMotion, Motion, SlipVariation, track_commands
from trackslip import se2
from trackslip.kinematics import RobotGeometry, advance
from trackslip.laws.icr import ConstantIcr

RNG = np.random.default_rng(4)


def test_poses_between_rows_lie_on_the_arc():
    twist = np.array([0.2, 0.9])
    time = np.cumsum(RNG.uniform(0.05, 0.2, 40))
    start = np.array([1.0, -2.0, 3.0])
    at = RNG.uniform(time[0], time[-1], 100)
    motion = Motion(time, advance(start, twist, time))
    np.testing.assert_allclose(motion.at(at), advance(start, twist, at), atol=1e-12)
    np.testing.assert_allclose(motion.at(time), motion.pose, atol=1e-12)


RATE = 50.0
GEOMETRY = RobotGeometry(half_gauge=0.168, sprocket_radius=0.06)
LAW = ConstantIcr(offset=0.045, half_gauge=0.168, radius_error=0.0066)
EXACT = SlipVariation()


def test_without_variation_law_turning_centre_drift_and_lag_decide():
    omega = track_commands("random", 60.0, RATE, Driver(), np.random.default_rng(0)) / GEOMETRY.sprocket_radius
    motion, twist = LawMotion(LAW, GEOMETRY, EXACT).drive(omega, RATE, RNG)
    law = np.insert(LAW.twist(omega, GEOMETRY), 1, 0.0, axis=-1)
    np.testing.assert_allclose(twist[1:], law[1:], atol=1e-15)
    time = np.arange(len(omega)) / RATE
    np.testing.assert_allclose(motion.at(time), se2.chain(np.zeros(3), se2.exp(law[1:] / RATE)), atol=1e-10)
    _, twist = LawMotion(LAW, GEOMETRY, EXACT, turning_centre=0.03, drift=0.02).drive(omega, RATE, RNG)
    v, lateral, w = twist.T
    np.testing.assert_allclose(lateral, -0.03 * w - 0.02 * v * w, atol=1e-15)
    omega = np.r_[0.0, np.full(100, 3.0)][:, None] * np.ones(2)
    motion, _ = LawMotion(LAW, GEOMETRY, EXACT, lag=0.2).drive(omega, RATE, RNG)
    speed, t = 0.06 * (1 + LAW.radius_error) * 3.0, motion.time
    np.testing.assert_allclose(motion.pose[:, 0], speed * (t - 0.2 * (1 - np.exp(-t / 0.2))), atol=1e-12)


@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_white_slip_grows_with_the_way(rate):
    omega = np.array([0.0, 0.0]) + np.r_[0.0, np.full(int(100 * rate), 4.0)][:, None] * [1.0, -0.5]
    moved, twist = LawMotion(LAW, GEOMETRY, WHITE).drive(omega, rate, np.random.default_rng(1))
    still, _ = LawMotion(LAW, GEOMETRY, EXACT).drive(omega, rate, np.random.default_rng(1))
    count = len(moved.time) - 1
    way = GEOMETRY.sprocket_radius * 3.0 * 100.0 / count  # of a step: the mean of |4| and |-2| rad/s
    errors = se2.steps(moved.pose) - se2.steps(still.pose)
    spread = errors.std(axis=0) / np.sqrt(way)
    np.testing.assert_allclose(spread, [WHITE.along, WHITE.across, WHITE.turning], rtol=5 / np.sqrt(2 * count))
    neighbours = (errors[1:] * errors[:-1]).mean(axis=0) / errors.var(axis=0)
    assert np.abs(neighbours).max() < 5 / np.sqrt(count)
    np.testing.assert_allclose(twist[1:, [0, 2]], LAW.twist(omega[1:], GEOMETRY))


def test_lasting_slip_has_its_size_and_its_time():
    variation = SlipVariation(lasting=0.02, lasting_time=0.5)
    omega = np.r_[0.0, np.full(50_000, 3.0)][:, None] * np.ones(2)
    _, twist = LawMotion(LAW, GEOMETRY, variation).drive(omega, RATE, np.random.default_rng(2))
    surface = 0.06 * (1 + LAW.radius_error) * 3.0
    left = (twist[1:, 0] - (0.168 + LAW.offset) * twist[1:, 2]) / surface - 1
    assert left.std() == pytest.approx(0.02, rel=0.1)
    lag = 25  # rows in half a second
    assert np.corrcoef(left[lag:], left[:-lag])[0, 1] == pytest.approx(np.exp(-1), abs=0.1)
    assert LASTING.lasting == 0.02
