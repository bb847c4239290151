from dataclasses import replace

import numpy as np
import pytest

from sim import Fleet, Ground, RobotParameters, load_robot, open_loop, replay
from sim.motors.motor import tireless
from trackslip import se2
from trackslip.errors import InvalidValueError, LogError
from trackslip.se2 import Mounting

ROBOT = RobotParameters(radius_error=0.0)
GROUND = Ground(0.6, 0.75)


@pytest.fixture(scope="module")
def driven():
    """Two drives of 8 s at speeds that change slowly, rows every 0.05 s."""
    fleet = Fleet(load_robot(parameters=ROBOT), np.zeros((2, 3)), GROUND, 0.0, tireless())
    time = np.arange(161)[:, None] * 0.05
    left, right = 2.0 + 1.5 * np.sin(0.9 * time), 2.0 + 1.5 * np.cos(0.7 * time)
    omega = np.stack([np.hstack([left, right]), np.hstack([right, -left])], axis=1)
    return open_loop(fleet, omega, 8.0, period=0.05)


def missed(logs, replayed):
    apart = [se2.between(a.truth.pose[-1], b.pose[-1]) for a, b in zip(logs, replayed, strict=True)]
    return np.hypot(*np.array(apart)[:, :2].T), np.abs(np.array(apart)[:, 2])


@pytest.mark.parametrize("inputs", ["encoders", "commands"])
def test_a_robot_drives_again_as_it_drove(driven, inputs):
    replayed = replay(driven, ROBOT, GROUND, inputs=inputs)
    position, heading = missed(driven, replayed)
    # ways of 1.0 m and 2.0 m; the rows tell the sprockets' mean speeds, not how they change in
    # between
    assert position.max() < 0.005
    assert heading.max() < 0.01
    for log, again in zip(driven, replayed, strict=True):
        np.testing.assert_array_equal(again.time, log.time)
        np.testing.assert_array_equal(again.omega, log.omega)
        np.testing.assert_allclose(again.pose[0], log.pose[0], atol=1e-12)
        # sensor in the middle, clocks alike
        np.testing.assert_allclose(again.truth.pose, again.pose, atol=1e-9)


def test_sensors_and_clocks_are_those_of_the_log(driven):
    sensor, late = Mounting(0.2, -0.1, 0.3), 0.2
    shift = round(late / 0.05)

    def as_measured(log):
        pose = se2.compose(log.truth.pose, sensor.pose)
        pose = np.concatenate([np.repeat(pose[:1], shift, axis=0), pose[:-shift]])  # of 0.2 s ago
        pose = se2.compose(np.array([0.0, 0.0, np.pi - pose[5, 2]]), pose)
        # wrapped after 0.2 s
        return replace(log, pose=np.column_stack([pose[:, :2], se2.wrap_angle(pose[:, 2])]))

    logs = [as_measured(log) for log in driven]
    for log, again in zip(
        logs, replay(logs, ROBOT, GROUND, sensor=sensor, clock=-late), strict=True
    ):
        apart = se2.between(log.pose[shift:], again.pose[shift:])
        assert np.abs(apart[:, :2]).max() < 0.005
        assert np.abs(se2.wrap_angle(apart[:, 2])).max() < 0.01


def test_resting_sprockets_begin_at_rest_whatever_the_poses_say(driven):
    """Two poses are placeholders, from which the others jump, as in the shipped log
    warthog_grass_2.
    """
    log = driven[0]
    still = np.where(log.time[:, None] < 0.5, 0.0, log.omega)
    pose = se2.compose(np.array([1.0, -2.0, -1.0]), log.pose)
    pose[log.time < 0.5] = pose[log.time >= 0.5][0]
    pose[:2] = 0.0
    again = replay(replace(log, omega=still, pose=pose), ROBOT, GROUND)[0]
    np.testing.assert_allclose(again.pose[2], pose[2], atol=1e-3)
    assert np.abs(again.truth.twist[log.time < 0.4]).max() < 1e-3


def test_refusals(driven):
    wild = replace(driven[0], omega=np.where(np.arange(161)[:, None] == 9, 400.0, driven[0].omega))
    with pytest.raises(
        LogError, match=r"belts as fast as 24 m/s: replayed are speeds below 9.9 m/s"
    ):
        replay(wild, ROBOT)
    with pytest.raises(InvalidValueError, match="inputs = 'wheels': must be encoders or commands"):
        replay(driven, ROBOT, inputs="wheels")
    with pytest.raises(InvalidValueError, match=r"clock = 0.6: must be from -0.5 to 0.5 s"):
        replay(driven, ROBOT, clock=0.6)
    with pytest.raises(LogError, match="run 'run 0': needs omega_cmd_l and omega_cmd_r"):
        replay([replace(driven[0], command=None)], ROBOT, inputs="commands")
