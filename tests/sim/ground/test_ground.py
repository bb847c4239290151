import numpy as np
import pytest
from scipy.optimize import minimize

from sim import Fleet, Ground, Pilot, Pull, RobotParameters, closed_loop, load_robot, open_loop
from sim.fleet.ground import PadFriction
from sim.ground.ground import Change, Patch
from sim.ground.shear import LARGEST, LEAST_SHARE
from sim.motors.motor import tireless
from trackslip.controllers.feedback import LinearTimeVarying
from trackslip.kinematics import track_slip
from trackslip.laws.icr import ConstantIcr, IcrLoad
from trackslip.online.compensation import FixedLaw, LoadedLaw
from trackslip.skid_theory import Load, line_contact, steady_twist
from trackslip.trajectory.segmented import Segment, SegmentedReference

PADS = np.array([[0.1, 0.2], [0.1, -0.2]])


CONTACT = line_contact(0.168, 0.17, 0.7, 0.778, (0.0, 0.0, 0.12), points=100)
"""Of the shipped robot on the default ground."""


def coefficients(friction, time, places, headings):
    """Coefficients (N, pads, 2) along and across the tracks of two robots."""
    return friction.surface(time, np.array(places), np.array(headings))[..., :2]


def test_patches_act_under_the_pads_that_are_on_them():
    patch = Patch((0.0, 1.0), (0.0, 1.0), 0.2, 0.3)
    upper = Patch((0.5, 1.0), (0.0, 1.0), 0.9, 0.8)
    friction = PadFriction([Ground(0.5, 0.6), Ground(0.5, 0.6, patches=(patch, upper))], PADS)
    assert friction.varies
    at = [[0.2, 0.1], [0.2, 0.1]]
    without, with_patches = coefficients(friction, 0.0, at, [0.0, 0.0])
    np.testing.assert_allclose(without, [[0.5, 0.6], [0.5, 0.6]])
    # the left pad is at y = 0.3, the right at -0.1
    np.testing.assert_allclose(with_patches, [[0.2, 0.3], [0.5, 0.6]])
    # the left pad at y = -0.1, the right at 0.3
    _, turned = coefficients(friction, 0.0, at, [np.pi, np.pi])
    np.testing.assert_allclose(turned, [[0.5, 0.6], [0.2, 0.3]])
    _, on_both = coefficients(friction, 0.0, [[0.6, 0.1], [0.6, 0.1]], [0.0, 0.0])
    np.testing.assert_allclose(on_both[0], [0.9, 0.8])  # the last counts


def test_changes_take_effect_at_their_times_outside_patches():
    patch = Patch((-np.inf, np.inf), (0.0, np.inf), 0.2, 0.3)
    changes = (Change(1.0, 0.7, 0.8), Change(2.0, 0.1, 0.1))
    ground = Ground(0.5, 0.6, patches=(patch,), changes=changes)
    friction = PadFriction([ground, Ground()], PADS)
    for time, outside in (
        (0.0, (0.5, 0.6)),
        (0.99, (0.5, 0.6)),
        (1.0, (0.7, 0.8)),
        (2.5, (0.1, 0.1)),
    ):
        changing, constant = coefficients(friction, time, np.zeros((2, 2)), np.zeros(2))
        np.testing.assert_allclose(changing, [(0.2, 0.3), outside])
        np.testing.assert_allclose(constant, [(0.7, 0.778), (0.7, 0.778)])


SANDY = Ground(shear=0.01)


def drive(fleet, omega, seconds):
    fleet.command(omega)
    for _ in range(round(seconds / 0.05)):
        fleet.advance(0.05)


def test_turns_and_slopes_are_those_of_theory(robot):
    omega = np.array([[3.0, 4.0], [4.0, 2.5], [-3.0, 3.0], [4.0, 4.0], [-4.0, -4.0]])
    grounds = [SANDY] * 3 + [Ground(shear=0.01, slope=0.17)] * 2
    fleet = Fleet(robot, np.zeros((5, 3)), grounds, 0.0, tireless())
    drive(fleet, omega, 6.0)
    twist = np.zeros((5, 3))
    for _ in range(20):
        fleet.advance(0.05)
        twist += fleet.twist() / 20
    theory = steady_twist(0.06 * omega[:3], CONTACT, 9.81, shear=0.01)
    uphill = steady_twist(0.06 * omega[3:], CONTACT, 9.81, shear=0.01, load=Load(slope=0.17))
    spread = omega[:3, 1] - omega[:3, 0]
    half_width = spread / twist[:3, 2]
    expected = spread / theory[:, 2]
    np.testing.assert_allclose(half_width, expected, rtol=0.01)
    np.testing.assert_allclose(half_width[:2], expected[:2], rtol=0.004)
    slip = track_slip(omega[3:], twist[3:, ::2], robot.geometry)
    expected_slip = track_slip(omega[3:], uphill[:, ::2], robot.geometry)
    np.testing.assert_allclose(slip, expected_slip, atol=1e-3)


