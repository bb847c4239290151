from dataclasses import replace

import numpy as np
import pytest

from trackslip.drives.conditioning import drive_of, drives_of
from trackslip.drives.gyro import with_usable_gyro, yaw_axis
from trackslip.errors import LogError
from trackslip.logs.runlog import RunLog

TIME = 0.05 * np.arange(800)
NOISE = np.random.default_rng(0).normal(0.01, 0.01, len(TIME))  # with a bias
OTHER = np.random.default_rng(1).normal(0, 0.2, len(TIME))


def log_of(rate):
    """A robot that drives and turns at yaw rates (T,), by a gyro with a little noise and bias."""
    heading = np.append(0.0, np.cumsum(rate[1:] * np.diff(TIME)))
    ahead = 0.05 * 0.3 * np.exp(1j * heading)
    place = np.cumsum(ahead) - ahead[0]
    pose = np.column_stack([place.real, place.imag, heading])
    omega = 5 + 5 * rate[:, None] * [-1, 1]
    return RunLog("a", TIME, omega, pose, gyro=rate + NOISE)


WEAVING = log_of(0.6 * np.sin(0.5 * TIME))
CIRCLE = log_of(np.full(len(TIME), 0.4))


def without_headings(log):
    return replace(log, pose=log.pose * [1, 1, np.nan])


@pytest.mark.parametrize("log", [WEAVING, CIRCLE, without_headings(CIRCLE)])
def test_a_gyro_that_follows_the_robot_is_used(log):
    assert with_usable_gyro(log) == (log, "")
    turned = drive_of(log).gyro[-1, 1]
    assert turned == pytest.approx((log.gyro[1:] * np.diff(TIME)).sum())


@pytest.mark.parametrize(
    ("factor", "shown"), [(180 / np.pi, "57.3"), (-1.0, "-1"), (1e-3, "0.001")]
)
def test_another_unit_or_sign_is_refused(factor, shown):
    log = replace(WEAVING, gyro=factor * WEAVING.gyro)
    match = f"run 'a': gyro: it turns {shown} times as far as the headings: it must be in rad/s"
    with pytest.raises(LogError, match=match):
        drive_of(log)


def test_without_headings_the_sprockets_tell_a_wrong_sign():
    log = without_headings(replace(WEAVING, gyro=-WEAVING.gyro))
    with pytest.raises(LogError, match="gyro: it turns against the sprockets"):
        drive_of(log)


@pytest.mark.parametrize("rate", [OTHER, np.gradient(WEAVING.gyro, TIME)])
def test_a_gyro_that_does_not_follow_the_robot_is_left_out(rate):
    drive = drive_of(replace(WEAVING, gyro=rate))
    assert drive.gyro is None
    assert "run 'a': gyro left out: its turns don't follow the headings" in drive.notes[0]


def test_a_robot_that_hardly_turns_tells_nothing_of_its_gyro():
    log = log_of(np.zeros(len(TIME)))
    _, message = with_usable_gyro(replace(log, gyro=OTHER))
    assert message == ""


@pytest.mark.parametrize("log", [WEAVING, CIRCLE])
@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -1), (0.6, 0, 0.8)])
def test_the_yaw_axis_is_that_of_the_robots_turns(log, axis):
    found = yaw_axis(log, np.outer(axis, log.pose[:, 2]))
    assert found.found
    np.testing.assert_allclose(found.axis, axis, atol=1e-9)


def test_a_biased_imu_on_a_circle_has_its_yaw_axis():
    turned = np.outer([0, 0, 1], CIRCLE.pose[:, 2])
    bias = 0.01 * TIME
    found = yaw_axis(CIRCLE, turned + bias)
    np.testing.assert_allclose(found.axis, [0, 0, 1], atol=0.05)


def test_an_imu_of_another_robot_has_no_yaw_axis():
    others = np.random.default_rng(2).normal(size=(3, len(TIME))).cumsum(axis=1)
    assert yaw_axis(WEAVING, others) is None


def test_a_gyro_on_its_own_has_no_interpolated_poses():
    """Yaw rates that hold for a second give headings on lines."""
    last_second = np.arange(len(TIME)) // 20 * 20
    nowhere = np.full((len(TIME), 3), np.nan)
    never = np.zeros(len(TIME), bool)
    alone = replace(WEAVING, pose=nowhere, valid=never, gyro=WEAVING.gyro[last_second])
    (drive,), _ = drives_of([alone])
    assert drive.interpolated == 0
    assert drive.repeated == 0
    assert len(drive.time) == len(TIME)
