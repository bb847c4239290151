"""Drives: lag, limits and energy; at their limits, ground, rotors and gears take what the motors give."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.drive.drive import Drive, DriveState
from sim.drive.motor import Motor
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot

GRAVITY = 9.81
MOTOR = Motor()


def on_slope(robot, slope, drive):
    """A robot that is told to drive uphill, on ground that has just become steep."""
    fleet = Fleet(robot, np.zeros((1, 3)), radius_error=0.0, drive=drive)
    fleet.set_ground(Ground(slope=slope))
    fleet.command([3.0, 3.0])
    return fleet


def search_tolerance(limit, mass):
    """Torque [N m] at which the search for a speed stops: 0.1 % of the limit and 0.02 % of the weight."""
    return 0.001 * limit + 0.0002 * mass * GRAVITY * 0.06 + 1e-9


def torque_of_weight(robot, slope):
    return robot.mass * GRAVITY * np.sin(slope) / 2 * robot.geometry.sprocket_radius


@pytest.mark.parametrize(("slope", "limit"), [(0.3, 1.0), (0.15, 0.6)])
@pytest.mark.parametrize("period", [0.005, 0.01])
def test_a_weak_robot_rolls_back_with_the_inertia_of_its_rotors(robot, slope, limit, period):
    """The gear's friction holds it too, and the rotors count for more than their weight: gears square it."""
    fleet = on_slope(robot, slope, Drive(torque_limit=limit, period=period))
    radius = robot.geometry.sprocket_radius
    inert = robot.mass + 2 * MOTOR.inertia / radius**2
    expected = -2 * (torque_of_weight(robot, slope) - limit - MOTOR.friction) / radius / inert
    fleet.advance(1.0)
    before = fleet.twist()[0, 0]
    fleet.advance(1.0)
    assert fleet.twist()[0, 0] - before == pytest.approx(expected, rel=0.01)
    np.testing.assert_allclose(fleet.drive.torque, limit, atol=search_tolerance(limit, robot.mass))
    np.testing.assert_allclose(fleet.drive.saturated_time, 2.0, atol=0.02)


@pytest.mark.parametrize("share", [-0.6, -0.3, 0.3, 0.6])
def test_between_climbing_and_rolling_back_the_gears_friction_holds(robot, share):
    """The motor lacks a share of the gear's friction. That friction is rounded off at rest: tanh(omega / 0.02)."""
    slope = 0.3
    limit = torque_of_weight(robot, slope) + share * MOTOR.friction
    fleet = on_slope(robot, slope, Drive(torque_limit=limit))
    fleet.advance(3.0)
    np.testing.assert_allclose(fleet.drive.omega, 0.02 * np.arctanh(share), rtol=0.1)
    np.testing.assert_allclose(fleet.drive.saturated_time, 3.0, atol=0.05)


@pytest.mark.parametrize("limit", [0.8, 2.0, 30.0])
@pytest.mark.parametrize("period", [0.005, 0.01, 0.02])
def test_impulses_of_the_motors_become_momentum(robot, limit, period):
    """From rest to 0.18 m/s, however hard the motors push and however seldom they are sampled."""
    drive = Drive(torque_limit=limit, period=period, motor=Motor(friction=0.3))
    fleet = Fleet(robot, np.zeros((1, 3)), radius_error=0.0, drive=drive)
    fleet.command([3.0, 3.0])
    impulse = np.zeros(2)
    for _ in range(round(1.5 / period)):
        fleet.advance(period)
        impulse += (fleet.drive.torque - MOTOR.loss(fleet.drive.omega))[0] * period
    momentum = robot.mass * fleet.twist()[0, 0] / 2 * robot.geometry.sprocket_radius
    np.testing.assert_allclose(impulse, momentum + MOTOR.inertia * fleet.drive.omega[0], rtol=5e-3)


