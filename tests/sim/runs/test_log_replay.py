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
    time = np.arange(161) * 0.05
    left = 2.0 + 1.5 * np.sin(0.9 * time)
    right = 2.0 + 1.5 * np.cos(0.7 * time)
    first = np.column_stack([left, right])
    second = np.column_stack([right, -left])
    return open_loop(fleet, np.stack([first, second], axis=1), 8.0, period=0.05)


def missed(logs, replayed):
    """Distances (n,) and angles (n,) between the ends of drives."""
    apart = []
    for log, again in zip(logs, replayed, strict=True):
        apart.append(se2.between(log.truth.pose[-1], again.pose[-1]))
    x, y, heading = np.transpose(apart)
    return np.hypot(x, y), np.abs(heading)


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
    sensor = Mounting(0.2, -0.1, 0.3)
    late = 0.2
    shift = round(late / 0.05)

    def as_measured(log):
        """Poses of the sensor 0.2 s ago, in a frame turned so that headings wrap after 0.2 s."""
        pose = se2.compose(log.truth.pose, sensor.pose)
        delayed = np.concatenate([np.repeat(pose[:1], shift, axis=0), pose[:-shift]])
        turn = np.array([0.0, 0.0, np.pi - delayed[5, 2]])
        x, y, heading = se2.compose(turn, delayed).T
        return replace(log, pose=np.column_stack([x, y, se2.wrap_angle(heading)]))

    logs = [as_measured(log) for log in driven]
    replayed = replay(logs, ROBOT, GROUND, sensor=sensor, clock=-late)
    for log, again in zip(logs, replayed, strict=True):
        apart = se2.between(log.pose[shift:], again.pose[shift:])
        assert np.abs(apart[:, :2]).max() < 0.005
        assert np.abs(se2.wrap_angle(apart[:, 2])).max() < 0.01


def test_resting_sprockets_begin_at_rest_whatever_the_poses_say(driven):
    """Two poses are placeholders, from which the others jump, as in the shipped log
    warthog_grass_2.
    """
    log = driven[0]
    rests = log.time < 0.5
    still = np.where(rests[:, None], 0.0, log.omega)
    pose = se2.compose(np.array([1.0, -2.0, -1.0]), log.pose)
    pose[rests] = pose[~rests][0]
    pose[:2] = 0.0
    (again,) = replay(replace(log, omega=still, pose=pose), ROBOT, GROUND)
    np.testing.assert_allclose(again.pose[2], pose[2], atol=1e-3)
    assert np.abs(again.truth.twist[log.time < 0.4]).max() < 1e-3


def test_refusals(driven):
    log = driven[0]
    is_wild = np.arange(161) == 9
    wild = replace(log, omega=np.where(is_wild[:, None], 400.0, log.omega))
    said = r"belts as fast as 24 m/s: replayed are speeds below 9.9 m/s"
    with pytest.raises(LogError, match=said):
        replay(wild, ROBOT)
    with pytest.raises(InvalidValueError, match="inputs = 'wheels': must be encoders or commands"):
        replay(driven, ROBOT, inputs="wheels")
    with pytest.raises(InvalidValueError, match=r"clock = 0.6: must be from -0.5 to 0.5 s"):
        replay(driven, ROBOT, clock=0.6)
    with pytest.raises(LogError, match="run 'run 0': needs omega_cmd_l and omega_cmd_r"):
        replay([replace(log, command=None)], ROBOT, inputs="commands")
