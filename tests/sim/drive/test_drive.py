import numpy as np
import pytest

from sim.drive.drive import Drive, DriveState
from sim.drive.motor import Motor
from trackslip.errors import InvalidValueError


def run_free(state, periods):
    """Let the sprockets turn without ground, and return the torques (periods, n, 2)."""
    forecast = state.forecast(periods)
    torque = state.torque_for(forecast, np.zeros_like(forecast.mean))
    state.accept(forecast, torque)
    return torque


def test_speed_and_angle_follow_a_first_order_lag_exactly():
    drive = Drive()
    state = DriveState(drive, 1, 0.06)
    state.command(np.array([[2.0, -1.0]]))
    run_free(state, 15)
    run_free(state, 5)
    time = 20 * drive.period
    grown = 1 - np.exp(-time / drive.lag)
    np.testing.assert_allclose(state.omega, [[2.0 * grown, -grown]], rtol=1e-12)
    np.testing.assert_allclose(state.angle[0, 0], 2.0 * (time - drive.lag * grown), rtol=1e-12)


def test_top_speed_is_at_the_track():
    state = DriveState(Drive(), 1, 0.06)
    state.command(np.array([[100.0, -100.0]]))
    run_free(state, 200)
    np.testing.assert_allclose(state.omega * 0.06, [[0.3, -0.3]])


def test_torque_turns_the_rotor_pulls_the_robot_and_is_lost_in_the_gear():
    drive = Drive()
    state = DriveState(drive, 1, 0.06)
    state.command(np.array([[2.0, 2.0]]))
    forecast = state.forecast(1)
    traction = np.array([[[30.0, -10.0]]])
    torque = state.torque_for(forecast, traction)
    speeding_up = forecast.omega[1] / drive.period
    expected = drive.motor.inertia * speeding_up + 0.06 * traction + drive.motor.friction
    np.testing.assert_allclose(torque, expected, rtol=1e-6)


def test_limits_are_the_current_and_the_torque_speed_line():
    motor = Motor(gear=10.0, no_load_speed=100.0, stall_torque=1.0, friction=0.1)
    state = DriveState(Drive(torque_limit=8.0, motor=motor), 1, 0.06)
    speed = np.array([0.0, 1.0, 5.0, 10.0])  # of the sprocket; the motor turns ten times as fast
    least, most = state.torque_range(speed)
    np.testing.assert_allclose(most, [8.0, 8.0, 5.0, 0.0])
    np.testing.assert_allclose(least, -8.0)  # a turning motor brakes with its whole current


def test_electrical_power_of_a_direct_current_motor():
    motor = Motor()
    torque, omega = np.array([2.0, -2.0, 30.0]), np.array([3.0, 3.0, 0.0])
    current = torque / motor.gear / motor.torque_constant
    voltage = motor.resistance * current + motor.torque_constant * motor.gear * omega
    np.testing.assert_allclose(motor.power(torque, omega), voltage * current)
    assert motor.power(torque, omega)[1] < 0  # it brakes and feeds back
    stalled = motor.gear * motor.stall_torque
    np.testing.assert_allclose(motor.power(np.array(stalled), np.array(0.0)), motor.voltage**2 / motor.resistance)


def test_encoder_counts():
    state = DriveState(Drive(encoder_counts=100), 1, 0.06)
    state.angle[:] = [[2 * np.pi * 0.519, -2 * np.pi * 0.001]]
    np.testing.assert_allclose(state.encoder_angle() / (2 * np.pi), [[0.51, -0.01]])


def test_set_points_must_be_finite():
    with pytest.raises(InvalidValueError, match="omega"):
        DriveState(Drive(), 1, 0.06).command(np.array([[np.nan, 1.0]]))
