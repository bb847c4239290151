import numpy as np
import pytest
from linearised import pose_with_error

from trackslip.controllers.dynamic_feedback import DynamicFeedback
from trackslip.kinematics import advance
from trackslip.trajectory.segmented import Segment, SegmentedReference


@pytest.mark.parametrize(("speed", "stiffness", "damping"), [(0.15, 1.0, 1.4), (-0.15, 0.5, 2.0)])
def test_each_axis_is_a_damped_spring(speed, stiffness, damping):
    """e'' + k_d e' + k_p e = 0 in the world frame, along an arc that speeds up, against its solution."""
    reference = SegmentedReference((1.0, 2.0, 0.7), [Segment(10.0, speed, 1.5 * speed, 0.8)])
    controller = DynamicFeedback(stiffness, damping)
    pose = pose_with_error(reference.pose(0.0), np.array([0.03, 0.04, 0.1]))
    step, steps = 1e-3, 1500
    error, twist = np.zeros((steps, 2)), np.zeros((steps, 2))
    for k in range(steps):
        error[k] = (reference.pose(k * step) - pose)[:2]
        twist[k] = controller.twist(k * step, pose, reference)
        if k == 0:
            heading = [np.cos(pose[2]), np.sin(pose[2])]
            desired = np.array([np.cos(0.7), np.sin(0.7)]) * speed
            rate = desired - twist[0, 0] * np.array(heading)
        pose = advance(pose, twist[k], step)
    roots = np.roots([1, damping, stiffness]).astype(complex)
    weights = np.linalg.solve([[1, 1], roots], np.stack([error[0], rate]))
    wanted = (np.exp(np.outer(np.arange(steps) * step, roots)) @ weights).real
    np.testing.assert_allclose(error, wanted, atol=1e-4)


def test_the_speed_never_jumps():
    """Through stop, cusp and end, with an error that makes both laws disagree."""
    forwards = [Segment(3.0, 0.0, 0.15, 0.5), Segment(3.0, 0.15, 0.0, 0.5)]
    backwards = [Segment(3.0, 0.0, -0.15, -0.5), Segment(3.0, -0.15, 0.0, -0.5)]
    reference = SegmentedReference((0.0, 0.0, 0.0), [*forwards, *backwards])
    controller = DynamicFeedback(stiffness=0.5)
    pose = pose_with_error(reference.pose(0.0), np.array([[0.08, 0.1, 0.3], [-0.08, 0.05, 0.0], [0.0, 0.0, 0.0]]))
    step = 0.02
    twists = []
    for k in range(700):
        twists.append(controller.twist(k * step, pose, reference))
        pose = advance(pose, twists[-1], step)
    jumps = np.abs(np.diff(twists, axis=0))
    assert jumps[..., 0].max() < 0.5 * step  # 0.5 m/s^2
    assert np.abs(twists).max() < 1.5
