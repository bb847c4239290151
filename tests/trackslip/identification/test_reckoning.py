import numpy as np
import pytest

from trackslip.identification.path import path_at as paths_at
from trackslip.kinematics import advance

RNG = np.random.default_rng(0)
EDGES = np.cumsum(RNG.uniform(0.01, 0.1, 41))
MOTION = RNG.normal(size=(3, 40)) * [[0.3], [0.1], [1.0]]
NO_SLOPE = np.zeros((3, 0, 40))


def path_at(edges, motion, slope, time):
    row = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)
    return paths_at(edges, motion, slope, time, row)


def advanced(motion, edges, time):
    """A pose, an arc at a time."""
    pose = np.zeros(3)
    for (v, _, w), begin, end in zip(motion.T, edges, edges[1:], strict=False):
        if time <= begin:
            break
        pose = advance(pose, np.array([v, w]), min(time, end) - begin)
    return pose


@pytest.mark.parametrize("turning", [1.0, 1e-3, 0.0])
def test_paths_are_exact_arcs(turning):
    motion = MOTION * [[1], [0], [turning]]
    time = np.sort(RNG.uniform(EDGES[0], EDGES[-1], 50))
    path = path_at(EDGES, motion, NO_SLOPE, time)
    expected = np.array([advanced(motion, EDGES, t) for t in time])
    np.testing.assert_allclose(np.column_stack([path.place.real, path.place.imag, path.heading]), expected, atol=1e-13)


def test_sideways_motion_is_forward_motion_of_a_robot_turned_by_a_right_angle():
    time = np.linspace(EDGES[0], EDGES[-1], 30)
    v, _, w = MOTION
    ahead = path_at(EDGES, np.stack([v, 0 * v, w]), NO_SLOPE, time)
    aside = path_at(EDGES, np.stack([0 * v, v, w]), NO_SLOPE, time)
    np.testing.assert_allclose(aside.place, 1j * ahead.place, atol=1e-13)


@pytest.mark.parametrize("turning", [1.0, 1e-4])
def test_derivatives_and_velocities_are_differences(turning):
    motion = MOTION * [[1], [1], [turning]]
    slope = RNG.normal(size=(3, 4, 40))
    time = np.linspace(EDGES[0] + 0.003, EDGES[-1] + 0.1, 25)
    path, h = path_at(EDGES, motion, slope, time), 1e-6
    for k in range(4):
        ahead, behind = (path_at(EDGES, motion + s * h * slope[:, k], slope, time) for s in (1, -1))
        np.testing.assert_allclose(path.place_slope[k], (ahead.place - behind.place) / (2 * h), atol=1e-7)
        np.testing.assert_allclose(path.heading_slope[k], (ahead.heading - behind.heading) / (2 * h), atol=1e-7)
    ahead, behind = (path_at(EDGES, motion, slope, time + s * h) for s in (1, -1))
    np.testing.assert_allclose(path.velocity, (ahead.place - behind.place) / (2 * h), atol=1e-7)
    np.testing.assert_allclose(path.yaw_rate, (ahead.heading - behind.heading) / (2 * h), atol=1e-7)
