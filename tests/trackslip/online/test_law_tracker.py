"""Dead reckoning by the law in use, while scans show no pose."""

from dataclasses import replace

import numpy as np
import pytest

from trackslip import se2
from trackslip.kinematics import RobotGeometry
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.file import SHIPPED, load_laws
from trackslip.laws.icr import IcrLoad, IcrSides
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.localization.pose_tracker import Tracker
from trackslip.odometry.identified import LawInUse, identified_law
from trackslip.odometry.uncertainty import LawErrors, SlipNoise
from trackslip.online.compensation import FixedLaw, known_law, named_compensation
from trackslip.online.law_tracker import LawTracker

GEOMETRY = RobotGeometry(0.168, 0.06)
PERIOD = 0.05
START = np.array([[0.0, 0.0, 0.5], [1.0, -1.0, 2.0]])
ROWS = 300
# sprocket speeds in turns to both sides [rad/s]
OMEGA = 3.0 + np.stack(
    [np.sin(np.arange(ROWS) / 20)[:, None] * [[1.0, -1.0]], np.full((ROWS, 2), [-0.8, 0.8])], axis=1
)


def unseen(pose):
    """What a locator returns that doesn't find the plate."""
    robots = len(pose)
    covariance = np.full((robots, 3, 3), np.nan)
    return PoseEstimate(pose.copy(), covariance, np.zeros(robots, bool))


def driven_blind(tracker, first=0, last=ROWS):
    """The tracker's estimate after motions in which no pose was measured."""
    for omega in OMEGA[first:last]:
        estimate = tracker.update(unseen(tracker.predict(omega, PERIOD)))
    return estimate


def driven(law):
    """Poses (2, 3) after motions by a law."""
    pose = START
    for omega in OMEGA:
        pose = se2.advance(pose, law.twist(omega, GEOMETRY), PERIOD)
    return pose


def tracker_with(compensation):
    compensation.reset(START)
    return LawTracker(START, GEOMETRY, [(range(2), compensation)])


@pytest.mark.parametrize(
    "law",
    [
        "exponential",
        pytest.param("exponential_speed", marks=pytest.mark.slow),
        "icr",
        "icr_radius",
    ],
)
def test_a_blind_robot_drives_on_by_its_law_and_covariance(law):
    estimate = driven_blind(tracker_with(named_compensation(law, GEOMETRY)))
    assert not estimate.valid.any()
    in_use = identified_law(SHIPPED, law)
    np.testing.assert_allclose(estimate.pose, driven(in_use.law), atol=1e-9)
    odometry = in_use.odometry(start=START)
    times = PERIOD * np.arange(ROWS + 1)
    path = odometry.path(times, np.concatenate([OMEGA[:1], OMEGA]))
    np.testing.assert_allclose(estimate.covariance, path.covariance[-1], rtol=1e-9)


def test_slip_that_varies_adds_to_the_covariance():
    law = load_laws()["icr_radius"]
    errors = LawErrors(("offset",), np.array([[1e-6]]))
    quiet, loud = (
        driven_blind(tracker_with(FixedLaw(law, LawInUse("icr", law, GEOMETRY, noise, errors))))
        for noise in (None, SlipNoise(0.01, 0.01, 0.01))
    )
    grown = loud.covariance - quiet.covariance
    assert (np.einsum("nii->ni", grown) > 0).all()
    np.testing.assert_array_equal(loud.pose, quiet.pose)


def test_laws_of_unknown_errors_predict_all_the_same():
    sides = IcrSides(0.03, 0.06, 0.01, -0.01, GEOMETRY.half_gauge)
    for law in (PUBLISHED, sides):
        estimate = driven_blind(tracker_with(known_law(law)))
        np.testing.assert_allclose(estimate.pose, driven(law), atol=1e-9)
        without = driven_blind(Tracker(START, GEOMETRY))
        ratio = np.einsum("nii->ni", estimate.covariance) / np.einsum("nii->ni", without.covariance)
        assert (np.abs(ratio - 1) < 0.5).all()


def test_every_robot_has_the_law_of_its_own_compensation():
    names = ("icr_radius", "none")
    compensations = [named_compensation(name, GEOMETRY) for name in names]
    pairs = [([1], compensations[0]), ([0], compensations[1])]
    together = driven_blind(LawTracker(START, GEOMETRY, pairs))
    by_law = driven_blind(tracker_with(compensations[0]))
    without = driven_blind(Tracker(START, GEOMETRY))
    np.testing.assert_array_equal(together.pose[1], by_law.pose[1])
    np.testing.assert_allclose(together.covariance[1], by_law.covariance[1], rtol=1e-9)
    np.testing.assert_allclose(together.pose[0], without.pose[0], atol=1e-9)
    np.testing.assert_allclose(together.covariance[0], without.covariance[0], rtol=1e-9)