def test_power_of_a_steady_turn_is_what_ground_gear_and_winding_dissipate(robot):
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
    belts = np.where(y > 0, fleet.drive.omega[:, :1], fleet.drive.omega[:, 1:]) * 0.06 * (1 + error)
    v, u, w = fleet.twist().T[:, :, None]
    sliding = np.hypot(ground.along * (v - w * y - belts), ground.across * (u + w * x))
    in_ground = robot.mass * GRAVITY * sliding.mean(axis=1)
    in_gear = (MOTOR.loss(fleet.drive.omega) * fleet.drive.omega).sum(axis=1)
    current = fleet.drive.torque / (MOTOR.gear * MOTOR.torque_constant)
    in_winding = (MOTOR.resistance * current**2).sum(axis=1)
    np.testing.assert_allclose(power, in_ground + in_gear + in_winding, rtol=0.01)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    strength=st.floats(0.15, 1.2),
    inertia=st.floats(0.01, 3.0),
    mass=st.floats(5.0, 100.0),
    com_y=st.floats(-0.03, 0.03),
    slope=st.floats(0.0, 0.25),
    uphill=st.floats(-3.0, 3.0),
    commands=st.lists(st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)), min_size=3, max_size=3),
)
def test_torque_is_within_the_limits_and_what_ground_rotor_and_gear_take(
    strength, inertia, mass, com_y, slope, uphill, commands
):
    """Any robot on any slope: at one physics step a period, the traction of the step is the mean of the period."""
    robot = load_robot(parameters=RobotParameters(mass=mass, com_y=com_y))
    full = 0.7 * mass * GRAVITY * 0.06 / 2  # torque at which a track slides
    limit = strength * full
    motor = Motor(stall_torque=limit / 50 * 1.5, rotor_inertia=inertia * 8e-6, friction=0.1 * limit)
    fleet = Fleet(
        robot,
        np.zeros((1, 3)),
        Ground(slope=slope, uphill=uphill),
        0.0,
        Drive(torque_limit=limit, motor=motor, period=0.005),
    )
    off = []
    for command in commands:
        fleet.command(command)
        for _ in range(80):
            before = fleet.drive.omega.copy()
            fleet.advance(fleet.period)
            least, most = fleet.drive.drive.torque_range(fleet.drive.omega)
            assert np.all((fleet.drive.torque >= least) & (fleet.drive.torque <= most))
            spin = motor.inertia * (fleet.drive.omega - before) / fleet.period
            taken = 0.06 * fleet.mean_traction + motor.loss(fleet.drive.omega) + spin
            off.append(np.abs(fleet.drive.torque - taken).max())
    # a search that ends at its cap, where a sprocket nearly stands, clips the torque of that one period
    assert np.mean(np.array(off) > search_tolerance(limit, mass)) < 0.01


def test_one_motor_too_weak_to_turn_keeps_the_robot_straight(robot):
    """The right motor can't slide its track: it pushes all it can, and the left one brakes it to its own set point."""
    strong, weak = (
        Fleet(robot, np.zeros((1, 3)), radius_error=0.0, drive=Drive(torque_limit=limit)) for limit in (8.0, 1.5)
    )
    for fleet in (strong, weak):
        fleet.command([2.0, 3.0])
        fleet.advance(4.0)
    assert abs(weak.twist()[0, 2]) < 0.01 * strong.twist()[0, 2]
    np.testing.assert_allclose(weak.drive.omega[0], 2.0, rtol=3e-3)
    assert weak.drive.torque[0, 1] == pytest.approx(1.5, rel=0.02)
    # straight and steady: the tracks' forces cancel but for what the gears take
    assert weak.drive.torque.sum() == pytest.approx(2 * MOTOR.friction, rel=0.02)
    assert weak.drive.saturated_time[0, 1] > 3.9
    assert weak.drive.saturated_time[0, 0] < 0.1


def test_limits_are_the_current_and_the_torque_speed_line():
    """Beyond its no-load speed, 10 rad/s of the sprocket, a motor brakes; a turning one, with its whole current."""
    state = DriveState(Drive(torque_limit=4.0, motor=Motor(gear=10.0, no_load_speed=100.0, stall_torque=1.0)), 1, 0.06)
    least, most = state.drive.torque_range(np.array([0.0, 7.0, 12.0, 50.0, -50.0]))
    np.testing.assert_allclose(most, [4.0, 3.0, -2.0, -4.0, 4.0])
    np.testing.assert_allclose(least, [-4.0, -4.0, -4.0, -4.0, 4.0])


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


