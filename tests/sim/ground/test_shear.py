"""Ground that shears under a fleet: against theory, its bits, its state, and what is refused."""

import numpy as np
import pytest

from sim.drive.drive import tireless
from sim.drive.pull import Pull
from sim.fleet import Fleet
from sim.ground.ground import Ground, Patch
from sim.ground.shear import LARGEST, LEAST_SHARE
from trackslip.errors import InvalidValueError
from trackslip.kinematics import track_slip
from trackslip.skid_theory import Load, line_contact, steady_twist

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
    contact = line_contact(0.168, 0.17, 0.7, 0.778, (0.0, 0.0, 0.12), points=100)
    theory = steady_twist(0.06 * omega[:3], contact, 9.81, shear=0.01)
    uphill = steady_twist(0.06 * omega[3:], contact, 9.81, shear=0.01, load=Load(slope=0.17))
    spread = omega[:3, 1] - omega[:3, 0]
    half_width, expected = spread / twist[:3, 2], spread / theory[:, 2]
    np.testing.assert_allclose(half_width, expected, rtol=0.01)
    np.testing.assert_allclose(half_width[:2], expected[:2], rtol=0.004)
    slip, climbing = (track_slip(omega[3:], some[:, ::2], robot.geometry) for some in (twist[3:], uphill))
    np.testing.assert_allclose(slip, climbing, atol=1e-3)


def test_what_is_pulled_slips_as_theory_says(robot):
    fleet = Fleet(robot, np.zeros((1, 3)), SANDY, 0.0, tireless(), pull=Pull(60.0, 0.1))
    drive(fleet, [4.0, 4.0], 6.0)
    before = fleet.pose()[0, 0]
    fleet.advance(1.0)
    slip = 1 - (fleet.pose()[0, 0] - before) / 0.24
    contact = line_contact(0.168, 0.17, 0.7, 0.778, (0.0, 0.0, 0.12), points=100)
    expected = steady_twist([1.0, 1.0], contact, shear=0.01, load=Load(pull=60 / (25 * 9.81), hitch_height=0.1))
    assert slip == pytest.approx(1 - expected[0], abs=2e-4)
    np.testing.assert_allclose(fleet.drive.torque.sum(), 0.06 * 60 + 2 * 0.3, rtol=0.02)  # and the gears' friction


def test_the_ground_holds_a_parked_robot_with_just_the_shear_it_needs(robot):
    slope = np.radians(10.0)
    grounds = [Ground(shear=k, slope=slope, uphill=0.5) for k in (0.002, 0.01, 0.025)]
    fleet = Fleet(robot, [[0.0, 0.0, 0.2]] * 3, grounds)
    needed = np.tan(slope) * np.hypot(np.cos(0.3) / 0.7, np.sin(0.3) / 0.778)
    contact = line_contact(0.168, 0.17, 0.7, 0.778, (0.0, 0.0, 0.12), points=10)
    load = contact.loads(np.tan(slope) * np.array([np.cos(0.3), np.sin(0.3)]))
    np.testing.assert_allclose((fleet.shear.share * load).sum(axis=1), needed, rtol=0.03)
    direction = 0.2 + np.arctan2(np.sin(0.3) / 0.778**2, np.cos(0.3) / 0.7**2)  # of the push, but for its sign
    for shear, moved, share in zip((0.002, 0.01, 0.025), fleet.shear.displacement, fleet.shear.share, strict=True):
        np.testing.assert_allclose(np.hypot(*moved.T), -shear * np.log(1 - share), rtol=1e-6)
        np.testing.assert_allclose(np.arctan2(*-moved.T[::-1]), direction, rtol=1e-6)
    coulomb = Fleet(robot, [[0.0, 0.0, 0.2]], Ground(slope=slope, uphill=0.5))
    for each in (fleet, coulomb):
        each.advance(5.0)
    crept = np.hypot(*fleet.pose()[:, :2].T)
    assert crept.max() < 1.2 * np.hypot(*coulomb.pose()[0, :2])


def test_hard_patches_act_in_full_on_ground_that_shears(robot):
    hard = Patch((-1.0, 1.0), (0.0, 1.0), 0.7, 0.778, shear=0.0)
    fleet = Fleet(robot, np.zeros((1, 3)), Ground(shear=0.01, patches=(hard,)))
    drive(fleet, [3.0, 3.0], 0.5)
    left, right = np.split(fleet.shear.share[0], 2)
    assert np.all(left == 1)
    assert np.all(right < 0.9)


def test_displacements_stay_bounded_under_belts_that_stand(robot):
    fleet = Fleet(robot, np.zeros((2, 3)), Ground(shear=0.002), 0.0, tireless())
    drive(fleet, [[0.0, 4.0], [-5.0, 0.0]], 6.0)
    assert np.linalg.norm(fleet.shear.displacement, axis=-1).max() <= LARGEST * 0.002 * (1 + 1e-12)
    assert fleet.shear.share.min() >= LEAST_SHARE
    assert fleet.shear.share.max() <= 1
    contact = line_contact(0.168, 0.17, 0.7, 0.778, (0.0, 0.0, 0.12), points=100)
    theory = steady_twist([[0.0, 0.24], [-0.3, 0.0]], contact, 9.81, shear=0.002)
    np.testing.assert_allclose(fleet.twist()[:, 2], theory[:, 2], rtol=0.01)


def test_a_fleet_on_coulomb_ground_has_its_own_pads(robot):
    assert len(Fleet(robot, np.zeros((1, 3))).robot.pad_side) == 10
    fleet = Fleet(robot, np.zeros((1, 3)), shears=True)
    assert len(fleet.robot.pad_side) == 20
    fleet.set_ground(SANDY)
    fleet.advance(0.1)
    with pytest.raises(InvalidValueError, match=r"ground\.shear = 0\.01: must be 0 for a fleet"):
        Fleet(robot, np.zeros((1, 3))).set_ground(SANDY)


def test_a_steady_turn_hardly_ripples(robot):
    """Parabolas between the points of a track, without the cubic's term, would leave three times as much."""
    fleet = Fleet(robot, np.zeros((1, 3)), SANDY, 0.0, tireless())
    drive(fleet, [-3.0, 3.0], 2.0)
    yaw_rate = []
    for _ in range(100):
        fleet.advance(0.01)
        yaw_rate.append(fleet.twist()[0, 2])
    assert np.std(yaw_rate) < 2e-3 < 0.5 < yaw_rate[-1]
