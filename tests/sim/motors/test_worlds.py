"""The same robot and motors on flat ground (Fleet) and on terrain (Traverse), against the balance
by hand.

On a slope, a motor carries the torque W of half the weight's part along the slope. At the stall
torque S and the no-load speed w0, its line falls by S / w0. Where the motor is at its limit, the
speed follows from the balance of its line with W and the friction f of its gear,

    S (1 - w / w0) - f sign(w) = W.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from sim import Command, Drive, Fleet, Ground, Traverse, load_robot, load_tracked
from sim.motors.motor import Motor
from sim.robot.named import load_parameters
from sim.terrain import Course, Flat

G = 9.81
MASS = 25.0  # of the box [kg]
RADIUS = 0.08  # of its sprockets [m]
FRICTION = 0.3  # of the gears [N m]
STEEP = 0.3  # [rad]
WEIGHT = MASS * G * np.sin(STEEP) * RADIUS / 2
"""Torque of the weight on each sprocket of the box on the slope [N m]."""
LEVEL = Course((Flat(20.0),), start_length=5.0, friction=0.9)


def motors(stall, no_load=10.0, limit=100.0, friction=FRICTION):
    """Motors with a stall torque [N m] and a no-load speed [rad/s] at the sprocket."""
    motor = Motor(
        gear=10.0,
        stall_torque=stall / 10.0,
        no_load_speed=10.0 * no_load,
        friction=friction,
    )
    return Drive(top_speed=3.0, torque_limit=limit, motor=motor)


@dataclass(frozen=True)
class Motion:
    """What a robot does at last."""

    speed: float  # of the robot [m/s]
    rate: float  # yaw rate [rad/s]
    belts: np.ndarray  # (2,) speeds of the belts [m/s]
    torque: np.ndarray  # (2,) torques of the motors [N m]


def in_fleet(drive, slope, speeds, time):
    parameters = load_parameters(replace(load_tracked("box"), drive=drive))[0]
    fleet = Fleet(load_robot(parameters), np.zeros((1, 3)), radius_error=0.0, drive=drive)
    heading = 0.0 if slope >= 0 else np.pi
    fleet.set_ground(Ground(0.9, 0.9, slope=abs(slope), uphill=heading))
    fleet.command(np.divide(speeds, RADIUS))
    fleet.advance(time)
    twist = fleet.twist()[0]
    return Motion(twist[0], twist[2], fleet.drive.omega[0] * RADIUS, fleet.drive.torque[0])


def in_traverse(drive, slope, speeds, time, preset="fast"):
    """On level ground with gravity turned, which is the same as a slope."""
    robot = replace(load_tracked("box"), drive=drive)
    world = Traverse(robot, [LEVEL], threads=1, preset=preset)
    along = np.array([-np.sin(slope), 0.0, -np.cos(slope)])
    world.batch.expand("opt.gravity")[:] = G * along
    torques = []
    for _ in range(round(time / world.period)):
        world.step(Command(np.array([speeds]), np.zeros((1, 0))))
        torques.append(world.motors().torque[0])
    state = world.state
    torque = np.mean(torques[-3:], axis=0)  # of single steps, in balance within a tolerance
    return Motion(state.velocity[0, 0], state.rate[0, 2], world.motors().speed[0], torque)


WORLDS = pytest.mark.parametrize("drive_box", [in_fleet, in_traverse])


def balanced(motion, speed, torque):
    """Both motors run at a speed [m/s] with a torque [N m], and the robot goes with its belts."""
    np.testing.assert_allclose(motion.belts, speed, rtol=0.005, atol=1e-3)
    np.testing.assert_allclose(motion.torque, torque, rtol=0.005)
    assert motion.speed == pytest.approx(speed, rel=0.005, abs=1e-3)


@WORLDS
def test_uphill_a_strong_motor_carries_weight_and_friction(drive_box):
    motion = drive_box(motors(10.0), STEEP, (0.3, 0.3), 0.8)
    balanced(motion, 0.3, WEIGHT + FRICTION)


@WORLDS
def test_uphill_a_motor_is_as_fast_as_its_line_lets_it(drive_box):
    motion = drive_box(motors(10.0), STEEP, (0.7, 0.7), 0.8)
    expected = (10.0 - FRICTION - WEIGHT) * RADIUS
    balanced(motion, expected, WEIGHT + FRICTION)


@WORLDS
def test_rolled_back_a_motor_pulls_more_than_at_rest(drive_box):
    """Its voltage and the back-EMF add up, and friction helps it."""
    motion = drive_box(motors(2.0, no_load=2.0), STEEP, (0.3, 0.3), 0.8)
    expected = (2.0 + FRICTION - WEIGHT) * RADIUS
    assert expected < -0.04
    balanced(motion, expected, WEIGHT - FRICTION)


@WORLDS
def test_stalled_a_robot_is_held_by_the_friction_of_its_gears(drive_box):
    """Its motors alone can neither lift nor hold it."""
    for stall in (WEIGHT - 0.2, WEIGHT + 0.2):
        motion = drive_box(motors(stall), STEEP, (0.3, 0.3), 0.6)
        np.testing.assert_allclose(motion.belts, 0.0, atol=0.002)
        np.testing.assert_allclose(motion.torque, stall, rtol=0.005)


@WORLDS
def test_braking_downhill_friction_of_the_gears_helps(drive_box):
    motion = drive_box(motors(10.0), -STEEP, (0.3, 0.3), 0.8)
    balanced(motion, 0.3, FRICTION - WEIGHT)


@WORLDS
def test_pushed_beyond_its_no_load_speed_a_motor_brakes(drive_box):
    motion = drive_box(motors(5.0, no_load=5.0), -STEEP, (0.8, 0.8), 0.8)
    expected = (5.0 - FRICTION + WEIGHT) * RADIUS
    assert expected > 5.0 * RADIUS
    balanced(motion, expected, FRICTION - WEIGHT)


@WORLDS
@pytest.mark.parametrize("speed", [0.3, -0.3])
def test_a_motor_too_weak_to_brake_takes_the_amplifiers_torque(drive_box, speed):
    """Against the set point as well as beyond it, the current is at its limit."""
    drive = motors(20.0, limit=2.0)
    early = drive_box(drive, -STEEP, (speed, speed), 0.6)
    late = drive_box(drive, -STEEP, (speed, speed), 1.0)
    np.testing.assert_allclose(late.torque, -2.0)
    inertia = MASS + 2 * drive.motor.inertia / RADIUS**2
    gained = 0.4 * 2 * (WEIGHT - FRICTION - 2.0) / RADIUS / inertia
    assert late.speed - early.speed == pytest.approx(gained, rel=0.02)


@pytest.mark.parametrize(
    ("stall", "no_load", "speed"),
    [(5.8, 100.0, 0.1), (15.0, 1.4, 0.3)],
    ids=["strong", "weak"],
)
def test_on_level_ground_both_worlds_turn_a_robot_alike(stall, no_load, speed):
    """Near the limit of its motors, and beyond it, where their line sets the speed."""
    drive = motors(stall, no_load)
    flat = in_fleet(drive, 0.0, (-speed, speed), 1.0)
    terrain = in_traverse(drive, 0.0, (-speed, speed), 1.0, preset="accurate")
    np.testing.assert_allclose(terrain.belts, flat.belts, rtol=0.005)
    np.testing.assert_allclose(terrain.torque, flat.torque, rtol=0.005)
    assert terrain.rate == pytest.approx(flat.rate, rel=0.005)
