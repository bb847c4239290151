"""Bags with the quirks of real robots: what is read agrees with the drive, and what is left out is told."""

import numpy as np
import pytest
from bags import (
    fix,
    header,
    in_order,
    joint_states,
    poses_of,
    sprocket_angles,
    stamp,
    write_bag,
)
from wandered import wandered

from trackslip.errors import LogError
from trackslip.ros.drive_log import read_bags

LOG = wandered(duration=20.0)
TURNED = sprocket_angles(LOG)
WHEELS = ("front_left_wheel_joint", "front_right_wheel_joint", "rear_left_wheel_joint", "rear_right_wheel_joint")
FOUR = TURNED[:, [0, 1, 0, 1]]
ROWS = range(len(LOG.time))


def states(angles=FOUR, names=WHEELS, velocity=(), effort=(), rows=ROWS, unstamped=(), **others):
    """Joint states of `rows`, with velocities and efforts that are the same in all of them."""
    messages = []
    for k in rows:
        message = joint_states(stamp(LOG.time[k]), names, angles[k].tolist(), velocity, **others)
        message[3]["effort"] = list(effort)
        if k in unstamped:
            message[3]["header"] = header(0)
        messages.append(message)
    return messages


def read(tmp_path, *messages, kind="mcap"):
    found = read_bags(write_bag(tmp_path / "run", kind, in_order(*messages)))
    (log,) = found.runs
    return log, found


def speeds(log):
    """Sprocket speeds (T, 2) at the times of LOG that the log has."""
    offset = log.metadata["bag"]["start"] - stamp(0.0) / 1e9
    rows = np.searchsorted(LOG.time, log.time + offset - 1e-4)
    return log.omega[1:], LOG.omega[rows[1:]]


def assert_driven(log, atol=1e-9):
    found, real = speeds(log)
    assert len(found) > 0.9 * len(LOG.time)
    np.testing.assert_allclose(found, real, atol=atol)


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_velocities_that_are_zero_and_efforts_that_are_no_numbers(tmp_path, kind):
    log, found = read(tmp_path, states(velocity=[0.0] * 4, effort=[np.nan] * 4), poses_of(LOG), kind=kind)
    assert_driven(log)
    assert found.warnings == ()


def test_an_encoder_reset_where_velocities_are_zero(tmp_path):
    """The wheels are not taken to rest while they leap."""
    angles = FOUR - np.where(np.arange(len(FOUR)) < 200, 0.0, 25.0)[:, None]
    log, found = read(tmp_path, states(angles, velocity=[0.0] * 4), poses_of(LOG))
    assert_driven(log, atol=0.1)
    assert all("its position leaps 1 time(s): bridged" in line for line in found.warnings)


def test_controllers_that_publish_their_own_joints_on_one_topic(tmp_path):
    """The front wheels in one message, the rear wheels in the next, an arm in between."""
    front = states(FOUR[:, :2], WHEELS[:2], rows=ROWS[::2])
    rear = states(FOUR[:, 2:], WHEELS[2:], rows=ROWS[1::2])
    arm = states(np.zeros((len(FOUR), 1)), ("arm_1",), rows=ROWS[::7], late=2_000_000)
    log, found = read(tmp_path, front, rear, arm, poses_of(LOG))
    offset = log.metadata["bag"]["start"] - stamp(0.0) / 1e9
    angle = sprocket_angles(log)
    real = np.column_stack([np.interp(log.time + offset, LOG.time, side) for side in TURNED.T])
    np.testing.assert_allclose(angle, real - real[0], atol=0.02)
    assert found.warnings == ()


@pytest.mark.parametrize("unstamped", [(0,), (100,), (0, 1, 200)])
def test_messages_before_the_clock_is_known(tmp_path, unstamped):
    log, found = read(tmp_path, states(unstamped=unstamped), poses_of(LOG))
    assert log.time[-1] < 21.0
    line = f"topic /joint_states: {len(unstamped)} of 400 messages left out: their header stamps are 0"
    assert found.warnings == (line,)


@pytest.mark.parametrize("times", [2, 3])
def test_a_bag_that_holds_every_message_several_times(tmp_path, times):
    log, found = read(tmp_path, *[states() for _ in range(times)], *[poses_of(LOG) for _ in range(times)])
    assert_driven(log)
    assert all("time is stamped twice" in line for line in found.warnings)


def test_an_encoder_that_is_dead(tmp_path):
    log, found = read(tmp_path, states(FOUR * [1, 0, 1, 1]), poses_of(LOG))
    assert_driven(log)
    line = "joint front_right_wheel_joint left out: it stands still while rear_right_wheel_joint turns"
    assert found.warnings == (f"topic /joint_states: {line}",)


def test_wheels_of_another_gear(tmp_path):
    _, found = read(tmp_path, states(FOUR * [1, 1, 1, 0.5]), poses_of(LOG))
    line = "joint rear_right_wheel_joint turns 0.5 times as fast as front_right_wheel_joint: their mean is taken"
    assert f"topic /joint_states: {line}" in found.warnings


def test_wheels_of_a_side_that_turn_against_each_other(tmp_path):
    with pytest.raises(LogError, match="of one side turn against each other: choose with --left NAMES"):
        read(tmp_path, states(FOUR * [1, 1, 1, -1]), poses_of(LOG))


@pytest.mark.parametrize(("place", "status"), [((0.0, 0.0), 0), ((np.nan, np.nan), 0), ((np.nan, np.nan), -1)])
def test_a_receiver_before_its_fix(tmp_path, place, status):
    fixes = []
    for k, (time, (x, y, _)) in enumerate(zip(LOG.time[LOG.is_valid], LOG.pose[LOG.is_valid], strict=True)):
        early = k < 20
        at = place if early else (48.0 + y / 111_195, 11.0 + x / 74_500)
        fixes.append(fix(stamp(time), *at, status=status if early else 0))
    log, found = read(tmp_path, states(), fixes)
    assert "topic /fix: 20 of 200 messages left out: they have no fix" in found.warnings
    assert np.abs(log.pose[log.is_valid, :2]).max() < 50.0
