"""Robots on wheels: their turns, slopes and shear are theory's, whatever their size and mass."""

import numpy as np
import pytest

from sim.drive.drive import tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.named import load_parameters
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.skid_theory import steady_twist

HUSKY, WARTHOG = (load_parameters(name)[0] for name in ("husky", "warthog"))
G = 9.81


def wheels(half_gauge=0.275, axles=(-0.256, 0.256), mass=75.0, **changes):
    radius = min(0.6 * half_gauge, 0.165)
    given = {"patch_length": min(0.1, 0.3 * half_gauge), "com_height": 0.5 * half_gauge, "radius_error": 0.0}
    return RobotParameters(
        half_gauge, sprocket_radius=radius, mass=mass, axles=axles, contact="wheels", **given | changes
    )


def turned(parameters, belts, ground, settle=3.0, top_speed=9.0):
    """Steady twists (M, 3), simulated and by theory, of belts with speeds (M, 2)."""
    fleet = Fleet(load_robot(parameters=parameters), np.zeros((len(belts), 3)), ground, 0.0, tireless(top_speed))
    fleet.command(belts / parameters.sprocket_radius)
    fleet.advance(settle)
    twists = []
    for _ in range(50):
        fleet.advance(fleet.period)
        twists.append(fleet.twist())
    theory = parameters.contact_theory(ground.along, ground.across)
    return np.mean(twists, axis=0), steady_twist(belts, theory, G, ground.shear)


def ratio(parameters, belts, twist):
    """b / (b + D) (M,)."""
    return 2 * parameters.half_gauge * twist[:, 2] / (belts[:, 1] - belts[:, 0])


def arcs(parameters, speed=0.1, radii=(0.0, 1.5, 6.0)):
    """Belt speeds (M, 2) of turns whose radii are about so many gauges."""
    b = parameters.half_gauge
    return (
        speed
        * np.array([(-1.0, 1.0) if r == 0 else (1 - 0.85 / r, 1 + 0.85 / r) for r in np.array(radii)])
        * min(1.0, 10 * b)
    )


@pytest.mark.parametrize(("robot", "by_theory"), [(HUSKY, 0.536), (WARTHOG, 0.582)])
def test_the_yaw_ratio_of_named_robots(robot, by_theory):
    belts = arcs(robot)
    twist, expected = turned(robot, belts, Ground(0.75, 0.75))
    np.testing.assert_allclose(ratio(robot, belts, twist), ratio(robot, belts, expected), rtol=1e-3)
    np.testing.assert_allclose(ratio(robot, belts, expected), by_theory, atol=1e-3)


@pytest.mark.parametrize("mass", [5.0, 1000.0])
@pytest.mark.parametrize("friction_ratio", [0.7, 1.0, 1.5])
@pytest.mark.parametrize("shape", [(-0.3, 0.3), (-1, 1), (-2, 2), (-1, 0, 1), (-1, -0.3, 0.3, 1), (-1.1, 0.3, 0.8)])
def test_turns_are_those_of_theory(shape, friction_ratio, mass):
    b = 0.1 if mass < 100 else 0.5
    robot = wheels(b, tuple(x * b for x in shape), mass)
    belts = arcs(robot)
    twist, expected = turned(robot, belts, Ground(0.7, 0.7 * friction_ratio))
    np.testing.assert_allclose(ratio(robot, belts, twist), ratio(robot, belts, expected), rtol=0.01)


def test_fast_turns_are_those_of_theory():
    belts = np.array([[3.5, 4.5], [3.73, 4.27], [-1.85, 1.85]])
    twist, expected = turned(WARTHOG, belts, Ground(0.75, 0.75))
    np.testing.assert_allclose(ratio(WARTHOG, belts, twist), ratio(WARTHOG, belts, expected), rtol=0.01)
    np.testing.assert_allclose(twist[:, 0], expected[:, 0], atol=0.01)


@pytest.mark.parametrize("robot", [HUSKY, WARTHOG, wheels(axles=(-0.3, 0.0, 0.3))])
@pytest.mark.parametrize("shear", [0.005, 0.02])
def test_turns_on_shearing_ground_are_those_of_theory(robot, shear):
    belts = arcs(robot, 0.2)
    twist, expected = turned(robot, belts, Ground(0.6, 0.7, shear=shear), 8.0)
    np.testing.assert_allclose(ratio(robot, belts, twist), ratio(robot, belts, expected), rtol=0.02)
    np.testing.assert_allclose(twist[:, 0], expected[:, 0], atol=0.002)
