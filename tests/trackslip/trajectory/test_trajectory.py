import numpy as np
import pytest
from quadrature import integral_miss, times

from trackslip.trajectory.curves import ClothoidPath, PathPiece
from trackslip.trajectory.named import REFERENCES
from trackslip.trajectory.profile import LIMITS, MotionLimits, ProfiledReference
from trackslip.trajectory.segmented import Segment, SegmentedReference, circle, paper_reference
from trackslip.trajectory.waypoints import waypoints

START = (0.7, -0.4, 2.5)
HASTY = MotionLimits(speed=0.5, acceleration=0.4, yaw_rate=0.8, track_speed=0.6, half_gauge=0.3)
POINTS = [(0, 0), (1, 0.2), (1.2, 1), (0.1, 1.5), (-1, 0.3)]
MADE = {
    "left circle": circle(1.25, 0.15, 40.0, (1.0, 2.0, 0.5)),
    "right circle": circle(-0.8, 0.15, 40.0),
    "reverse": SegmentedReference((0, 0, 0), [Segment(3.0, 0.0, -0.2, 0.5), Segment(3.0, -0.2, 0.0, -0.5)]),
    "hasty clothoid": ProfiledReference(ClothoidPath(START, [PathPiece(0.8, 3.0, -3.0), PathPiece(0.9)]), HASTY),
    "waypoints": waypoints(POINTS),
    "hasty waypoints": waypoints(POINTS, HASTY),
}
EVERY = {name: make() for name, make in REFERENCES.items()} | MADE
LIMITED = {name: LIMITS for name in REFERENCES if name != "circle"} | {"waypoints": LIMITS}
LIMITED |= {name: HASTY for name in MADE if name.startswith("hasty")}


def test_the_papers_path_is_the_one_in_words():
    reference = paper_reference()
    assert reference.duration == pytest.approx(45.8, abs=0.02)
    np.testing.assert_allclose(reference.pose(0.0), [0, 0, np.pi / 2])
    np.testing.assert_allclose(reference.pose(3.0), [0, 0.015 * 9, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(reference.twist(8.0), [0.15, 0.0])
    np.testing.assert_allclose(reference.twist(20.0), [0.15, 0.12])
    # centre of the arc, radius 1.25, from any pose on it
    x, y, phi = reference.pose(np.linspace(12.1, 33.7, 50)).T
    np.testing.assert_allclose(x - 1.25 * np.sin(phi), -1.25, atol=1e-12)
    np.testing.assert_allclose(y + 1.25 * np.cos(phi), 1.425, atol=1e-12)
    assert reference.pose(34.0)[2] == pytest.approx(4 * np.pi / 3)


@pytest.mark.parametrize("name", EVERY)
def test_pose_is_the_integral_of_the_twist(name):
    assert integral_miss(EVERY[name]) < 1e-10


@pytest.mark.parametrize("name", EVERY)
def test_it_stands_before_and_after(name):
    reference = EVERY[name]
    end = reference.duration
    np.testing.assert_array_equal(reference.twist([-3.0, -1e-9, end, end + 1e-9, end + 100]), 0)
    np.testing.assert_array_equal(reference.pose(-3.0), reference.pose(0.0))
    np.testing.assert_array_equal(reference.pose(end + 100), reference.pose(end))


@pytest.mark.parametrize("name", LIMITED)
def test_it_starts_and_ends_at_rest_and_within_its_limits(name):
    reference, limits = EVERY[name], LIMITED[name]
    time = times(reference)
    time = np.concatenate([time, (time[1:] + time[:-1]) / 2, np.nextafter(reference.knots, 0)])
    v, w = reference.twist(np.sort(time)).T
    slack = 1 + 1e-6
    assert np.abs(v).max() <= limits.speed * slack
    assert np.abs(w).max() <= limits.yaw_rate * slack
    assert (np.abs(v) + limits.half_gauge * np.abs(w)).max() <= limits.track_speed * slack
    knots = reference.knots
    at = knots[:-1] + np.diff(knots) * np.array([[0.25], [0.75]])
    acceleration = np.diff(reference.twist(at)[..., 0], axis=0)[0] / (np.diff(knots) / 2)
    assert np.abs(acceleration).max() <= limits.acceleration * (1 + 1e-5)
    np.testing.assert_allclose(reference.twist([1e-9, reference.duration - 1e-9]), 0, atol=1e-8)


@pytest.mark.parametrize("name", REFERENCES)
def test_a_reference_moves_with_its_start(name):
    """Seen from its first pose, a reference is the same from anywhere."""
    time = np.linspace(0, REFERENCES[name]().duration, 50)

    def seen(start):
        x, y, phi = (REFERENCES[name](start=start).pose(time) - np.array(start)).T
        return np.column_stack([np.exp(-1j * start[2]) * (x + 1j * y), phi])

    np.testing.assert_allclose(seen((3.0, -7.0, 2.0)), seen((0.0, 0.0, 0.0)), atol=1e-11)