def test_what_is_pulled_slips_as_theory_says(robot):
    force = 60.0
    fleet = Fleet(robot, np.zeros((1, 3)), SANDY, 0.0, tireless(), pull=Pull(force, 0.1))
    drive(fleet, [4.0, 4.0], 4.0)
    before = fleet.pose()[0, 0]
    fleet.advance(1.0)
    distance = fleet.pose()[0, 0] - before
    slip = 1 - distance / (0.06 * 4.0)
    load = Load(pull=force / (25 * 9.81), hitch_height=0.1)
    v, _, _ = steady_twist([1.0, 1.0], CONTACT, shear=0.01, load=load)
    assert slip == pytest.approx(1 - v, abs=2e-4)
    np.testing.assert_allclose(fleet.drive.torque.sum(), 0.06 * force, rtol=0.02)


def test_a_parked_robot_shears_the_ground_as_far_as_needed(robot):
    """Each element carries the share 1 - exp(-displacement / K) of its friction, and moves against
    the push, by more where friction is less: tan(direction) = push_y / mu_y^2 : push_x / mu_x^2.
    """
    slope = np.radians(10.0)
    shears = (0.002, 0.01, 0.025)
    heading = 0.2
    down = 0.5 - heading  # direction of the slope in the robot's frame
    push = np.tan(slope) * np.array([np.cos(down), np.sin(down)])
    grounds = [Ground(shear=shear, slope=slope, uphill=0.5) for shear in shears]
    fleet = Fleet(robot, [[0.0, 0.0, heading]] * 3, grounds)

    needed = np.hypot(push[0] / 0.7, push[1] / 0.778)
    contact = line_contact(0.168, 0.17, 0.7, 0.778, (0.0, 0.0, 0.12), points=10)
    carried = (fleet.shear.share * contact.loads(push)).sum(axis=1)
    np.testing.assert_allclose(carried, needed, rtol=0.03)

    direction = heading + np.arctan2(push[1] / 0.778**2, push[0] / 0.7**2)
    moved_x, moved_y = np.moveaxis(fleet.shear.displacement, -1, 0)
    expected = -np.array(shears)[:, None] * np.log(1 - fleet.shear.share)
    np.testing.assert_allclose(np.hypot(moved_x, moved_y), expected, rtol=1e-6)
    np.testing.assert_allclose(np.arctan2(-moved_y, -moved_x), direction, rtol=1e-6)

    coulomb = Fleet(robot, [[0.0, 0.0, heading]], Ground(slope=slope, uphill=0.5))
    fleet.advance(2.0)
    coulomb.advance(2.0)
    crept = np.hypot(fleet.pose()[:, 0], fleet.pose()[:, 1])
    crept_on_coulomb = np.hypot(coulomb.pose()[0, 0], coulomb.pose()[0, 1])
    assert crept.max() < 1.2 * crept_on_coulomb


def test_displacements_stay_bounded_under_belts_that_stand(robot):
    fleet = Fleet(robot, np.zeros((2, 3)), Ground(shear=0.002), 0.0, tireless())
    drive(fleet, [[0.0, 4.0], [-5.0, 0.0]], 3.0)
    displacement = np.linalg.norm(fleet.shear.displacement, axis=-1)
    assert displacement.max() <= LARGEST * 0.002 * (1 + 1e-12)
    assert fleet.shear.share.min() >= LEAST_SHARE
    assert fleet.shear.share.max() <= 1
    theory = steady_twist([[0.0, 0.24], [-0.3, 0.0]], CONTACT, 9.81, shear=0.002)
    np.testing.assert_allclose(fleet.twist()[:, 2], theory[:, 2], rtol=0.01)


def least_power_twist(robot, belts, friction):
    """The twist (v, u, w) that dissipates least, where every point has a friction of its own;
    Moreau's principle.

    belts, friction: forward speed (K,) of the belt and (K, 2) coefficients at each point of
    contact.
    """
    x, y = robot.contact_points.T

    def power(twist, rounding):
        v, u, w = twist
        along = friction[:, 0] * (v - w * y - belts)
        across = friction[:, 1] * (u + w * x)
        return np.sqrt(along**2 + across**2 + rounding**2).sum()

    twist = np.array([belts.mean(), 0.0, 0.0])
    # convex, but for its corners: come nearer to them step by step
    for rounding in 10.0 ** -np.arange(1, 6):
        twist = minimize(power, twist, (rounding,), options={"gtol": 1e-10}).x
    return twist


