"""Columns that hold something else: each is named in a line that says what to do."""

import numpy as np
import pytest
from looks import DRIVE, KINDS, POSE, holds, look_at, without
from plain_drives import ENCODER_STEP, HUSKY, Drive, Robot, drive_of, measured

from trackslip.errors import LogError


def refused(match, **log):
    with pytest.raises(LogError, match=match) as caught:
        look_at(**log)
    assert 40 < len(str(caught.value)) < 240


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda pose: pose * [1, 1, 180 / np.pi], r"column phi is in degrees .*: multiply it by pi/180"),
        (
            lambda pose: np.pi / 2 - pose * [0, 0, 1] + (pose - np.pi / 2) * [1, 1, 0],
            "phi runs clockwise by the course",
        ),
        (lambda pose: pose[:, [1, 0, 2]], "phi runs clockwise .*, or exchange x and y"),
        (lambda pose: pose * [1, 1, 0] + np.sin(pose / 2) * [0, 0, 1], r"looks like the z of a quaternion: give phi ="),
        (lambda pose: pose * [1000, 1000, 1], "x and y look like mm: divide them by 1000"),
        (lambda pose: pose * [1000, 1000, np.nan], "x and y look like mm: divide them by 1000"),
        (
            lambda pose: [8.5, 47, np.nan] + pose / (111_320 * np.array([np.cos(np.radians(47)), 1, 1])),
            "look like degrees of longitude and latitude",
        ),
        (
            lambda pose: (
                [-37, 144, np.nan] + pose[:, [1, 0, 2]] / (111_320 * np.array([1, np.cos(np.radians(-37)), 1]))
            ),
            "look like degrees of longitude and latitude",
        ),
    ],
)
def test_poses_in_other_units(change, match):
    refused(match, pose=change(POSE))


@pytest.mark.parametrize("seed", range(5))
def test_degrees_are_no_unit_of_the_wheels(seed):
    """By headings in degrees, distances may be as short as for speeds in deg/s."""
    robot = Robot(half_gauge=0.42, radius=0.11, offset=0.09, radius_error=0.025)
    drive = drive_of(robot, seed=seed, speed=1.1, yaw_rate=0.7)
    time, pose = measured(drive)
    refused("column phi is in degrees", drive=drive, time=time, pose=pose * [1, 1, 180 / np.pi], robot=robot)


def counts(omega: np.ndarray, per_turn: int) -> np.ndarray:
    """Ticks counted by each row."""
    return np.floor(np.cumsum(omega * ENCODER_STEP, axis=0) * per_turn / (2 * np.pi))


def ticks(drive: Drive, per_turn: int, wraps: int = 0) -> np.ndarray:
    """Speeds by a counter with ticks; one of so many steps is not unwrapped."""
    count = counts(drive.omega, per_turn)
    change = np.diff(count % wraps if wraps else count, axis=0, prepend=0.0)
    return change * 2 * np.pi / per_turn / ENCODER_STEP


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda w: w * HUSKY.radius, "look like m/s: divide them by sprocket_radius = 0.165 m"),
        (lambda w: np.degrees(w), "look like deg/s"),
        (lambda w: w * 60 / (2 * np.pi), "look like rpm"),
        (lambda w: w / (2 * np.pi), "look like turns per second: .*, or omega_l and omega_r look like m/s"),
        (lambda w: np.cumsum(w * ENCODER_STEP, axis=0), r"look like angles or ticks \(up to .*\), not speeds"),
        (lambda w: (np.cumsum(w * ENCODER_STEP, axis=0) + np.pi) % (2 * np.pi) - np.pi, "look like angles"),
        (lambda w: counts(w, 2048), "look like angles or ticks"),
        (lambda w: (counts(w, 2048) + 2**15) % 2**16 - 2**15, "look like angles or ticks"),
        (lambda w: counts(w, 2048) % 2048, "look like angles or ticks"),
        (lambda w: w * (np.arange(len(w)) % 4 == 0)[:, None], "columns omega_l and omega_r go to 0 and back .* times"),
    ],
)
def test_readings_of_encoders_that_are_no_speeds(change, match):
    refused(match, drive=DRIVE.with_wheels(change(DRIVE.omega)))


def test_a_counter_that_begins_anew():
    refused(
        r"column omega_. is .* rad/s at t = .* times its usual speed", drive=DRIVE.with_wheels(ticks(DRIVE, 400, 4096))
    )


@pytest.mark.parametrize("per_turn", [60, 4096])
def test_counters_with_few_or_many_ticks_pass(per_turn):
    found = look_at(DRIVE.with_wheels(ticks(DRIVE, per_turn)))
    assert holds(found.gains.turn, HUSKY.turn_gain)
    assert found.alarms == ()


def test_held_readings_count_once():
    found = look_at(DRIVE.with_wheels(DRIVE.omega[np.arange(len(DRIVE.time)) // 5 * 5]))
    assert "encoders are read less often than logged: held readings count once" in found.notes
    assert found.gains.turn.value == pytest.approx(HUSKY.turn_gain, rel=0.01)


@pytest.mark.parametrize("every", [5, 50])
def test_zeros_for_missing_poses(every):
    pose = np.zeros((len(DRIVE.time), 3))
    pose[::every] = POSE[:: every // 5]
    refused("columns x, y and phi go to 0 and back .* times: leave cells empty", time=DRIVE.time, pose=pose)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda w: w[:, ::-1], ": exchange omega_l and omega_r$"),
        (lambda w: w * [-1, 1], ": change the sign of omega_l, for a bag by --reversed left$"),
        (lambda w: w * [1, -1], ": change the sign of omega_r, for a bag by --reversed right$"),
        (lambda w: -w, ": change the sign of omega_l and omega_r, for a bag by --reversed both$"),
        (lambda w: -w[:, ::-1], "or turn phi by pi$"),
    ],
)
def test_sides_that_are_swapped_or_reversed(change, words, kind):
    drive, pose = DRIVE.with_wheels(change(DRIVE.omega)), without(POSE, kind)
    if kind != "poses":
        if "phi" in words:  # positions or headings alone look the same
            assert look_at(drive, pose=pose).alarms == ()
            return
        if words.startswith(": exchange") or "both" in words:
            words = "exchange omega_l and omega_r, or change the signs of both if they count backwards"
    refused(words, drive=drive, pose=pose)
