"""What must hold whatever the numbers: invariances, symmetries, and patches that theory can reckon with."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from sim import Fleet, RobotParameters, load_robot
from sim.drive.drive import tireless
from sim.ground.ground import Ground, Patch
from trackslip.kinematics import track_slip

FAST = tireless(0.6)


def steady_twist(robot, omega, ground, seconds=2.5, **options):
    fleet = Fleet(robot, np.zeros((len(omega), 3)), ground, 0.0, options.pop("drive", FAST), **options)
    fleet.command(omega)
    fleet.advance(seconds)
    return fleet.twist()


@settings(max_examples=4, deadline=None)
@given(scale=st.floats(0.6, 2.0), left=st.floats(0.5, 2.0), spread=st.floats(0.2, 1.0))
def test_slip_depends_on_the_shape_not_on_the_scale(scale, left, spread):
    """A robot of another size, at speeds that grow with the square root of it: same centripetal over weight."""
    small = RobotParameters()
    large = RobotParameters(
        half_gauge=scale * small.half_gauge,
        contact_length=scale * small.contact_length,
        com_height=scale * small.com_height,
        mass=scale**3 * small.mass,
    )
    omega = np.array([[left, left + spread]])
    slips = []
    for parameters, factor in ((small, 1.0), (large, np.sqrt(scale))):
        robot = load_robot(parameters=parameters)
        twist = steady_twist(robot, factor * omega, Ground())
        slips.append(track_slip(factor * omega, twist[:, [0, 2]], robot.geometry))
    np.testing.assert_allclose(*slips, atol=1e-3)


@settings(max_examples=5, deadline=None)
@given(left=st.floats(-3.0, 3.0), right=st.floats(-3.0, 3.0), along=st.floats(0.2, 0.9), ratio=st.floats(0.7, 1.4))
def test_turns_mirror_on_even_ground(robot, left, right, along, ratio):
    twist = steady_twist(robot, np.array([[left, right], [right, left]]), Ground(along, ratio * along))
    np.testing.assert_allclose(twist[1], twist[0] * [1, -1, -1], atol=3e-5)


def least_power_twist(robot, belts, friction):
    """The twist (v, u, w) that dissipates least, where every point has a friction of its own; Moreau's principle.

    belts, friction: forward speed (K,) of the belt and (K, 2) coefficients at each point of contact.
    """
    x, y = robot.contact_points.T

    def power(twist, rounding):
        v, u, w = twist
        along, across = v - w * y - belts, u + w * x
        return np.sqrt((friction[:, 0] * along) ** 2 + (friction[:, 1] * across) ** 2 + rounding**2).sum()

    twist = np.array([belts.mean(), 0.0, 0.0])
    for rounding in 10.0 ** -np.arange(1, 6):  # convex, but for its corners: come nearer to them step by step
        twist = minimize(power, twist, (rounding,), options={"gtol": 1e-10}).x
    return twist


@pytest.mark.parametrize("omega", [(2.0, 3.0), (3.0, 2.0), (-2.0, 2.0), (2.0, 2.0)])
def test_a_patch_under_one_track_turns_the_robot_as_theory_says(robot, omega):
    """The left track stands on ice, from one end of the world to the other: on the patch as long as y > 0."""
    slow = 0.2 * np.array(omega)  # so that inertia doesn't count, and the tracks stay on their sides
    patch = Patch((-np.inf, np.inf), (0.0, np.inf), 0.2, 0.25)
    fleet = Fleet(robot, np.zeros((1, 3)), Ground(0.7, 0.8, patches=(patch,)), 0.0)
    fleet.command(slow)
    fleet.advance(1.4)
    on_left = robot.contact_points[:, 1] > 0
    friction = np.where(on_left[:, None], [0.2, 0.25], [0.7, 0.8])
    expected = least_power_twist(robot, np.where(on_left, *slow) * 0.06, friction)
    # 0.3 mrad/s for the creep of a track that grips, where the other's belt only spins
    np.testing.assert_allclose(fleet.twist()[0, [0, 2]], expected[[0, 2]], rtol=0.01, atol=3e-4)
    even = least_power_twist(robot, np.where(on_left, *slow) * 0.06, np.full((20, 2), [0.7, 0.8]))
    if omega[0] != omega[1]:
        assert abs(expected[2] / even[2] - 1) > 0.1  # the patch matters
