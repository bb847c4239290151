"""Poses between rows, and steps between poses."""

from __future__ import annotations

import numpy as np

from sim.wander.motion import Motion, arc_steps, joined, steps_between
from trackslip.kinematics import advance

RNG = np.random.default_rng(4)


def test_poses_between_rows_lie_on_the_arc():
    twist = np.array([0.2, 0.9])
    time = np.cumsum(RNG.uniform(0.05, 0.2, 40))
    start = np.array([1.0, -2.0, 3.0])
    at = RNG.uniform(time[0], time[-1], 100)
    motion = Motion(time, advance(start, twist, time))
    np.testing.assert_allclose(motion.at(at), advance(start, twist, at), atol=1e-12)
    np.testing.assert_allclose(motion.at(time), motion.pose, atol=1e-12)


def test_steps_and_joined_are_inverse():
    pose = RNG.normal(size=(50, 3)).cumsum(axis=0)
    np.testing.assert_allclose(joined(pose[0], steps_between(pose)), pose, atol=1e-12)


def test_an_arc_with_lateral_speed_is_many_short_straight_steps():
    twist = np.array([0.3, -0.1, 1.2])
    fine = joined(np.zeros(3), np.tile(twist * 1e-5, (100_000, 1)))[-1]
    np.testing.assert_allclose(arc_steps(twist, 1.0), fine, atol=1e-5)
