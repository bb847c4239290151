"""Commands that change in every period, driven in MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest

from sim.fleet import Fleet
from sim.run_recorder import Description
from sim.runs import drive_fleet
from trackslip.errors import InvalidValueError

ABOUT = [Description("one"), Description("two")]


def test_sprockets_follow_their_commands_with_the_servos_lag(robot):
    fleet = Fleet(robot, np.zeros((2, 3)), threads=1)
    time = np.arange(101) / 50
    omega = 2 * np.sin(2 * np.pi * time / 2.0)[:, None, None] * [[[1.0, 1.0], [1.0, -1.0]]]
    straight, spinning = drive_fleet(fleet, omega, 50.0, ABOUT)
    np.testing.assert_allclose(straight.time, time)
    np.testing.assert_array_equal(straight.command, omega[:, 0])
    np.testing.assert_array_equal(straight.pose, straight.truth.pose)
    keep, speed, mean = np.exp(-0.01 / 0.05), np.zeros(2), [np.zeros(2)]
    for command in np.repeat(omega[:-1, 0], 2, axis=0):  # two periods of the servo for each of the encoders
        after = command + (speed - command) * keep
        mean.append(command + (speed - command) * (1 - keep) * 0.05 / 0.01)
        speed = after
    expected = np.concatenate([[mean[0]], np.reshape(mean[1:], (-1, 2, 2)).mean(axis=1)])
    count = 2 * np.pi / 100_000 * 50  # of the encoders, as a speed
    np.testing.assert_allclose(straight.omega, expected, atol=1.01 * count)
    assert np.abs(straight.pose[:, 2]).max() < 0.01
    assert np.abs(spinning.pose[:, 2]).max() > 0.2


def test_a_rate_that_the_servo_does_not_know_is_refused(robot):
    with pytest.raises(InvalidValueError, match="servo period"):
        drive_fleet(Fleet(robot, np.zeros((2, 3)), threads=1), np.zeros((5, 2, 2)), 30.0, ABOUT)
