from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from plain_drives import (
    ENCODER_STEP,
    HUSKY,
    Drive,
    Robot,
    drive_of,
    log_of,
    measured,
    table_of,
    weaving,
)

from trackslip.identification.identify import identify
from trackslip.identification.result import Identification
from trackslip.logs.runlog import RunLog
from trackslip.logs.table_reader import runs_from_table
from trackslip.odometry.identified import identified_law

DRIVE = drive_of()
TIME, POSE = measured(DRIVE)


@pytest.fixture(autouse=True)
def few_laws(monkeypatch):
    laws = ("none", "icr_radius", "icr_sides")
    monkeypatch.setattr("trackslip.identification.drive_comparison.drive_laws", lambda: laws)


def answer(*logs: RunLog, robot: Robot = HUSKY) -> Identification:
    return identify(logs, robot.geometry, method="drive")


def require_true(
    found: Identification, robot: Robot = HUSKY, offset: float = 0.003, error: float | None = None
):
    """D and ε within one and a half times their 95 % intervals, of half widths of at most `offset`
    [m] and `error`.

    Of 40 values, some are outside 95 % by chance; shares are tested in
    tests/validation/test_drive_coverage.py.
    """
    truths = {
        "offset": robot.offset,
        "wheel_separation_multiplier": 1 + robot.offset / robot.half_gauge,
    }
    widths = {"offset": offset, "wheel_separation_multiplier": offset / robot.half_gauge}
    if error is not None:
        truths["radius_error"] = robot.radius_error
        widths["radius_error"] = error
    for name, truth in truths.items():
        gain = found.answer[name]
        assert abs(gain.value - truth) <= 1.5 * gain.error, f"{name}: {truth} not in {gain}"
        assert gain.error < widths[name], name


@pytest.mark.parametrize(("rate", "late", "digits"), [(10.0, 0.0, 9), (1.0, 0.007, 3)])
def test_interpolated_poses(rate, late, digits):
    """Poses at the encoders' rows, linear between those that were measured, at these rows or
    between them.
    """
    time, pose = measured(DRIVE, pose_step=1 / rate)
    columns = [np.interp(DRIVE.time, time + late, column) for column in pose.T]
    between = np.column_stack(columns).round(digits)
    found = answer(log_of(DRIVE, DRIVE.time, between))
    knots = answer(log_of(DRIVE, time, pose))
    require_true(found, offset=0.0025, error=0.002)
    for name in ("offset", "radius_error"):
        assert found.answer[name].value == pytest.approx(knots.answer[name].value, abs=2e-4)
    assert any("interpolated poses ignored" in note for note in found.warnings)


def test_turns_to_one_side():
    step = np.arange(30)
    is_straight = step % 2 == 0
    direction = np.where(step % 4 == 0, 1, -1)
    v = np.where(is_straight, 0.3, 0.0) * direction
    w = np.where(is_straight, 0.0, 0.2)
    drive = drive_of(duration=240.0, commands=(v, w), hold=8.0)
    found = answer(log_of(drive, *measured(drive, position_noise=0.01, heading_noise=0.01)))
    require_true(found, offset=0.003, error=0.002)
    assert found.best != "none"
    assert found.alarms == ()


@pytest.mark.parametrize("seed", [5, 8])
def test_positions_alone_of_a_sensor_ahead(seed):
    drive = drive_of(duration=100.0, speed=0.5, yaw_rate=1.5, seed=seed)
    time, pose = measured(drive, pose_step=0.2, position_noise=0.01)
    arm = np.exp(1j * pose[:, 2]) * (0.2 - 0.06j)
    no_heading = np.full(len(time), np.nan)
    positions = np.column_stack([pose[:, 0] + arm.real, pose[:, 1] + arm.imag, no_heading])
    found = answer(log_of(drive, time, positions))
    require_true(found, offset=0.004)
    assert found.alarms == ()


@pytest.mark.parametrize("seed", [0, 8, 13])
def test_a_true_law_raises_no_alarm_on_a_minute_of_varying_slip(seed):
    drive = drive_of(duration=60.0, seed=seed, slip=0.02)
    assert answer(log_of(drive, *measured(drive))).alarms == ()