@pytest.mark.parametrize("lag", [0.003, 0.05, 0.58])
@pytest.mark.parametrize("delay", [0.004, 0.01, 0.033, 0.03, 0.2])
def test_speed_and_angle_follow_a_dead_time_and_a_lag_exactly(lag, delay):
    """At any fraction of a period, and however the time is cut up."""
    drive = Drive(lag=lag, delay=delay)
    whole, pieces = DriveState(drive, 1, 0.06), DriveState(drive, 1, 0.06)
    for state in (whole, pieces):
        state.command(np.array([[2.0, -1.0]]))
    periods = 0
    for piece in (1, 3, 1, 7, 20):
        periods += piece
        for _ in range(piece):
            run_free(pieces, 1)
        left = max(periods * drive.period - delay, 0.0)
        grown = -np.expm1(-left / lag)
        np.testing.assert_allclose(pieces.omega, [[2.0 * grown, -grown]], atol=1e-12)
        np.testing.assert_allclose(pieces.angle[0, 0], 2.0 * (left - lag * grown), atol=1e-12)
    run_free(whole, periods)
    np.testing.assert_array_equal(whole.omega, pieces.omega)
    np.testing.assert_array_equal(whole.angle, pieces.angle)


def test_a_pulse_passes_through_the_delay(robot):
    """The belts are at rest at both ends of a stretch in whose middle they turn."""
    fleet = Fleet(robot, np.zeros((1, 3)), radius_error=0.0, drive=Drive(lag=0.001, delay=0.2))
    for omega in (3.0, 0.0):
        fleet.command([omega, omega])
        fleet.advance(0.1)
    fleet.advance(0.4)
    assert fleet.pose()[0, 0] == pytest.approx(3.0 * 0.06 * 0.1, rel=0.02)


HEAVY = {
    "shipped": (RobotParameters(radius_error=0.0), {"droop": 0.05}),
    **{
        f"{mass} kg, {lag} s": (
            RobotParameters(gauge, length, 0.3, 0.0, mass, com_height=0.25),
            {"lag": lag, "droop": 0.0025, "top_speed": 5.0, "torque_limit": 1e4},
        )
        for mass, gauge, length in ((75.0, 0.28, 0.5), (470.0, 0.6, 1.2))
        for lag in (0.05, 0.58)
    },
}


@pytest.mark.parametrize("name", HEAVY)
def test_a_servo_with_droop_loses_speed_in_proportion_to_its_torque(name):
    """Standing, straight, in arcs in which tracks hardly slide or slide, spinning, stopped; and it does not chatter."""
    parameters, options = HEAVY[name]
    motor = Motor() if name == "shipped" else Motor(no_load_speed=1e4, stall_torque=1e4)
    drive, turn = Drive(**options, motor=motor), 0.6 * options.get("top_speed", 0.3) / parameters.sprocket_radius
    fleet = Fleet(load_robot(parameters=parameters), np.zeros((1, 3)), Ground(0.6, 0.6), 0.0, drive)
    for shares in ((0, 0), (1, 1), (0.95, 1), (0.5, 1), (-0.5, 0.5), (0, 0)):
        fleet.command(turn * np.array(shares))
        fleet.advance(8 * drive.lag + 1.0)
        speeds, torques = [], []
        for _ in range(50):
            fleet.advance(drive.period)
            speeds.append(fleet.drive.omega[0].copy())
            torques.append(fleet.drive.torque[0].copy())
        speeds, torques = np.array(speeds), np.array(torques)
        np.testing.assert_allclose(speeds, turn * np.array(shares) - drive.droop * torques, atol=2e-3 * turn)
        assert np.abs(np.diff(speeds, axis=0)).max() < 1e-4 * turn
        assert np.abs(np.diff(torques, axis=0)).max() < 0.002 * parameters.mass * GRAVITY * parameters.sprocket_radius


def test_on_a_slope_a_servo_with_droop_yields_without_a_swing(robot):
    """A set point of zero: the robot rolls back at the speed that its weight costs, and never faster."""
    fleet = Fleet(robot, np.zeros((1, 3)), Ground(slope=0.3), 0.0, Drive(droop=0.05))
    speeds = []
    for _ in range(200):
        fleet.advance(0.01)
        speeds.append(fleet.drive.omega[0].copy())
    expected = -0.05 * (torque_of_weight(robot, 0.3) + MOTOR.loss(speeds[-1][0]))
    np.testing.assert_allclose(speeds[-1], expected, rtol=5e-3)
    assert np.min(speeds) > 1.01 * expected


def test_encoder_counts():
    state = DriveState(Drive(encoder_counts=100), 1, 0.06)
    state.angle[:] = [[2 * np.pi * 0.519, -2 * np.pi * 0.001]]
    np.testing.assert_allclose(state.encoder_angle() / (2 * np.pi), [[0.51, -0.01]])
