import numpy as np
import pytest

from sim import Fleet, Ground, load_robot
from sim.motors.motor import tireless
from sim.robot.named import load_parameters
from sim.robot.parameters import SINK, RobotParameters
from trackslip.skid_theory import Load, steady_twist

HUSKY, _ = load_parameters("husky")
WARTHOG, _ = load_parameters("warthog")
G = 9.81


def wheels(half_gauge=0.275, axles=(-0.256, 0.256), mass=75.0, patch_length=None):
    """A robot on wheels, whose proportions follow its gauge [m]."""
    if patch_length is None:
        patch_length = min(0.1, 0.3 * half_gauge)
    return RobotParameters(
        half_gauge,
        sprocket_radius=min(0.6 * half_gauge, 0.165),
        mass=mass,
        axles=axles,
        contact="wheels",
        patch_length=patch_length,
        com_height=0.5 * half_gauge,
        radius_error=0.0,
    )


def train(axles):
    """A robot on many axles 0.2 m apart."""
    places = 0.2 * (np.arange(axles) - (axles - 1) / 2)
    return wheels(0.4, tuple(places), 75.0, patch_length=0.08)


def turned(parameters, belts, ground, settle=1.5, top_speed=9.0):
    """Steady twists (M, 3), simulated and by theory, of belts with speeds (M, 2)."""
    robot = load_robot(parameters=parameters)
    start = np.zeros((len(belts), 3))
    fleet = Fleet(robot, start, ground, 0.0, tireless(top_speed))
    fleet.command(belts / parameters.sprocket_radius)
    fleet.advance(settle)
    twists = []
    for _ in range(50):
        fleet.advance(fleet.period)
        twists.append(fleet.twist())
    contact = parameters.contact_theory(ground.along, ground.across)
    return np.mean(twists, axis=0), steady_twist(belts, contact, G, ground.shear)


def yaw_ratio(parameters, belts, twist):
    """Yaw rate over that of wheels that don't slip."""
    without_slip = (belts[:, 1] - belts[:, 0]) / (2 * parameters.half_gauge)
    return twist[:, 2] / without_slip


def arcs(parameters, speed=0.1):
    """Belt speeds (M, 2) of a turn on the spot and of arcs with radii of about 1.5 and 6 gauges."""
    slowed = speed * min(1.0, 10 * parameters.half_gauge)
    sharp = 0.85 / 1.5
    wide = 0.85 / 6.0
    shares = np.array([(-1.0, 1.0), (1 - sharp, 1 + sharp), (1 - wide, 1 + wide)])
    return slowed * shares


@pytest.mark.parametrize(
    ("robot", "ground", "within"),
    [
        (HUSKY, Ground(0.75, 0.75), 1e-3),
        (WARTHOG, Ground(0.75, 0.75), 1e-3),
        (wheels(0.1, (-0.03, 0.03), 5.0), Ground(0.7, 1.05), 0.01),
        (wheels(0.5, (-1.0, 1.0), 1000.0), Ground(0.7, 0.49), 0.01),
        (wheels(0.5, (-0.55, 0.15, 0.4), 1000.0), Ground(0.7, 1.05), 0.01),
        (train(10), Ground(0.6, 0.7), 0.01),
        (WARTHOG, Ground(0.6, 0.7, shear=0.02), 0.02),
        (train(10), Ground(0.6, 0.7, shear=0.01), 0.01),
    ],
)
def test_turns_are_those_of_theory(robot, ground, within):
    belts = arcs(robot, 0.2 if ground.shear else 0.1)
    twist, expected = turned(robot, belts, ground)
    ratio = yaw_ratio(robot, belts, twist)
    ratio_by_theory = yaw_ratio(robot, belts, expected)
    np.testing.assert_allclose(ratio, ratio_by_theory, rtol=within)
    np.testing.assert_allclose(twist[:, 0], expected[:, 0], atol=0.002)


@pytest.mark.parametrize(("robot", "shear"), [(HUSKY, 0.0), (WARTHOG, 0.01)])
def test_wheels_climb_as_theory_says(robot, shear):
    ground = Ground(0.7, 0.8, slope=0.2, shear=shear)
    fleet = Fleet(load_robot(parameters=robot), np.zeros((1, 3)), ground, 0.0, tireless(9.0))
    fleet.command([0.5 / robot.sprocket_radius] * 2)
    fleet.advance(2.0)
    contact = robot.contact_theory(0.7, 0.8)
    expected = steady_twist([0.5, 0.5], contact, G, shear, Load(0.2))
    np.testing.assert_allclose(fleet.twist()[0], expected, atol=1e-4)


@pytest.mark.parametrize("shear", [0.0, 0.02])
def test_sliding_decays_at_the_rate_asked_for(shear):
    """A robot that slides while its friction holds: the engine takes 100/s times the step of its
    speed in each step.
    """
    for robot in (HUSKY, train(10)):
        loaded = load_robot(parameters=robot)
        fleet = Fleet(loaded, np.zeros((1, 3)), Ground(5.0, 5.0), 0.0, tireless(), shears=shear > 0)
        fleet.batch.qvel[:, 0] = 0.05
        speeds = [0.05]
        for _ in range(4):
            fleet.advance(0.01)
            speeds.append(float(fleet.batch.qvel[0, 0]))
        rate = -np.diff(np.log(speeds)) / 0.01
        step = fleet.robot.model.opt.timestep
        expected = -np.log(1 - 100.0 * step) / step
        np.testing.assert_allclose(rate, expected, rtol=0.1)


def test_parked_robots_sink_as_tracks_do_and_creep_as_slowly():
    heading = np.array([0.0, 0.8, np.pi / 2])
    start = np.column_stack([np.zeros((3, 2)), heading])
    slope = Ground(slope=0.1745)
    for parameters in (HUSKY, train(10), RobotParameters()):
        robot = load_robot(parameters=parameters)
        parked = Fleet(robot, start, slope, 0.0, tireless())
        parked.advance(2.0)
        crept = np.linalg.norm(parked.pose()[:, :2], axis=1)
        assert (crept / 2 < 0.025e-3).all()
        level = Fleet(robot, start)
        np.testing.assert_allclose(level.attitude()[:, 0], SINK, rtol=0.01)
        np.testing.assert_allclose(level.load().sum(axis=1), parameters.mass * G, rtol=1e-3)
