"""Ground that shears under a fleet: against theory, its bits, its state, and what is refused."""

import numpy as np
import pytest

from sim.drive.drive import Drive, tireless
from sim.drive.pull import Pull
from sim.fleet import Fleet, Setting
from sim.ground.ground import Change, Ground, Patch
from sim.ground.shear import LARGEST, LEAST_SHARE
from trackslip.errors import InvalidValueError
from trackslip.kinematics import track_slip
from trackslip.skid_theory import Load, line_contact, steady_twist

SANDY = Ground(shear=0.01)
OMEGA = np.array([[2.0, 3.0], [-5.0, 5.0], [4.0, 1.0], [3.0, 3.0]])
HILLS = [
    Ground(shear=0.005, slope=0.1, uphill=0.4),
    Ground(shear=0.01, patches=(Patch((0.1, 0.4), (-1, 1), 0.5, 0.6), Patch((0.3, 0.5), (-1, 1), 0.7, 0.8, 0.002))),
    Ground(shear=0.025, changes=(Change(0.5, 0.6, 0.7), Change(1.0, 0.5, 0.6, 0.001))),
    Ground(slope=0.05),
]


def drive(fleet, omega, seconds):
    fleet.command(omega)
    for _ in range(round(seconds / 0.05)):
        fleet.advance(0.05)


def bits(fleet, rows=slice(None)):
    return [np.array(part)[rows] for part in (fleet.batch.state, fleet.shear.displacement, fleet.shear.share)]


def assert_same(some, others):
    for one, other in zip(some, others, strict=True):
        np.testing.assert_array_equal(one, other)


SLOW = pytest.mark.slow


@pytest.mark.parametrize("shear", [pytest.param(0.002, marks=SLOW), 0.01, pytest.param(0.025, marks=SLOW)])
def test_turns_and_slopes_are_those_of_theory(robot, shear):
    omega = np.array([[3.0, 4.0], [4.0, 2.5], [-3.0, 3.0], [4.0, 4.0], [-4.0, -4.0]])
    grounds = [Ground(shear=shear)] * 3 + [Ground(shear=shear, slope=0.17)] * 2
    fleet = Fleet(robot, np.zeros((5, 3)), grounds, 0.0, tireless())
    drive(fleet, omega, 6.0)
    twist = np.zeros((5, 3))
    for _ in range(20):
        fleet.advance(0.05)
        twist += fleet.twist() / 20
    contact = line_contact(0.168, 0.17, 0.7, 0.778, (0.0, 0.0, 0.12), points=100)
    theory = steady_twist(0.06 * omega[:3], contact, 9.81, shear=shear)
    uphill = steady_twist(0.06 * omega[3:], contact, 9.81, shear=shear, load=Load(slope=0.17))
    spread = omega[:3, 1] - omega[:3, 0]
    half_width, expected = spread / twist[:3, 2], spread / theory[:, 2]
    np.testing.assert_allclose(half_width, expected, rtol=0.01)
    np.testing.assert_allclose(half_width[:2], expected[:2], rtol=0.004)
    found = track_slip(omega, twist[:, ::2], robot.geometry)
    np.testing.assert_allclose(
        found[3:], track_slip(omega, np.r_[theory, uphill][:, ::2], robot.geometry)[3:], atol=1e-3
    )


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


def test_same_bits_at_any_number_of_threads_and_in_any_company(robot):
    fleets = [Fleet(robot, np.zeros((4, 3)), HILLS, threads=threads) for threads in (1, 2)]
    for fleet in fleets:
        drive(fleet, OMEGA, 1.5)
    assert_same(bits(fleets[0]), bits(fleets[1]))
    for k in range(3):
        alone = Fleet(robot, np.zeros((1, 3)), HILLS[k], threads=1)
        drive(alone, OMEGA[k], 1.5)
        assert_same(bits(alone, 0), bits(fleets[0], k))


def test_a_weak_motor_is_driven_again_from_where_the_ground_was(robot):
    """A robot with a weak motor, beside another: its trials leave no trace in the ground of either."""
    weak = Drive(torque_limit=1.2)
    both = Fleet(robot, np.zeros((2, 3)), Ground(shear=0.005, slope=0.05), drive=weak)
    drive(both, [[-3.0, 3.0], [1.0, 1.0]], 0.3)
    assert both.drive.saturated_time[0].max() > 0.05
    for k, omega in enumerate(([-3.0, 3.0], [1.0, 1.0])):
        alone = Fleet(robot, np.zeros((1, 3)), Ground(shear=0.005, slope=0.05), drive=weak, threads=1)
        drive(alone, omega, 0.3)
        assert_same(bits(alone, 0), bits(both, k))
    in_pieces = Fleet(robot, np.zeros((1, 3)), Ground(shear=0.005, slope=0.05), drive=weak)
    in_pieces.command([-3.0, 3.0])
    for _ in range(30):
        in_pieces.advance(0.01)
    assert_same(bits(in_pieces, 0), bits(both, 0))


def test_a_robot_begun_anew_forgets_the_ground_that_it_stood_on(robot):
    setting = Setting((0.3, -0.2, 1.0), HILLS[0], radius_error=0.02, weight=(0.02, -0.01))
    alone = Fleet(robot, np.zeros((1, 3)), shears=True)
    company = Fleet(robot, np.zeros((3, 3)), HILLS[:3])
    drive(company, OMEGA[:3], 0.7)
    alone.restart([0], [setting])
    others = [part[[0, 2]] for part in bits(company)]
    company.restart([1], [setting])
    assert_same(others, bits(company, [0, 2]))
    drive(alone, OMEGA[1], 0.5)
    drive(company, OMEGA[[0, 1, 2]], 0.5)
    assert_same(bits(alone, 0), bits(company, 1))


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


def test_level_ground_at_rest_is_not_sheared(robot):
    fleet = Fleet(robot, np.zeros((1, 3)), SANDY)
    assert np.all(fleet.shear.displacement == 0)
    fleet.advance(2.0)
    assert np.hypot(*fleet.pose()[0, :2]) < 1e-5


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


@pytest.mark.parametrize("shear", [-0.001, np.nan, 0.21, np.inf])
def test_moduli_out_of_range_are_refused(shear):
    for make in (lambda k: Ground(shear=k), lambda k: Patch((0, 1), (0, 1), 1, 1, k), lambda k: Change(0, 1, 1, k)):
        with pytest.raises(InvalidValueError, match=r"shear = .*: must be"):
            make(shear)
