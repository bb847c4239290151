"""The first look: clean logs pass, and what they are is told; clocks that differ, and jumps of poses."""

import json

import numpy as np
import pytest
from looks import DRIVE, KINDS, POSE, TIME, holds, look, look_at, without
from plain_drives import ENCODER_STEP, HUSKY, Drive, Robot, drive_of, log_of, measured

from trackslip.errors import LogError

SMALL = Robot(0.1, 0.04, 0.03)
LARGE = Robot(1.0, 0.3, 0.6)
SKIDDING = Robot(0.25, 0.1, 0.4)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("robot", "driving", "poses"),
    [
        (HUSKY, {}, {}),
        (HUSKY, {"slip": 0.05}, {"pose_step": 1.0, "position_noise": 0.02}),
        (SMALL, {"speed": 0.2, "yaw_rate": 0.6}, {"position_noise": 0.002}),
        (LARGE, {"speed": 2.0, "yaw_rate": 0.5, "slip": 0.05}, {"pose_step": 0.2, "position_noise": 0.02}),
        (SKIDDING, {"speed": 3.0, "yaw_rate": 1.0}, {"pose_step": 0.2}),
    ],
)
def test_clean_logs_have_no_alarm_and_gains_that_hold_the_truth(robot, driving, poses, kind):
    drive = drive_of(robot, seed=3, **driving)
    time, pose = measured(drive, **poses)
    found = look(log_of(drive, time, without(pose, kind)), robot=robot)
    assert found.alarms == ()
    assert holds(found.gains.turn, robot.turn_gain)
    assert found.gains.speed is None if kind == "headings" else holds(found.gains.speed, 1 + robot.radius_error)
    assert abs(found.clock) < 0.08
    assert len(found.drives) == 1
    words = {"poses": "poses", "positions": "positions without headings", "headings": "headings without positions"}
    assert found.notes[0].startswith(f"{words[kind]} every")
    assert json.dumps(found.to_json(), allow_nan=False)


@pytest.mark.parametrize("noise", [0.005, 0.03])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("speeds", "yaw_rates", "tells"),
    [
        ([0.5, -0.3], [0.0, 0.0], "speed"),
        ([0.0, 0.0], [0.6, -0.6], "turn"),
        ([0.5, 0.5], [0.4, 0.4], "both"),
        ([0.5, 0.5], [0.4, -0.4], "both"),
    ],
)
def test_plain_driving_tells_what_it_can(speeds, yaw_rates, tells, kind, noise):
    drive = drive_of(commands=(np.tile(speeds, 20), np.tile(yaw_rates, 20)))
    time, pose = measured(drive, position_noise=noise, heading_noise=noise)
    found = look_at(drive, time, without(pose, kind))
    assert found.alarms == ()
    turns = tells != "speed" and not (tells == "turn" and kind == "positions")
    assert holds(found.gains.turn, HUSKY.turn_gain) if turns else found.gains.turn is None
    assert holds(found.gains.speed, 0.97) if tells != "turn" and kind != "headings" else found.gains.speed is None


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say():
    hits = []
    for seed in range(20):
        drive = drive_of(seed=seed, slip=0.03)
        found = look_at(drive, *measured(drive, pose_step=0.5, seed=100 + seed))
        pairs = (found.gains.speed, 1 + HUSKY.radius_error), (found.gains.turn, HUSKY.turn_gain)
        hits += [gain.low <= truth <= gain.high for gain, truth in pairs]
    assert np.mean(hits) > 0.84  # 0.95 less three times 0.035


def test_turns_to_one_side_pass_with_a_note():
    step = np.arange(40)
    commands = np.where(step % 2 == 0, 0.3, 0.0) * np.where(step % 4 == 0, 1, -1), np.where(step % 2 == 1, 0.2, 0.0)
    drive = drive_of(duration=320.0, commands=commands, hold=8.0)
    found = look_at(drive, *measured(drive))
    assert "turns to the left only: unequal sides can't be told from the turns" in found.notes
    assert found.right_turns < 0.1 < 20 < found.left_turns
    assert holds(found.gains.turn, HUSKY.turn_gain)


