"""Laws that choose their own speed: path following with a virtual target, and regulated pure pursuit."""

import numpy as np
import pytest
from linearised import error_gains, pose_with_error

from trackslip.controllers.error_feedback import LinearTimeVarying
from trackslip.controllers.path_following import PathFollowing
from trackslip.controllers.steering import PurePursuit, RegulatedPurePursuit
from trackslip.kinematics import advance
from trackslip.trajectory.segmented import Segment, SegmentedReference, circle

SPEEDS = pytest.mark.parametrize("speed", [0.15, -0.15])


@SPEEDS
def test_errors_across_decay_with_the_distance_as_stated(speed):
    law = PathFollowing(approach_angle=0.7, approach=3.0, across=6.0, heading=4.0)
    _, (_, by_left, by_turn) = error_gains(law, 5.0, circle(1e9, speed, 40.0))
    motion = np.array([[0.0, speed], [-by_left, -by_turn]]) / abs(speed)  # of (y, theta) = -(e_y, e_phi), per metre
    slope = 0.7 * 3.0
    np.testing.assert_allclose(np.poly(motion), [1.0, 4.0 + slope, 4.0 * slope + 6.0], rtol=1e-6)


def drive(law, reference, pose, duration, held=0.0, step=0.05):
    """Poses (T, ..., 3) and twists (T, ..., 2) of ideal robots, held in place for the first `held` seconds."""
    poses, twists = [], []
    for k in range(round(duration / step)):
        twists.append(law.twist(k * step, pose, reference))
        pose = pose if k * step < held else advance(pose, twists[-1], step)
        poses.append(pose)
    return np.array(poses), np.array(twists)


@SPEEDS
def test_a_late_robot_stays_on_its_path_and_hurries_by_a_limited_share(speed):
    """Held for 3 s on a circle of 1 m, it is 0.45 m late; Eq. 31 then cuts the corner by centimetres."""
    reference = circle(1.0, speed, 60.0)

    def away(law):
        poses, twists = drive(law, reference, reference.pose(0.0), 40.0, held=3.0)
        assert np.hypot(*(poses[-1] - reference.pose(40.0))[:2]) < 2e-3
        return np.abs(np.hypot(poses[:, 0], poses[:, 1] - 1.0) - 1.0).max(), np.abs(twists[:, 0])

    distance, speeds = away(PathFollowing())
    assert distance < 5e-3
    assert speeds.max() == pytest.approx(1.3 * abs(speed), rel=0.02)
    assert away(LinearTimeVarying())[0] > 0.02


@SPEEDS
def test_regulated_pure_pursuit_is_pure_pursuit_where_nothing_is_regulated(speed):
    reference = circle(1.0, speed, 40.0)
    plain = error_gains(PurePursuit(look_ahead=0.3), 5.0, reference)
    np.testing.assert_allclose(error_gains(RegulatedPurePursuit(lookahead_time=2.0), 5.0, reference), plain, atol=1e-9)
    near = RegulatedPurePursuit(min_lookahead_dist=0.3, max_lookahead_dist=0.3)
    np.testing.assert_allclose(error_gains(near, 5.0, reference), plain, atol=1e-9)


def test_speed_falls_before_a_cusp_where_the_robot_is():
    ramps = [Segment(2.0, 0.2, 0.2), Segment(2.0, -0.2, -0.2)]
    reference = SegmentedReference((0.0, 0.0, 0.0), ramps)
    law = RegulatedPurePursuit(approach_velocity_scaling_dist=0.2, stiffness=1e-9)  # doesn't hurry
    for time, behind, wanted in (
        (0.5, 0.0, 0.2),
        (1.5, 0.0, 0.1),
        (1.5, 0.05, 0.15),
        (1.9, 0.0, 0.05),
        (3.7, 0.0, 0.06),
    ):
        pose = pose_with_error(reference.pose(time), np.array([behind, 0.0, 0.0]))
        v, w = law.twist(time, pose, reference)
        np.testing.assert_allclose([abs(v), w], [wanted, 0.0], atol=1e-5)