@pytest.mark.parametrize("factor", [2.5, 0.4])
def test_encoders_that_count_otherwise(factor):
    log = log_of(DRIVE.with_wheels(factor * DRIVE.omega), TIME, POSE)
    robot = replace(HUSKY, radius_error=0.97 / factor - 1)
    require_true(answer(log), robot, offset=0.001, error=0.001 / factor)


def squares(robot: Robot) -> list[RunLog]:
    """Start and end poses of five squares to each side, as in UMBmark."""
    logs = []
    for k in range(10):
        turn = np.pi / 8 * (1 if k < 5 else -1)
        v = np.array([0.5, 0.0] * 4 + [0.0, 0.0])
        w = np.array([0.0, turn] * 4 + [0.0, 0.0])
        drive = drive_of(robot, duration=33.0, commands=(v, w))
        time, pose = measured(drive, seed=k)
        logs.append(log_of(drive, time[[0, -1]], pose[[0, -1]], f"square {k}"))
    return logs


def test_start_and_end_poses():
    """Closed squares don't tell the mean radius, but its ratios to the others."""
    robot = Robot(half_gauge=0.1, radius=0.042, offset=0.004, radius_error=0.0025, unequal=0.0075)
    found = answer(*squares(robot), robot=robot)
    require_true(found, robot, offset=0.007)
    values = {name: gain.value for name, gain in found.answer.items()}
    left = values["left_wheel_radius_multiplier"]
    right = values["right_wheel_radius_multiplier"]
    assert right / left == pytest.approx(0.995 / 1.01, abs=0.001)
    apart = values["wheel_separation_multiplier"] / ((left + right) / 2)
    assert apart == pytest.approx(1.04 / 1.0025, abs=0.001)
    assert [*found.undetermined] == ["radius_error"]
    assert found.best == "diff_drive"  # a curvature to each side is no reason for another law
    assert found.alarms == ()


def test_ambiguous_whole_turns_between_rare_poses_are_an_alarm():
    """A wide robot that turned once looks like a narrow one that turned twice."""
    robot = Robot(half_gauge=0.1, radius=0.042, offset=0.08, radius_error=0.0, unequal=0.0075)
    (alarm,) = answer(*squares(robot), robot=robot).alarms
    assert alarm.kind == "circles"
    assert "wheel_separation_multiplier of 0.90" in alarm.line


def test_rare_positions_without_headings_are_an_alarm():
    robot = Robot(half_gauge=0.1, radius=0.042, offset=0.004, radius_error=0.0, unequal=0.0075)
    logs = [replace(log, pose=log.pose * [1, 1, np.nan]) for log in squares(robot)]
    alarms = answer(*logs, robot=robot).alarms
    assert any("measure headings" in alarm.line for alarm in alarms)


def test_wheels_and_headings_alone():
    k = np.arange(30)
    v = np.where(k % 3 == 0, 0.4, 0.0)
    w = np.choose(k % 3, [0.0, 0.8, -0.8])
    drive = drive_of(duration=90.0, commands=(v, w))
    headings = drive.pose * [np.nan, np.nan, 1.0]
    found = answer(log_of(drive, drive.time, headings))
    multiplier = found.answer["wheel_separation_multiplier"].value
    assert multiplier == pytest.approx(1 / HUSKY.turn_gain, abs=5e-4)
    assert found.drive.look.gains.speed is None
    for side in ("left", "right"):
        assert "measure positions" in found.undetermined[f"{side}_wheel_radius_multiplier"]


def test_wheels_and_a_gyro_alone():
    """The gyro has a bias and measures nothing for a while."""
    turned = np.gradient(DRIVE.pose[:, 2], ENCODER_STEP) + 0.02
    turned[2000:2050] = np.nan
    encoders = table_of(DRIVE, DRIVE.time, DRIVE.pose, "a").drop_columns(["x", "y", "phi"])
    table = encoders.append_column("gyro", pa.array(turned, from_pandas=True))
    (log,) = runs_from_table(table, "gyro.csv").runs
    found = answer(log)
    multiplier = found.answer["wheel_separation_multiplier"].value
    assert multiplier == pytest.approx(1 / HUSKY.turn_gain, abs=2e-3)
    assert found.alarms == ()


