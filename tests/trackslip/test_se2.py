import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm

from trackslip import se2

poses = arrays(float, (4, 3), elements=st.floats(-6, 6))
motions = arrays(float, (4, 3), elements=st.floats(-3, 3))


def matrix(pose):
    """The homogeneous matrix (3, 3) of a pose (3,)."""
    x, y, phi = pose
    cos = np.cos(phi)
    sin = np.sin(phi)
    return np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1]])


def assert_same(pose, matrices):
    np.testing.assert_allclose([matrix(one) for one in pose], matrices, atol=1e-12)


@given(poses, poses)
def test_composition_is_the_product_of_matrices(frame, pose):
    products = [matrix(a) @ matrix(b) for a, b in zip(frame, pose, strict=True)]
    assert_same(se2.compose(frame, pose), products)


@given(poses)
def test_the_inverse_is_that_of_the_matrix(pose):
    assert_same(se2.inverse(pose), [np.linalg.inv(matrix(one)) for one in pose])


@given(poses, poses)
def test_between_undoes_composition(frame, pose):
    composed = se2.compose(frame, pose)
    np.testing.assert_allclose(se2.between(frame, composed), pose, atol=1e-12)


@given(poses, poses)
def test_points_are_moved_as_the_origins_of_composed_poses(frame, pose):
    points = pose[:, :2]
    moved = se2.compose(frame, pose)[:, :2]
    np.testing.assert_allclose(se2.to_world(frame, points), moved, atol=1e-12)
    np.testing.assert_allclose(se2.from_world(frame, moved), points, atol=1e-12)


@given(poses, poses)
def test_a_rotated_direction_is_that_of_the_sum_of_angles(frame, pose):
    first = frame[:, 2]
    second = pose[:, 2]
    rotated = se2.rotate(first, se2.direction(second))
    np.testing.assert_allclose(rotated, se2.direction(first + second))


@given(motions)
def test_an_arc_is_the_exponential_of_its_motion(motion):
    arcs = se2.exp(motion)
    expected = []
    for forward, left, turn in motion:
        generator = np.array([[0, -turn, forward], [turn, 0, left], [0, 0, 0]])
        expected.append(expm(generator))
    assert_same(arcs, expected)
    np.testing.assert_allclose(se2.log(arcs), motion, atol=1e-12)


@given(poses, motions)
def test_a_drive_ends_on_its_arc_and_has_its_derivatives(pose, motion):
    after, by_pose, by_motion = se2.drive(pose, motion)
    np.testing.assert_allclose(after, se2.compose(pose, se2.exp(motion)), atol=1e-12)

    def end(pose, motion):
        after, _, _ = se2.drive(pose, motion)
        return after

    h = 1e-6
    for k, step in enumerate(h * np.eye(3)):
        of_pose = (end(pose + step, motion) - end(pose - step, motion)) / (2 * h)
        of_motion = (end(pose, motion + step) - end(pose, motion - step)) / (2 * h)
        np.testing.assert_allclose(by_pose[..., k], of_pose, atol=1e-8)
        np.testing.assert_allclose(by_motion[..., k], of_motion, atol=1e-8)


@given(poses, motions, st.floats(0, 10))
def test_a_twist_without_lateral_speed_drives_the_same_arc(pose, motion, duration):
    twist = motion[:, [0, 2]]
    motion[:, 1] = 0.0
    advanced = se2.advance(pose, twist, duration)
    along_motion = se2.compose(pose, se2.exp(duration * motion))
    np.testing.assert_allclose(advanced, along_motion, atol=1e-11)


@given(poses)
def test_a_chain_of_steps_leads_along_its_poses(pose):
    np.testing.assert_allclose(se2.chain(pose[0], se2.steps(pose)), pose, atol=1e-11)


@pytest.mark.parametrize("turn", [0.0, 1e-9, -0.01, 0.5, -0.5 - 1e-9, 3.0, -20.0])
def test_quotients_of_arcs_are_integrals(turn):
    """Of cos(s t), sin(s t) and their derivatives by t, over s from 0 to 1."""
    # Gauss-Legendre nodes and weights on [-1, 1], moved to [0, 1]
    node, weight = np.polynomial.legendre.leggauss(60)
    s = (node + 1) / 2
    weight = weight / 2
    cosine = np.cos(s * turn)
    sine = np.sin(s * turn)
    integrands = [cosine, sine, -s * sine, s * cosine]
    expected = [weight @ integrand for integrand in integrands]
    quotients = se2.arc_quotients(turn)
    np.testing.assert_allclose(quotients, expected, atol=1e-14)
    of_many = se2.arc_quotients(np.full((2, 3), turn))
    np.testing.assert_array_equal(of_many, np.multiply.outer(quotients, np.ones((2, 3))))


@given(st.floats(-100, 100))
def test_wrapped_angles_are_the_same_angle(angle):
    wrapped = float(se2.wrap_angle(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-9)