def test_a_sensor_anywhere_and_turned_changes_no_gain():
    heading = POSE[:, 2]
    arm = np.exp(1j * heading) * (0.4 - 0.2j)
    pose = np.column_stack([POSE[:, 0] + arm.real, POSE[:, 1] + arm.imag, heading + 1.2])
    found = look_at(pose=pose)
    assert holds(found.gains.speed, 0.97)
    assert found.gains.arm == pytest.approx(0.4 - 0.2j, abs=0.01)
    assert found.gains.heading == pytest.approx(1.2, abs=0.01)


def test_stops_and_rare_motion_are_no_missing_readings():
    """Encoders at 1 Hz of a robot that stops and goes, and a robot that stands for most of an hour."""
    commands = np.tile([0.5, 0.0], 60), np.tile([0.3, 0.0], 60)
    drive = drive_of(commands=commands, hold=2.0, duration=240.0)
    rows = slice(None, None, 50)
    angle = np.cumsum(drive.omega * ENCODER_STEP, axis=0)
    slow = Drive(drive.time[rows], np.diff(angle[rows], axis=0, prepend=0.0), drive.pose[rows])
    slow.omega[np.abs(slow.omega) < 0.1] = 0.0
    assert look_at(slow, *measured(drive)).gains.turn.value == pytest.approx(HUSKY.turn_gain, rel=0.03)
    rest = np.append(np.arange(1500.0, 3000.0, 0.02), [3000.0])
    still = Drive(
        np.concatenate([DRIVE.time, rest]),
        np.concatenate([DRIVE.omega, np.random.default_rng(0).normal(0, 1e-3, (len(rest), 2))]),
        DRIVE.pose,
    )
    assert holds(look_at(still).gains.turn, HUSKY.turn_gain)


@pytest.mark.parametrize(
    ("kind", "late"), [("poses", 6.0), ("positions", -30.0), ("headings", 112.0), ("poses", -1.7e9)]
)
def test_clocks_that_are_far_apart_are_told(kind, late):
    whose = "pose clock is ahead: subtract that from the times of the poses"
    if late < 0:
        whose = "encoder clock is ahead: subtract that from the times of the encoders"
    with pytest.raises(LogError, match=rf"run 'a': the clocks differ by {abs(late):.1f} s, as the {whose}"):
        look_at(time=TIME + late, pose=without(POSE, kind))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("late", [-0.3, 1.9])
def test_clocks_that_are_nearly_right_give_a_start_value(late, kind):
    found = look_at(time=TIME + late, pose=without(POSE, kind))
    assert found.clock == pytest.approx(-late, abs=0.05)
    assert found.alarms == ()


def test_poses_of_another_drive_are_not_a_matter_of_clocks():
    time, pose = measured(drive_of(seed=10))
    assert [alarm.kind for alarm in look_at(DRIVE, time, pose).alarms] == ["match"]
    with pytest.raises(LogError, match=r"encoders .* and poses \(1000 to 1120 s\) don't overlap: subtract"):
        look_at(DRIVE, time + 1000.0, pose)


def test_the_same_round_again_is_no_other_clock():
    around = np.tile([0.5, 0.5, 0.0, 0.0], 8), np.tile([0.0, 0.4, 0.4, 0.0], 8)
    drive = drive_of(commands=around)
    assert abs(look_at(drive, *measured(drive)).clock) < 0.05


@pytest.mark.parametrize("kind", ["poses", "positions"])
@pytest.mark.parametrize(
    ("rows", "offset", "parts", "words"),
    [
        (slice(600, 601), 3.0, 1, ["1 wild pose left out, first at t = 60 s"]),
        (slice(600, 602), 3.0, 1, ["2 wild poses left out, first at t = 60 s"]),
        (slice(600, None), 3.0, 2, ["1 lasting jump of its poses, first at t = 60 s"]),
        (slice(0, 2), -10.0, 1, ["1 lasting jump of its poses, first at t = 0.2 s"]),
    ],
)
def test_jumps_are_left_out_or_cut(rows, offset, parts, words, kind):
    pose = without(POSE, kind)
    pose[rows, 0] += offset
    found = look_at(pose=pose)
    assert holds(found.gains.turn, HUSKY.turn_gain)
    assert [line.split(": ")[1] for line in found.notes if line.startswith("run 'a'")] == words
    assert len(found.drives) == parts
    for part in found.drives:
        assert np.hypot(*np.diff(part.pose[:, :2], axis=0).T).max() < 0.3