def test_what_is_learnt_online_is_used_with_its_errors():
    learning = named_compensation("online_cold", GEOMETRY)
    tracker = tracker_with(learning)
    law = load_laws()["icr_radius"]
    pose = START
    noise = np.tile(np.diag([1e-3, 1e-3, 1e-3]) ** 2, (2, 1, 1))
    for omega in OMEGA:
        pose = se2.advance(pose, law.twist(omega, GEOMETRY), PERIOD)
        tracker.predict(omega, PERIOD)
        measured = tracker.update(PoseEstimate(pose, noise, np.ones(2, bool)))
        learning.observe(omega, PERIOD, measured)
    blind = driven_blind(tracker)
    for omega in OMEGA:
        pose = se2.advance(pose, law.twist(omega, GEOMETRY), PERIOD)
    assert np.hypot(*(blind.pose - pose)[:, :2].T).max() < 0.01
    without = driven_blind(Tracker(START, GEOMETRY))
    assert (blind.covariance[:, 2, 2] < 0.05 * without.covariance[:, 2, 2]).all()


def test_a_blind_robot_slides_down_a_slope_as_its_law_says():
    law = IcrLoad(0.035, GEOMETRY.half_gauge, 0.004, compliance=0.085, turn_compliance=0.2)
    compensation = known_law(law)
    tracker = tracker_with(compensation)
    compensation.sense(np.tile([0.05, 0.1], (2, 1)))  # uphill ahead and to the left
    first = tracker.predict(OMEGA[0], PERIOD)
    estimate = tracker.update(unseen(first))
    twist = compensation.law().twist(OMEGA[0], GEOMETRY)
    leftwards = se2.from_world(se2.advance(START, twist, PERIOD), estimate.pose[:, :2])[:, 1]
    expected = compensation.law().sideslip(twist) * PERIOD
    assert (expected < -1e-5).all()
    np.testing.assert_allclose(leftwards, expected, rtol=0.01)


def test_poses_in_every_scan_make_it_the_same_as_without_law():
    trackers = (tracker_with(named_compensation("icr_radius", GEOMETRY)), Tracker(START, GEOMETRY))
    rng = np.random.default_rng(0)
    noise = np.tile(np.eye(3) * 1e-6, (2, 1, 1))
    for omega in OMEGA:
        poses = [tracker.predict(omega, PERIOD) for tracker in trackers]
        np.testing.assert_array_equal(*poses)
        measured = poses[0] + 1e-3 * rng.standard_normal((2, 3))
        found = [
            tracker.update(PoseEstimate(measured, noise, np.ones(2, bool))) for tracker in trackers
        ]
        np.testing.assert_array_equal(found[0].pose, found[1].pose)
        np.testing.assert_array_equal(found[0].covariance, found[1].covariance)


def test_a_pose_found_after_a_whole_blind_turn_is_believed():
    """Without slip, the heading would be off by more than a right angle."""
    trackers = (tracker_with(named_compensation("icr_radius", GEOMETRY)), Tracker(START, GEOMETRY))
    law = load_laws()["icr_radius"]
    turning = np.tile([-2.0, 2.0], (2, 1))
    rows = round(2 * np.pi / law.twist(turning, GEOMETRY)[0, 1] / PERIOD)
    believed = []
    for tracker in trackers:
        for _ in range(rows):
            predicted = tracker.predict(turning, PERIOD)
            tracker.update(unseen(predicted))
        noise = np.tile(np.eye(3) * 1e-6, (2, 1, 1))
        seen = START.copy()
        seen[:, 2] += rows * PERIOD * law.twist(turning, GEOMETRY)[0, 1]
        predicted = tracker.predict(np.zeros((2, 2)), PERIOD)
        believed.append(tracker.update(PoseEstimate(seen, noise, np.ones(2, bool))).valid.all())
    assert believed == [True, False]


def test_a_state_restored_while_blind_goes_on_to_the_bit():
    whole = tracker_with(named_compensation("icr_radius", GEOMETRY))
    expected = driven_blind(whole)
    first = tracker_with(named_compensation("icr_radius", GEOMETRY))
    driven_blind(first, last=100)
    other = tracker_with(named_compensation("icr_radius", GEOMETRY))
    driven_blind(other, last=7)
    other.set_state(first.get_state())
    estimate = driven_blind(other, first=100)
    np.testing.assert_array_equal(estimate.pose, expected.pose)
    np.testing.assert_array_equal(estimate.covariance, expected.covariance)


def test_a_restart_forgets_what_was_driven_blind():
    tracker = tracker_with(named_compensation("icr_radius", GEOMETRY))
    driven_blind(tracker)
    tracker.restart(np.array([1]), START[1:])
    again = driven_blind(tracker)
    anew = driven_blind(tracker_with(named_compensation("icr_radius", GEOMETRY)))
    np.testing.assert_array_equal(again.pose[1], anew.pose[1])
    np.testing.assert_allclose(again.covariance[1], anew.covariance[1], rtol=1e-9)
    assert (again.covariance[0, 2, 2] > 1.5 * anew.covariance[0, 2, 2]).all()


def test_errors_of_a_law_may_differ_between_robots():
    covariances = np.array([[[1e-6]], [[4e-6]]])
    errors = LawErrors(("offset",), covariances)
    law = load_laws()["icr_radius"]
    both = errors.slopes(law, OMEGA[0], GEOMETRY)
    for k in range(2):
        alone = replace(errors, covariance=covariances[k]).slopes(law, OMEGA[0, k], GEOMETRY)
        np.testing.assert_allclose(both[k], alone, rtol=1e-6)
