import numpy as np
import pytest

from sim import Fleet, Ground, load_robot
from sim.motors.motor import tireless
from sim.robot.named import load_parameters
from sim.robot.parameters import SINK, RobotParameters
from trackslip.skid_theory import Load, steady_twist

HUSKY, WARTHOG = (load_parameters(name)[0] for name in ("husky", "warthog"))
G = 9.81


def wheels(half_gauge=0.275, axles=(-0.256, 0.256), mass=75.0, **changes):
    radius = min(0.6 * half_gauge, 0.165)
    given = {
        "patch_length": min(0.1, 0.3 * half_gauge),
        "com_height": 0.5 * half_gauge,
        "radius_error": 0.0,
    }
    return RobotParameters(
        half_gauge,
        sprocket_radius=radius,
        mass=mass,
        axles=axles,
        contact="wheels",
        **given | changes,
    )


def turned(parameters, belts, ground, settle=1.5, top_speed=9.0):
    """Steady twists (M, 3), simulated and by theory, of belts with speeds (M, 2)."""
    fleet = Fleet(
        load_robot(parameters=parameters),
        np.zeros((len(belts), 3)),
        ground,
        0.0,
        tireless(top_speed),
    )
    fleet.command(belts / parameters.sprocket_radius)
    fleet.advance(settle)
    twists = []
    for _ in range(50):
        fleet.advance(fleet.period)
        twists.append(fleet.twist())
    theory = parameters.contact_theory(ground.along, ground.across)
    return np.mean(twists, axis=0), steady_twist(belts, theory, G, ground.shear)


def ratio(parameters, belts, twist):
    return 2 * parameters.half_gauge * twist[:, 2] / (belts[:, 1] - belts[:, 0])


def arcs(parameters, speed=0.1, radii=(0.0, 1.5, 6.0)):
    """Belt speeds (M, 2) of turns whose radii are about so many gauges."""
    shares = np.array([(-1.0, 1.0) if r == 0 else (1 - 0.85 / r, 1 + 0.85 / r) for r in radii])
    return speed * min(1.0, 10 * parameters.half_gauge) * shares


def train(axles):
    return wheels(0.4, tuple(0.2 * (np.arange(axles) - (axles - 1) / 2)), 75.0, patch_length=0.08)


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
    np.testing.assert_allclose(
        ratio(robot, belts, twist), ratio(robot, belts, expected), rtol=within
    )
    np.testing.assert_allclose(twist[:, 0], expected[:, 0], atol=0.002)


@pytest.mark.parametrize(("robot", "shear"), [(HUSKY, 0.0), (WARTHOG, 0.01)])
def test_wheels_climb_as_theory_says(robot, shear):
    ground = Ground(0.7, 0.8, slope=0.2, shear=shear)
    fleet = Fleet(load_robot(parameters=robot), np.zeros((1, 3)), ground, 0.0, tireless(9.0))
    fleet.command([0.5 / robot.sprocket_radius] * 2)
    fleet.advance(2.0)
    expected = steady_twist([0.5, 0.5], robot.contact_theory(0.7, 0.8), G, shear, Load(0.2))
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
        np.testing.assert_allclose(rate, -np.log(1 - 100.0 * step) / step, rtol=0.1)


def test_parked_robots_sink_as_tracks_do_and_creep_as_slowly():
    for robot in (HUSKY, train(10), RobotParameters()):
        heading = np.array([0.0, 0.8, np.pi / 2])
        start = np.column_stack([np.zeros((3, 2)), heading])
        fleet = Fleet(load_robot(parameters=robot), start, Ground(slope=0.1745), 0.0, tireless())
        fleet.advance(2.0)
        assert (np.hypot(*fleet.pose()[:, :2].T) / 2 < 0.025e-3).all()
        level = Fleet(load_robot(parameters=robot), start)
        np.testing.assert_allclose(level.attitude()[:, 0], SINK, rtol=0.01)
        np.testing.assert_allclose(level.load().sum(axis=1), robot.mass * G, rtol=1e-3)
