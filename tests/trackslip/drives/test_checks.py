"""Checks of logs whose poses are seconds or minutes apart, and checks without evidence."""

import re
from dataclasses import dataclass

import numpy as np
import pytest
from plain_drives import (
    DRIVE,
    ENCODER_STEP,
    HUSKY,
    POSE,
    TIME,
    Robot,
    drive_of,
    log_of,
    look,
    look_at,
    measured,
    without,
)

from trackslip.drives.checks import Check, Verdict, unknown_lines
from trackslip.drives.first_look import Look
from trackslip.drives.gains import Window
from trackslip.drives.misread import Ratios, matches_of, units_check
from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

CARRIER = Robot(half_gauge=0.31, radius=0.185, offset=0.0016, radius_error=0.004, unequal=-0.004)


def around_blocks(
    change_omega=lambda omega: omega, change_pose=lambda pose: pose, sides=(3, 4)
) -> list[RunLog]:
    """Drives along three or four sides of a block, with a pose at both ends."""
    logs = []
    for k in range(12):
        count = sides[k % 4 // 2]
        turn = np.pi / 8 * (1 if k % 2 else -1)
        stretch = 0.4 + 0.03 * k
        v = np.array([stretch, stretch, 0.0] * count + [0.0])
        v[0] *= 2  # so that three sides end ahead of their start, not only beside it
        w = np.array([0.0, 0.0, turn] * count + [0.0])
        drive = drive_of(CARRIER, duration=4.0 * len(v), commands=(v, w))
        ends = [0, -1]
        noise = np.random.default_rng(k).normal(size=(2, 3)) * 0.002
        pose = change_pose(drive.pose[ends] + noise)
        drive = drive.with_wheels(change_omega(drive.omega))
        logs.append(log_of(drive, drive.time[ends], pose, f"drive {k}"))
    return logs


def verdicts(found: Look) -> dict[str, Verdict]:
    return {check.subject: check.verdict for check in found.checks}


def test_start_and_end_poses_that_are_right_hold():
    found = look(*around_blocks(), robot=CARRIER)
    unknown = {name for name, verdict in verdicts(found).items() if verdict is not Verdict.HOLDS}
    assert unknown == {"clocks"}
    assert "clocks can't be checked: 24 poses, 46 s apart" in found.notes
    assert found.alarms == ()


@dataclass(frozen=True)
class Misread:
    line: str  # what the refusal says
    omega: float = 1.0  # factor on the speeds
    pose: tuple[float, float, float] = (1.0, 1.0, 1.0)  # factors on x, y and phi
    sides: tuple[int, int] = (0, 1)  # columns of the speeds of the left and right sides


MISREAD = {
    "clockwise": Misread("column phi runs clockwise .*: change its sign", pose=(1, 1, -1)),
    "mirrored": Misread("columns x and y are mirrored .*: change the sign of y", pose=(1, -1, 1)),
    "mm": Misread("x and y look like mm: divide them by 1000", pose=(1e3, 1e3, 1)),
    "cm": Misread("x and y look like cm: divide them by 100", pose=(1e2, 1e2, 1)),
    "degrees": Misread("column phi is in degrees", pose=(1, 1, 180 / np.pi)),
    "swapped": Misread("tracks are swapped .*: exchange omega_l and omega_r", sides=(1, 0)),
    "rpm": Misread("omega_l and omega_r look like rpm", omega=30 / np.pi),
    "turns": Misread("look like turns per second", omega=0.5 / np.pi),
}


@pytest.mark.parametrize("kind", MISREAD)
def test_start_and_end_poses_that_are_misread_are_refused(kind):
    misread = MISREAD[kind]
    logs = around_blocks(
        change_omega=lambda omega: misread.omega * omega[:, misread.sides],
        change_pose=lambda pose: pose * misread.pose,
    )
    with pytest.raises(LogError, match=misread.line):
        look(*logs, robot=CARRIER)


def test_closed_squares_do_not_tell_the_sides():
    found = look(*around_blocks(sides=(4, 4)), robot=CARRIER)
    (line,) = [note for note in found.notes if "can't be checked" in note]
    assert "sides of the tracks" in line
    assert line.endswith("can't be checked: 24 poses, 52 s apart")


def rare(every: float, kind: str = "poses", late: float = 0.0) -> tuple[Array, Array]:
    """Poses of a drive of five minutes, each some seconds after the one before."""
    time, pose = measured(LONG, pose_step=every, position_noise=0.01)
    return time + late, without(pose, kind)


LONG = drive_of(duration=300.0, seed=4, slip=0.03)


@pytest.mark.parametrize("every", [5.0, 12.0])
@pytest.mark.parametrize("kind", ["poses", "positions"])
def test_rare_poses_that_are_right_hold(every, kind):
    time, pose = rare(every, kind)
    found = look_at(LONG, time, pose)
    assert verdicts(found)["sides of the tracks"] is Verdict.HOLDS
    assert verdicts(found)["units"] is Verdict.HOLDS
    assert found.alarms == ()


@pytest.mark.parametrize("kind", ["poses", "positions", "headings"])
def test_swapped_sides_are_found_by_rare_poses_of_any_kind(kind):
    time, pose = rare(5.0, kind)
    with pytest.raises(LogError, match="exchange omega_l and omega_r"):
        look_at(LONG.with_wheels(LONG.omega[:, ::-1]), time, pose)


def test_degrees_that_wrap_are_found_by_rare_poses():
    time, pose = rare(8.0)
    pose[:, 2] = (np.degrees(pose[:, 2]) + 180) % 360 - 180
    with pytest.raises(LogError, match="column phi is in degrees"):
        look_at(LONG, time, pose)


TURNING = np.random.default_rng(0).random(134) < 0.3
SIDE = np.random.default_rng(1).choice([-0.5, 0.5], 134)
CORRIDOR = drive_of(
    duration=400.0,
    commands=(np.where(TURNING, 0.0, 0.5), np.where(TURNING, SIDE, 0.0)),
    hold=3.0,
)


@pytest.mark.parametrize("every", [2.0, 4.0, 8.0])
@pytest.mark.parametrize("late", [3.0, -7.0, 18.7, 60.0])
def test_clocks_are_found_over_the_whole_length(every, late):
    time, pose = measured(CORRIDOR, pose_step=every)
    with pytest.raises(LogError, match="the clocks differ by") as caught:
        look_at(CORRIDOR, time + late, pose)
    differ = float(re.search(r"differ by ([\d.]+) s", str(caught.value)).group(1))
    assert differ == pytest.approx(abs(late), abs=0.15)


@pytest.mark.parametrize(
    "every",
    [
        2.0,
        pytest.param(4.0, marks=pytest.mark.slow),
        pytest.param(8.0, marks=pytest.mark.slow),
        12.0,
    ],
)
def test_clocks_of_rare_poses_that_are_right_hold(every):
    found = look_at(CORRIDOR, *measured(CORRIDOR, pose_step=every))
    assert verdicts(found)["clocks"] is Verdict.HOLDS
    assert abs(found.clock) < 0.2


def test_rare_poses_of_few_minutes_do_not_tell_clocks():
    time, pose = measured(DRIVE, pose_step=20.0)
    assert verdicts(look_at(DRIVE, time, pose))["clocks"] is Verdict.UNKNOWN


def test_checks_on_a_straight_are_not_passed_in_silence():
    speeds = np.tile([0.6, 0.2], 20)
    drive = drive_of(commands=(speeds, np.zeros(40)), hold=3.0)
    found = look_at(drive, *measured(drive))
    line = "sides of the tracks, direction of headings and axes of positions can't be checked"
    assert f"{line}: the robot hardly turns" in found.notes


def test_unknown_checks_with_one_reason_are_one_line():
    checks = [
        Check("headings", Verdict.UNKNOWN, "10 poses, 33 s apart"),
        Check("units", Verdict.HOLDS),
        Check("sides", Verdict.UNKNOWN, "10 poses, 33 s apart"),
    ]
    assert unknown_lines(checks) == ["headings and sides can't be checked: 10 poses, 33 s apart"]


@pytest.mark.parametrize("gain", [0.05, 1.0, 3.0])
def test_counts_are_an_alarm_at_any_gain(gain):
    """Counts since the last reading that happen to be speeds in rad/s times a gain."""
    angle = np.cumsum(DRIVE.omega * ENCODER_STEP, axis=0)
    count = np.floor(angle / ENCODER_STEP / gain)
    counts = np.diff(count, axis=0, prepend=0.0)
    found = look_at(DRIVE.with_wheels(counts))
    (alarm,) = [alarm for alarm in found.alarms if alarm.kind == "units"]
    assert alarm.line.startswith("omega_l and omega_r are whole numbers")


def test_commands_in_whole_rad_per_second_are_no_counts():
    commands = np.repeat([[3, 5], [4, 4], [-2, -4], [5, 3], [2, -2]] * 5, 4, axis=0)
    rows = np.minimum((DRIVE.time / 1.2).astype(int), len(commands) - 1)
    omega = commands[rows].astype(float)
    left, right = omega.T * HUSKY.radius
    v = (left + right) / 2
    w = (right - left) / (2 * HUSKY.half_gauge)
    step = np.append(0.0, np.diff(DRIVE.time))
    heading = np.cumsum(w * step)
    place = np.cumsum(v * step * np.exp(1j * heading))
    pose = np.column_stack([place.real, place.imag, heading])[::5]
    found = look_at(DRIVE.with_wheels(omega), DRIVE.time[::5], pose)
    assert verdicts(found)["counts"] is Verdict.HOLDS
    assert found.alarms == ()


def test_a_wrong_unit_of_positions_and_a_gear_are_told_apart():
    """By the turns, which depend on the gear, but not on the unit of positions."""
    with pytest.raises(LogError, match="x and y look like cm"):
        look_at(pose=POSE * [100, 100, 1])
    (alarm,) = look_at(DRIVE.with_wheels(DRIVE.omega / 20), TIME, POSE).alarms
    assert alarm.line.endswith("check the unit of omega, the gear and sprocket_radius")


def window_of(distance, turn, moved, turned):
    return Window(distance, turn, moved + 0j, turned, np.arange(len(distance)))


def test_matches_are_correlations_while_the_wheels_move():
    """Of poses that move twice as far, at an angle of 60 deg to the robot, and turn the other way;
    one isn't known.
    """
    distance = 0.3 * np.cos(np.arange(20.0))
    turn = 0.2 * np.sin(np.arange(20.0))
    moved = 2 * distance * np.exp(1j * np.pi / 3)
    moved[3] = np.nan
    found = matches_of(window_of(distance, turn, moved, -turn))
    np.testing.assert_allclose(found, [1.0, np.cos(np.pi / 3), -1.0])

    # without headings, only the sizes of motions are known
    unknown = np.full(20, np.nan)
    found = matches_of(window_of(distance, turn, np.abs(moved), unknown))
    np.testing.assert_allclose(found[0], 1.0)
    assert len(found) == 1

    # wheels that move by less than 5 cm or 0.05 rad, rms, tell nothing
    for of_distance, of_turn, count in ((0.3, 0.3, 2), (0.2, 0.4, 1), (0.2, 0.3, 0)):
        found = matches_of(window_of(of_distance * distance, of_turn * turn, moved, turn))
        assert len(found) == count


# how much farther the poses seem to move than the wheels, for each wrong unit
RATIO_OF_UNITS = {
    "omega_l and omega_r look like deg/s: multiply them by pi/180": np.pi / 180,
    "omega_l and omega_r look like rpm: multiply them by 2 pi/60": 2 * np.pi / 60,
    "omega_l and omega_r look like turns per second: multiply them by 2 pi": 2 * np.pi,
    "omega_l and omega_r look like m/s: divide them by sprocket_radius = 0.165 m": 1 / 0.165,
    "omega_l and omega_r look like mm/s: divide them by sprocket_radius = 165 mm": 1 / 165,
    "x and y look like mm: divide them by 1000": 1000.0,
    "x and y look like cm: divide them by 100": 100.0,
    "t looks like ms: divide it by 1000": 1e-3,
    "t looks like µs: divide it by 1e6": 1e-6,
    "t looks like ns: divide it by 1e9": 1e-9,
}


def units(speed, turn):
    """The check of units for these ratios of distances and turns to the wheels'."""
    return units_check([], None, Ratios(speed, turn), HUSKY.geometry)


@pytest.mark.parametrize(("line", "ratio"), RATIO_OF_UNITS.items())
def test_every_wrong_unit_is_found_from_its_factor(line, ratio):
    """The robot turns half as far as its wheels say, or its turns aren't known."""
    turn = 0.5 if line.startswith("x and y") else 0.5 * ratio
    for known_turn in (turn, None):
        found = units(ratio, known_turn)
        assert found.verdict is Verdict.FAILS
        assert f"{ratio:.4g}" in found.line.partition("(")[2]
        assert line in found.line


@pytest.mark.parametrize(
    ("off", "turn", "fails"),
    [
        (1.15, 0.5, True),  # turns tell that omega is right
        (0.85, 0.5, True),
        (1.25, 0.5, False),
        (1.04, None, True),
        (0.96, None, True),
        (1.15, None, False),
        (0.85, None, False),
    ],
)
def test_turns_tell_a_unit_of_positions_from_a_gain(off, turn, fails):
    """A robot with another gain than 1, and poses in cm."""
    assert units(100.0 * off, turn).verdict is (Verdict.FAILS if fails else Verdict.HOLDS)


def test_turns_that_no_robot_makes_are_no_matter_of_units():
    rpm = 2 * np.pi / 60
    for share, fails in ((0.19, False), (0.21, True), (1.24, True), (1.26, False)):
        verdict = Verdict.FAILS if fails else Verdict.HOLDS
        assert units(rpm, share * rpm).verdict is verdict
        assert units(1000.0, share).verdict is verdict
    assert units(1.0, 0.5).verdict is Verdict.HOLDS


def test_speeds_of_the_world_are_not_called_degrees():
    """As in an odometry's twist whose frame is that of the world."""
    v = np.gradient(DRIVE.pose[:, 0], ENCODER_STEP)
    w = np.gradient(DRIVE.pose[:, 2], ENCODER_STEP)
    aside = HUSKY.half_gauge * w
    omega = np.column_stack([v - aside, v + aside]) / HUSKY.radius
    try:
        lines = [alarm.line for alarm in look_at(DRIVE.with_wheels(omega)).alarms]
    except LogError as error:
        lines = [str(error)]
    assert not any("degrees" in line for line in lines)
