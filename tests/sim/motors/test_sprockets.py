import numpy as np
import pytest

from sim import Fleet, Ground
from sim.motors.motor import Drive, Motor
from sim.motors.sprockets import Sprockets

GRAVITY = 9.81
MOTOR = Motor()


def on_slope(robot, slope, drive):
    """A robot that is told to drive uphill, on ground that has just become steep."""
    fleet = Fleet(robot, np.zeros((1, 3)), radius_error=0.0, drive=drive)
    fleet.set_ground(Ground(slope=slope))
    fleet.command([3.0, 3.0])
    return fleet


def torque_of_weight(robot, slope):
    force = robot.mass * GRAVITY * np.sin(slope) / 2
    return force * robot.geometry.sprocket_radius


@pytest.mark.parametrize(("slope", "limit", "period"), [(0.3, 1.0, 0.005), (0.15, 0.6, 0.01)])
def test_a_weak_robot_rolls_back_with_the_inertia_of_its_rotors(robot, slope, limit, period):
    """The gear's friction holds it too, and the rotors count for more than their weight: gears
    square it.
    """
    fleet = on_slope(robot, slope, Drive(torque_limit=limit, period=period))
    radius = robot.geometry.sprocket_radius
    inert = robot.mass + 2 * MOTOR.inertia / radius**2
    missing = torque_of_weight(robot, slope) - limit - MOTOR.friction
    acceleration = -2 * missing / radius / inert
    fleet.advance(0.5)
    before = fleet.twist()[0, 0]
    fleet.advance(0.5)
    gained = fleet.twist()[0, 0] - before
    assert gained == pytest.approx(0.5 * acceleration, rel=0.01)
    tolerance = 0.001 * limit + 0.0002 * robot.mass * GRAVITY * 0.06
    np.testing.assert_allclose(fleet.drive.torque, limit, atol=tolerance)
    np.testing.assert_allclose(fleet.drive.saturated_time, 1.0, atol=0.02)


def test_power_of_a_steady_turn_is_what_is_dissipated(robot):
    """What the ground takes follows from Coulomb's law at every point of contact."""
    ground = Ground(0.6, 0.7)
    error = 0.02
    fleet = Fleet(robot, np.zeros((2, 3)), ground, error)
    fleet.command([[1.0, 3.0], [-2.0, 2.0]])
    fleet.advance(3.0)
    before = fleet.drive.energy.copy()
    fleet.advance(1.0)
    power = (fleet.drive.energy - before).sum(axis=1)
    x, y = robot.contact_points.T
    left = fleet.drive.omega[:, :1]
    right = fleet.drive.omega[:, 1:]
    belts = np.where(y > 0, left, right) * 0.06 * (1 + error)
    v, u, w = fleet.twist().T[:, :, None]
    along = ground.along * (v - w * y - belts)
    across = ground.across * (u + w * x)
    in_ground = robot.mass * GRAVITY * np.hypot(along, across).mean(axis=1)
    in_gear = (MOTOR.loss(fleet.drive.omega) * fleet.drive.omega).sum(axis=1)
    current = fleet.drive.torque / (MOTOR.gear * MOTOR.torque_constant)
    in_winding = (MOTOR.resistance * current**2).sum(axis=1)
    np.testing.assert_allclose(power, in_ground + in_gear + in_winding, rtol=0.01)


def test_one_motor_too_weak_to_turn_keeps_the_robot_straight(robot):
    """The right motor can't slide its track: it pushes all it can, and the left one brakes it to
    its own set point.
    """
    start = np.zeros((1, 3))
    strong = Fleet(robot, start, radius_error=0.0, drive=Drive(torque_limit=8.0))
    weak = Fleet(robot, start, radius_error=0.0, drive=Drive(torque_limit=1.5))
    for fleet in (strong, weak):
        fleet.command([2.0, 3.0])
        fleet.advance(2.0)
    assert abs(weak.twist()[0, 2]) < 0.01 * strong.twist()[0, 2]
    np.testing.assert_allclose(weak.drive.omega[0], 2.0, rtol=3e-3)
    assert weak.drive.torque[0, 1] == pytest.approx(1.5, rel=0.02)
    # straight and steady: the tracks' forces cancel but for what the gears take
    assert weak.drive.torque.sum() == pytest.approx(2 * MOTOR.friction, rel=0.02)
    assert weak.drive.saturated_time[0, 1] > 1.9
    assert weak.drive.saturated_time[0, 0] < 0.1


def test_encoder_angles_are_whole_counts_rounded_down():
    state = Sprockets(Drive(encoder_counts=100), 1, 0.06)
    state.angle[:] = [[2 * np.pi * 0.519, -2 * np.pi * 0.001]]
    np.testing.assert_allclose(state.encoder_angle() / (2 * np.pi), [[0.51, -0.01]])


def run_free(state, periods):
    """Let the sprockets turn without ground, and return the torques (periods, n, 2)."""
    forecast = state.forecast(periods)
    torque = state.torque_for(forecast, np.zeros_like(forecast.mean))
    state.accept(forecast, torque)
    return torque


@pytest.mark.parametrize("lag", [0.003, 0.05, 0.58])
def test_speed_and_angle_follow_a_lag_exactly(lag):
    drive = Drive(lag=lag)
    whole = Sprockets(drive, 1, 0.06)
    pieces = Sprockets(drive, 1, 0.06)
    for state in (whole, pieces):
        state.command(np.array([[2.0, -1.0]]))
    periods = 0
    for piece in (1, 3, 1, 7, 20):
        periods += piece
        for _ in range(piece):
            run_free(pieces, 1)
        time = periods * drive.period
        grown = -np.expm1(-time / lag)
        np.testing.assert_allclose(pieces.omega, [[2.0 * grown, -grown]], atol=1e-12)
        np.testing.assert_allclose(pieces.angle[0, 0], 2.0 * (time - lag * grown), atol=1e-12)
    run_free(whole, periods)
    np.testing.assert_array_equal(whole.omega, pieces.omega)
    np.testing.assert_array_equal(whole.angle, pieces.angle)
