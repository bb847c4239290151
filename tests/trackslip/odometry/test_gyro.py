"""Odometry with a gyro: its turns instead of the law's, its bias at rest, and its uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drives import GEOMETRY, ICR, drive_log

from sim.wander.motion import LASTING, WHITE
from trackslip.odometry.evaluation import odometry_errors
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.uncertainty import Gyro, LawErrors, SlipNoise

NOISE = SlipNoise(WHITE.along, WHITE.across, WHITE.turning)
ERRORS = LawErrors(("offset", "radius_error"), np.diag([1e-3, 4e-3]) ** 2)
GYRO = Gyro(0.01, 0.02, 1e-3, 1e-3, 5e-3, -0.1)
TIME = 0.02 * np.arange(1501)


def readings(rate, gyro=GYRO):
    """Readings (...) of a gyro with these errors, without noise, at yaw rates (...)."""
    return rate * (1 + gyro.scale) + gyro.bias


def test_the_turn_is_the_gyros_and_the_speed_the_laws():
    omega = np.tile(ICR.sprocket_speeds([0.2, 0.3], GEOMETRY), (len(TIME), 1))
    path = SlipOdometry(ICR, GEOMETRY, gyro=GYRO).path(TIME, omega, np.full(len(TIME), readings(0.5)))
    exact = SlipOdometry(ICR, GEOMETRY).path(TIME, np.tile(ICR.sprocket_speeds([0.2, 0.5], GEOMETRY), (len(TIME), 1)))
    np.testing.assert_allclose(path.pose, exact.pose, atol=1e-9)


@pytest.mark.parametrize("gyro", [GYRO, None])
def test_step_by_step_is_the_same_as_the_whole_log(gyro):
    log = drive_log(0, 10.0)
    turned = readings(np.gradient(log.truth.pose[:, 2], log.time))
    turned[100:150] = np.nan
    odometry = SlipOdometry(ICR, GEOMETRY, NOISE, ERRORS, gyro=gyro)
    path = odometry.path(log.time, log.omega, turned)
    for k in range(1, len(log.time)):
        odometry.update(log.omega[k], log.time[k] - log.time[k - 1], turned[k])
    np.testing.assert_array_equal(odometry.pose, path.pose[-1])
    np.testing.assert_array_equal(odometry.covariance, path.covariance[-1])


def test_at_rest_it_learns_the_bias():
    """A minute at rest, then a spin: the heading is off by less than a tenth of what another bias would make it."""
    bias, omega = 0.03, np.zeros((6001, 2))
    time = 0.02 * np.arange(6001)
    omega[3001:] = ICR.sprocket_speeds([0.0, 0.5], GEOMETRY)
    turned = np.where(np.arange(6001) > 3000, 0.5, 0.0) + bias
    path = SlipOdometry(ICR, GEOMETRY, gyro=Gyro(bias=0.01)).path(time, omega, turned)
    np.testing.assert_allclose(path.pose[:3001, 2], 0.0, atol=1e-12)
    assert abs(path.pose[-1, 2] - 30.0) < 0.1 * (bias - 0.01) * 60
    assert path.covariance[-1, 2, 2] == 0.0  # of a gyro without errors


def test_the_variance_of_the_heading_is_that_of_a_gyro():
    omega = np.tile(ICR.sprocket_speeds([0.2, 0.0], GEOMETRY), (len(TIME), 1))
    for rate in (0.0, 0.4):
        path = SlipOdometry(ICR, GEOMETRY, NOISE, ERRORS, gyro=GYRO).path(
            TIME, omega, np.full(len(TIME), readings(rate))
        )
        time = TIME[-1]
        expected = GYRO.noise**2 * time + (GYRO.bias_error * time) ** 2 + (GYRO.scale_error * time * rate) ** 2
        assert path.covariance[-1, 2, 2] == pytest.approx(expected / (1 + GYRO.scale) ** 2, rel=1e-9)


def test_on_slip_that_lasts_it_is_far_better():
    log = drive_log(2, 60.0, variation=LASTING)
    rate = np.append(0.0, np.diff(log.truth.pose[:, 2]) / np.diff(log.time))
    late = np.interp(log.time - 0.1, log.time, readings(rate))
    truth = replace(log, pose=log.truth.pose, valid=None, gyro=late)
    plain, gyro = (
        odometry_errors(truth, SlipOdometry(ICR, GEOMETRY, gyro=one)).after_seconds[10.0]
        for one in (None, replace(GYRO, clock=0.1))
    )
    assert gyro.heading.rms < 0.2 * plain.heading.rms
    assert gyro.position.rms < 0.75 * plain.position.rms
