"""The first look: clean logs pass, and what they are is told."""

import json

import numpy as np
import pytest
from looks import DRIVE, KINDS, POSE, holds, look, look_at, without
from plain_drives import ENCODER_STEP, HUSKY, Drive, Robot, drive_of, log_of, measured

from trackslip.identification.preparation import drives_of

SMALL = Robot(0.1, 0.04, 0.03)
LARGE = Robot(1.0, 0.3, 0.6)
SKIDDING = Robot(0.25, 0.1, 0.4)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("robot", "driving", "poses"),
    [
        (HUSKY, {}, {}),
        (HUSKY, {"slip": 0.05}, {"pose_step": 1.0, "position_noise": 0.02}),
        (HUSKY, {"duration": 400.0, "hold": 10.0}, {"pose_step": 0.04, "position_noise": 0.02, "heading_noise": 0.02}),
        (SMALL, {"speed": 0.2, "yaw_rate": 0.6}, {"position_noise": 0.002}),
        (LARGE, {"speed": 2.0, "yaw_rate": 0.5, "slip": 0.05}, {"pose_step": 0.2, "position_noise": 0.02}),
        (SKIDDING, {"speed": 3.0, "yaw_rate": 1.0}, {"pose_step": 0.2}),
    ],
)
def test_clean_logs_have_no_alarm_and_gains_that_hold_the_truth(robot, driving, poses, kind):
    drive = drive_of(robot, seed=3, **driving)
    time, pose = measured(drive, **poses)
    log = log_of(drive, time, without(pose, kind))
    found = look(log, robot=robot)
    assert found.alarms == ()
    assert holds(found.turn, robot.turn_gain)
    assert found.speed is None if kind == "headings" else holds(found.speed, 1 + robot.radius_error)
    assert abs(found.clock) < 0.08
    assert found.without_jumps(drives_of([log])[0], robot.geometry)[1] == []
    words = {"poses": "poses", "positions": "positions without headings", "headings": "headings without positions"}
    assert found.notes[0].startswith(f"{words[kind]} every")
    assert json.dumps(found.to_json(), allow_nan=False)


@pytest.mark.parametrize("noise", [0.005, 0.03])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("speeds", "yaw_rates", "tells"),
    [
        ([0.5, -0.3], [0.0, 0.0], "speed"),
        ([0.5, 0.5], [0.0, 0.0], "speed"),
        ([0.0, 0.0], [0.6, -0.6], "turn"),
        ([0.0, 0.0], [0.5, 0.5], "turn"),
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
    assert holds(found.turn, HUSKY.turn_gain) if turns else found.turn is None
    assert holds(found.speed, 0.97) if tells != "turn" and kind != "headings" else found.speed is None


def test_intervals_hold_the_truth_as_often_as_they_say():
    hits = []
    for seed in range(30):
        drive = drive_of(seed=seed, slip=0.03)
        found = look_at(drive, *measured(drive, pose_step=0.5, seed=100 + seed))
        pairs = (found.speed, 1 + HUSKY.radius_error), (found.turn, HUSKY.turn_gain)
        hits += [gain.low <= truth <= gain.high for gain, truth in pairs]
    assert np.mean(hits) > 0.87  # 0.95 less twice 0.04


def test_repeated_poses_count_once():
    found = look_at(pose=POSE[np.arange(len(POSE)) // 3 * 3])
    assert any("poses repeat the one before: each counts once" in note for note in found.notes)


def test_turns_to_one_side_pass_with_a_note():
    step = np.arange(40)
    commands = np.where(step % 2 == 0, 0.3, 0.0) * np.where(step % 4 == 0, 1, -1), np.where(step % 2 == 1, 0.2, 0.0)
    drive = drive_of(duration=320.0, commands=commands, hold=8.0)
    found = look_at(drive, *measured(drive))
    assert "turns to the left only: unequal sides can't be told from the turns" in found.notes
    assert found.right_turns < 0.1 < 20 < found.left_turns
    assert found.straight == pytest.approx(0.3 * 160, rel=0.15)
    assert found.top_speed == pytest.approx(0.3, rel=0.1)
    assert holds(found.turn, HUSKY.turn_gain)


def test_a_sensor_anywhere_and_turned_changes_no_gain():
    heading = POSE[:, 2]
    arm = np.exp(1j * heading) * (0.4 - 0.2j)
    pose = np.column_stack([POSE[:, 0] + arm.real, POSE[:, 1] + arm.imag, heading + 1.2])
    found = look_at(pose=pose)
    assert holds(found.speed, 0.97)
    assert found.gains.arm == pytest.approx(0.4 - 0.2j, abs=0.01)
    assert found.gains.heading == pytest.approx(1.2, abs=0.01)


def test_a_short_drive_is_an_alarm_and_has_no_intervals():
    drive = drive_of(duration=30.0)
    found = look_at(drive, *measured(drive))
    assert [alarm.line for alarm in found.alarms] == ["30 s of driving are too few for intervals: drive 60 s"]
    assert found.to_json()["speed"] == {"value": found.speed.value, "low": None, "high": None}


def test_stops_and_rare_motion_are_no_missing_readings():
    """Encoders at 1 Hz of a robot that stops and goes, and a robot that stands for most of an hour."""
    commands = np.tile([0.5, 0.0], 60), np.tile([0.3, 0.0], 60)
    drive = drive_of(commands=commands, hold=2.0, duration=240.0)
    rows = slice(None, None, 50)
    angle = np.cumsum(drive.omega * ENCODER_STEP, axis=0)
    slow = Drive(drive.time[rows], np.diff(angle[rows], axis=0, prepend=0.0), drive.pose[rows])
    slow.omega[np.abs(slow.omega) < 0.1] = 0.0
    assert look_at(slow, *measured(drive)).turn.value == pytest.approx(HUSKY.turn_gain, rel=0.03)
    rest = np.append(np.arange(1500.0, 3000.0, 0.02), [3000.0])
    still = Drive(
        np.concatenate([DRIVE.time, rest]),
        np.concatenate([DRIVE.omega, np.random.default_rng(0).normal(0, 1e-3, (len(rest), 2))]),
        DRIVE.pose,
    )
    assert holds(look_at(still).turn, HUSKY.turn_gain)