@pytest.mark.parametrize("unequal", [0.0, 0.01])
def test_the_radii_of_sides_that_differ_are_answered(unequal):
    robot = replace(HUSKY, unequal=unequal)
    drive = drive_of(robot, slip=0.02)
    found = answer(log_of(drive, *measured(drive)), robot=robot)
    require_true(found, robot, offset=0.008, error=0.01)
    for side, sign in (("left", 1), ("right", -1)):
        gain = found.answer[f"{side}_wheel_radius_multiplier"]
        true = 1 + robot.radius_error + sign * unequal
        assert abs(gain.value - true) <= 1.5 * gain.error
    assert found.expressible == ("diff_drive" if unequal else "icr_radius")
    assert ("diff_drive" in found.laws) == (unequal > 0)


def test_turns_in_place_tell_no_radius():
    turns = np.where(np.arange(40) % 2, 0.6, -0.6)
    drive = drive_of(commands=(np.zeros(40), turns), hold=3.0)
    found = answer(log_of(drive, *measured(drive)))
    for side in ("left", "right"):
        assert "drive straight" in found.undetermined[f"{side}_wheel_radius_multiplier"]
    multiplier = found.answer["wheel_separation_multiplier"].value
    assert multiplier == pytest.approx(1 / HUSKY.turn_gain, abs=0.02)


def test_straights_alone_tell_no_multiplier():
    speeds = np.tile([0.6, 0.2], 20)
    drive = drive_of(commands=(speeds, np.zeros(40)), hold=3.0)
    found = answer(log_of(drive, *measured(drive)))
    assert [alarm.kind for alarm in found.alarms] == ["turns"]
    assert found.answer["radius_error"].value == pytest.approx(HUSKY.radius_error, abs=1e-3)
    assert found.undetermined["wheel_separation_multiplier"].endswith("drive turns to both sides")
    assert np.isnan(found.answer["wheel_separation_multiplier"].value)


def test_all_readings_of_a_long_and_a_short_drive_are_used(monkeypatch):
    monkeypatch.setattr("trackslip.drives.conditioning.MOST_INTERVALS", 18_000)
    logs = []
    for name, count in (("long", 4500), ("short", 500), ("a copy", 500)):
        drive = drive_of(duration=count * 0.06, seed=count)
        time, pose = measured(drive, pose_step=0.06)
        logs.append(log_of(drive, time[:count], pose[:count], name))
    found = answer(*logs)
    (refused,) = found.outliers
    assert str(refused) == "run 'a copy' left out: a copy of run 'short'"
    assert found.drive.laws["icr_radius"].poses == 5000
    readings = sum(len(drive.omega) for drive in found.drive.look.drives)
    assert readings == 50 * 0.06 * 5000
    require_true(found, offset=0.001, error=0.001)


def test_sensor_and_drift_stay_small_if_one_speed_mixes_them():
    robot = Robot(half_gauge=0.188, radius=0.098, offset=0.11, radius_error=-0.02)
    drive = weaving(robot)
    time, pose = measured(drive, pose_step=0.2, position_noise=0.01)
    found = answer(log_of(drive, time, pose * [1.0, 1.0, np.nan]), robot=robot)
    require_true(found, robot, offset=0.06, error=0.01)
    extras = found.drive.laws["icr_radius"].extras
    assert abs(extras["sensor_x"]) < 0.4
    assert abs(extras["drift"]) < 0.6


def test_rare_readings_stand_in_the_middle_of_their_time():
    """Encoders that are read at 10 Hz and logged at 50 Hz."""
    last_read = np.arange(len(DRIVE.time)) // 5 * 5
    held = Drive(DRIVE.time, DRIVE.omega[last_read], DRIVE.pose)
    require_true(answer(log_of(held, TIME, POSE)), offset=0.001, error=0.001)


def test_a_short_drive_with_a_gyro_gives_a_law_without_intervals():
    drive = drive_of(duration=30.0)
    turned = np.gradient(drive.pose[:, 2], ENCODER_STEP) + 0.02
    table = table_of(drive, *measured(drive), "a")
    (log,) = runs_from_table(table.append_column("gyro", pa.array(turned)), "gyro.csv").runs
    found = answer(log)
    assert {alarm.kind for alarm in found.alarms} == {"little"}
    assert np.isnan(found.answer["offset"].low)
    assert identified_law(found).gyro.bias == pytest.approx(0.02, abs=0.005)
