from dataclasses import replace

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, ICR, STILL, drive_log, without_poses
from scipy.interpolate import interp1d

from sim.wander.pose_sensor import PoseSensor
from trackslip.errors import LogError
from trackslip.kinematics import advance, body_twist
from trackslip.laws.base import NoSlip
from trackslip.logs.runlog import RunLog
from trackslip.odometry.evaluation import LENGTHS, odometry_errors
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.uncertainty import Gyro
from trackslip.se2 import Mounting

BY_LAW = SlipOdometry(ICR, GEOMETRY)
BY_NONE = SlipOdometry(NoSlip(), GEOMETRY)
PLACE = Mounting(0.3, -0.1, 0.2)
MOUNTED = PoseSensor(rate=7.0, ahead=PLACE.x, left=PLACE.y, mounting=PLACE.yaw, delay=0.15)


def relative(found):
    """All errors after metres and after seconds."""
    return [*found.after_metres.values(), *found.after_seconds.values()]


def largest(found):
    """The largest relative error of a position [m]."""
    return max(errors.position.largest for errors in relative(found))


def test_the_true_law_has_no_errors_and_another_has_some():
    log = drive_log(0, 60.0, EXACT, STILL)
    found = odometry_errors(log, BY_LAW)
    assert largest(found) < 1e-9
    assert all(errors.heading.largest < 1e-9 for errors in relative(found))
    assert tuple(found.after_metres) == LENGTHS[: len(found.after_metres)]
    assert tuple(found.after_seconds) == LENGTHS
    assert odometry_errors(log, BY_NONE).after_metres[5.0].position.rms > 0.1


def test_a_circle_is_wrong_by_its_law():
    """The turn of a circle is too large by a constant share, and the end is where the arcs
    differ.
    """
    twist = np.array([0.2, 0.4])
    omega = ICR.sprocket_speeds(twist, GEOMETRY)
    time = np.arange(0.0, 60.0, 0.02)
    pose = advance([0.0, 0.0, 0.0], twist, time)
    log = RunLog("circle", time, np.tile(omega, (len(time), 1)), pose)
    found = odometry_errors(log, BY_NONE)
    nominal = body_twist(omega, 0.0, GEOMETRY)
    for seconds, errors in found.after_seconds.items():
        reckoned = advance([0.0, 0.0, 0.0], nominal, seconds)
        true = advance([0.0, 0.0, 0.0], twist, seconds)
        distance = np.hypot(*(reckoned - true)[:2])
        turn = (nominal[1] - twist[1]) * seconds
        turn_per_metre = (nominal[1] - twist[1]) / nominal[0]
        assert errors.position.median == pytest.approx(distance, rel=1e-6)
        assert errors.heading.median == pytest.approx(turn, rel=1e-6)
        assert errors.heading.mean / errors.way == pytest.approx(turn_per_metre, rel=1e-3)
        assert errors.count == len(time) - round(seconds / 0.02)


def test_a_rest_begins_one_stretch_whatever_its_duration():
    """Half a circle, a rest, and half a circle: a longer rest changes no error."""
    omega = ICR.sprocket_speeds(np.array([0.2, 0.4]), GEOMETRY)

    def errors(rest: float):
        time = np.arange(0.0, 40.0 + rest, 0.05)
        drives = (time <= 20.0) | (time > 20.0 + rest)
        driven = np.cumsum(np.where(drives, 0.05, 0.0)) - 0.05
        pose = advance([0.0, 0.0, 0.0], np.array([0.2, 0.4]), driven)
        log = RunLog("rests", time, np.where(drives[:, None], omega, 0.0), pose)
        return odometry_errors(log, BY_NONE)

    short = errors(11.0)
    long = errors(30.0)
    for seconds, error in short.after_seconds.items():
        other = long.after_seconds[seconds]
        assert error.count == other.count
        assert error.position.median == pytest.approx(other.position.median)
    assert short.after_metres[2.0].count == long.after_metres[2.0].count
    assert short.after_metres[2.0].position.median > 0.1


def test_repeated_and_interpolated_poses_do_not_count():
    log = drive_log(1, 60.0, PoseSensor(rate=1.0), STILL).between(20, 3030)
    rows = np.flatnonzero(log.is_valid)
    for kind in ("previous", "linear"):
        filled = interp1d(log.time[rows], log.pose[rows].T, kind, fill_value="extrapolate")
        found = odometry_errors(replace(log, pose=filled(log.time).T, valid=None), BY_LAW)
        assert found.after_seconds[5.0].position.median < 1e-4
        assert found.after_seconds[5.0].count == pytest.approx(len(rows) - 5, abs=3)


def test_sensor_and_clock_are_allowed_for():
    log = drive_log(1, 40.0, MOUNTED, STILL)
    found = odometry_errors(log, BY_LAW, PLACE, clock_offset=-0.15)
    assert largest(found) < 1e-9
    without_mounting = odometry_errors(log, BY_LAW, Mounting(), -0.15)
    assert largest(without_mounting) > 0.01
    without_clock = odometry_errors(log, BY_LAW, PLACE, 0.0)
    assert largest(without_clock) > 0.01


def test_without_headings_earlier_positions_show_the_start():
    log = drive_log(3, 60.0, replace(EXACT, heading=False), STILL)
    found = odometry_errors(log, BY_LAW)
    (drive,) = found.trajectories
    np.testing.assert_allclose(drive.placed[:, :2], drive.measured[:, :2], atol=1e-6)
    assert found.after_metres[2.0].position.largest < 1e-6
    assert found.after_metres[2.0].heading is None
    assert found.after_metres[2.0].heading is None
    none = odometry_errors(log, BY_NONE).after_metres[2.0]
    assert none.position.rms > 0.05
    assert none.count > 100


def test_a_drive_without_poses_is_left_out_of_several():
    log = drive_log(7, 10.0, EXACT, STILL)
    empty = without_poses(replace(log, run="blind"), log.is_valid)
    found = odometry_errors([empty, log], BY_LAW)
    assert [drive.name for drive in found.trajectories] == ["drive 7"]
    message = "run 'blind': encoders were read at 0 of 0 measured poses, needs at least 2"
    assert found.notes[0] == message
    with pytest.raises(LogError, match="run 'blind': encoders were read at 0 of 0 measured"):
        odometry_errors(empty, BY_LAW)
    with pytest.raises(LogError, match="run 'drive 7': encoders were read at 0 of 100 measured"):
        odometry_errors(log, BY_LAW, clock_offset=1e6)


def test_a_gyro_alone_is_not_compared_with_itself():
    log = drive_log(7, 20.0, EXACT, STILL)
    rate = ICR.twist(log.omega, GEOMETRY)[:, 1]
    alone = replace(without_poses(log, log.is_valid), gyro=rate, beyond=None)
    found = odometry_errors(alone, BY_LAW)
    assert found.after_seconds[5.0].heading.largest < 1e-6
    with pytest.raises(LogError, match="only its gyro measures headings"):
        odometry_errors(alone, SlipOdometry(ICR, GEOMETRY, gyro=Gyro()))
