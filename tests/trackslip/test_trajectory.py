import numpy as np
import pytest

from trackslip.errors import InvalidValueError
from trackslip.trajectory import Segment, SegmentedReference, circle, paper_reference

REFERENCES = {
    "paper": paper_reference(),
    "left circle": circle(1.25, 0.15, 40.0, (1.0, 2.0, 0.5)),
    "right circle": circle(-0.8, 0.15, 40.0),
    "reverse": SegmentedReference((0, 0, 0), [Segment(3.0, 0.0, -0.2, 0.5), Segment(3.0, -0.2, 0.0, -0.5)]),
}


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
    np.testing.assert_allclose(reference.twist([-1.0, 46.0]), 0)
    np.testing.assert_array_equal(reference.pose(100.0), reference.pose(reference.duration))


@pytest.mark.parametrize("name", REFERENCES)
def test_pose_is_continuous_and_the_integral_of_the_twist(name):
    reference = REFERENCES[name]
    time = np.linspace(0, reference.duration, 20_001)
    pose, step = reference.pose(time), time[1]
    middle = reference.pose((time[1:] + time[:-1]) / 2)
    v, w = reference.twist((time[1:] + time[:-1]) / 2).T
    rate = np.column_stack([v * np.cos(middle[:, 2]), v * np.sin(middle[:, 2]), w])
    assert np.abs(np.diff(pose, axis=0)).max() < 0.3 * step
    np.testing.assert_allclose(pose[0] + np.cumsum(rate * step, axis=0), pose[1:], atol=1e-3)
    inside = np.abs(np.diff(pose, axis=0) / step - rate).max(axis=1)
    assert np.sort(inside)[-8:].max() < 0.15  # steps across a change of segment
    assert np.sort(inside)[:-8].max() < 1e-5


def test_leading_shapes():
    assert paper_reference().pose(np.zeros((2, 3))).shape == (2, 3, 3)
    assert paper_reference().twist(np.zeros((2, 3))).shape == (2, 3, 2)


def test_impossible_references_are_refused():
    with pytest.raises(InvalidValueError, match="duration"):
        Segment(0.0, 0.1, 0.1)
    with pytest.raises(InvalidValueError, match="segments"):
        SegmentedReference((0, 0, 0), [])
    with pytest.raises(InvalidValueError, match="radius"):
        circle(0.0, 0.1, 10.0)