@pytest.mark.parametrize("omega", [(2.0, 3.0), (3.0, 2.0), (-2.0, 2.0), (2.0, 2.0)])
def test_a_patch_under_one_track_turns_the_robot_as_theory_says(robot, omega):
    """The left track stands on ice, from one end of the world to the other: on the patch as long as
    y > 0.
    """
    # so that inertia doesn't count, and the tracks stay on their sides
    slow = 0.2 * np.array(omega)
    patch = Patch((-np.inf, np.inf), (0.0, np.inf), 0.2, 0.25)
    fleet = Fleet(robot, np.zeros((1, 3)), Ground(0.7, 0.8, patches=(patch,)), 0.0)
    fleet.command(slow)
    fleet.advance(1.4)
    on_left = robot.contact_points[:, 1] > 0
    belts = np.where(on_left, *slow) * 0.06
    friction = np.where(on_left[:, None], [0.2, 0.25], [0.7, 0.8])
    v, _, w = least_power_twist(robot, belts, friction)
    # 0.3 mrad/s for the creep of a track that grips, where the other's belt only spins
    np.testing.assert_allclose(fleet.twist()[0, [0, 2]], [v, w], rtol=0.01, atol=3e-4)
    _, _, even_w = least_power_twist(robot, belts, np.full((20, 2), [0.7, 0.8]))
    if omega[0] != omega[1]:
        assert abs(w / even_w - 1) > 0.1  # the patch matters


TEN_DEGREES = float(np.radians(10.0))


@pytest.mark.parametrize("heading", [0.0, np.pi / 2])
def test_beyond_the_friction_angle_it_slides_as_coulomb_says(robot, heading):
    """On slippery ground, whose friction angle is so small that no pad lifts."""
    ground = Ground(0.2, 0.25)
    mu = ground.along if heading == 0 else ground.across
    fleet = Fleet(robot, [(0.0, 0.0, heading)], ground)
    for slope in np.arctan(mu) * np.array([0.95, 1.3]):
        fleet.set_ground(Ground(ground.along, ground.across, slope=float(slope)))
        fleet.advance(0.5)
    before = fleet.batch.qvel[0, 0]
    fleet.advance(0.5)
    acceleration = (fleet.batch.qvel[0, 0] - before) / 0.5
    expected = -9.81 * (np.sin(slope) - mu * np.cos(slope))
    assert acceleration == pytest.approx(expected, rel=0.02)


def test_lateral_speed_is_in_the_truth_and_as_theory_says():
    robot = load_robot(parameters=RobotParameters(com_x=0.02))
    fleet = Fleet(robot, np.zeros((1, 3)), radius_error=0.0)
    omega = np.array([2.0, 4.0])
    (log,) = open_loop(fleet, omega, 3.0, period=0.05)
    ground = Ground()
    pitch = fleet.attitude()[0, 2]
    forwards = 0.02 + 0.12 * pitch  # it leans forwards, and so does its weight
    contact = line_contact(0.168, 0.17, ground.along, ground.across, (forwards, 0.0, 0.12))
    v, u, w = steady_twist(omega * 0.06, contact, 9.81)
    assert abs(u) > 5e-3
    # the grip's lag of 10 ms moves the centre of rotation forwards by 10 ms of way; see
    # models/README.md
    expected = [v, u - 0.01 * v * w, w]
    twist = log.truth.twist[-20:].mean(axis=0)
    np.testing.assert_allclose(twist, expected, rtol=0.02)


def test_the_needed_traction_is_that_of_slope_and_pull(robot):
    slope = 0.15
    force = 20.0
    headings = np.array([0.0, np.pi / 2, 0.7])
    start = np.column_stack([np.zeros((3, 2)), headings])
    fleet = Fleet(robot, start, Ground(slope=slope, uphill=np.pi / 2), pull=Pull(force))
    weight = robot.mass * np.linalg.norm(robot.model.opt.gravity)
    towed = force / (weight * np.cos(slope))
    uphill = np.column_stack([np.sin(headings), np.cos(headings)])
    expected = np.tan(slope) * uphill + [towed, 0.0]
    np.testing.assert_allclose(fleet.needed_traction(), expected, rtol=1e-6, atol=1e-9)


def test_a_known_sideslip_keeps_the_line_across_a_slope(robot):
    """Straight across a slope of 10 deg, it crabs by C t; the heading that the controller holds
    must allow for it.
    """
    half_gauge = robot.geometry.half_gauge
    line = SegmentedReference((0.0, 0.0, 0.0), [Segment(8.0, 0.15, 0.0)])
    fleet = Fleet(robot, np.zeros((2, 3)), Ground(slope=TEN_DEGREES, uphill=np.pi / 2, shear=0.01))
    unknown = FixedLaw(ConstantIcr(0.035, half_gauge, 0.004))
    known = LoadedLaw(IcrLoad(0.035, half_gauge, 0.004, 0.085, 0.2))
    pilots = [
        Pilot(LinearTimeVarying(), [0], unknown),
        Pilot(LinearTimeVarying(), [1], known),
    ]
    logs = closed_loop(fleet, pilots, line)
    aside_unknown, aside_known = [abs(log.truth.pose[-1, 1]) for log in logs]
    assert aside_unknown > 0.006
    assert aside_known < aside_unknown / 2
