import numpy as np
import pytest

from trackslip.controllers.pure_pursuit import PathAhead
from trackslip.kinematics import advance
from trackslip.trajectory.segmented import Segment, SegmentedReference, circle, paper_reference


@pytest.mark.parametrize("speed", [0.15, -0.15])
@pytest.mark.parametrize("time", [0.0, 3.333, 9.0])
def test_the_point_lies_on_the_arc(speed, time):
    reference = circle(0.8, speed, 20.0, start=(1.0, 2.0, 3.0))
    way = np.sign(speed) * 0.3
    wanted = advance(reference.pose(time), [way, way / 0.8], 1.0)
    np.testing.assert_allclose(PathAhead(reference).point(time, 0.3), wanted, atol=1e-9)


def test_speed_does_not_matter():
    """Points of a path that speeds up lie as far ahead as those of a steady one."""
    ramp = SegmentedReference((0.0, 0.0, 0.5), [Segment(5.0, 0.0, 0.2, 1.0), Segment(5.0, 0.2, 0.1, 1.0)])
    for time in (0.5, 3.0, 4.999, 6.0):
        wanted = advance(ramp.pose(time), [0.2, 0.2], 1.0)
        np.testing.assert_allclose(PathAhead(ramp).point(time, 0.2), wanted, atol=1e-5)


def test_beyond_a_cusp_the_path_goes_on_straight():
    ramps = [Segment(2.0, 0.2, 0.0, 0.5), Segment(2.0, 0.0, -0.2, -0.5)]
    reference = SegmentedReference((0.0, 0.0, 0.0), ramps)
    path, cusp = PathAhead(reference), reference.pose(2.0)
    wanted = advance(cusp, [0.3 - 0.05, 0.0], 1.0)
    np.testing.assert_allclose(path.point(1.0, 0.3), wanted, atol=1e-4)
    end = reference.pose(4.0)
    np.testing.assert_allclose(path.point(3.0, 0.3), advance(end, [-(0.3 - 0.15), 0.0], 1.0), atol=1e-4)


def test_beyond_the_end_the_path_goes_on_straight():
    reference = paper_reference()
    end = reference.pose(reference.duration)
    for time in (reference.duration, reference.duration + 5.0):
        np.testing.assert_allclose(PathAhead(reference).point(time, 0.3), advance(end, [0.3, 0.0], 1.0), atol=1e-4)


def test_a_reference_that_stands_is_its_own_point():
    reference = SegmentedReference((1.0, 2.0, 3.0), [Segment(2.0, 0.0, 0.0)])
    np.testing.assert_array_equal(PathAhead(reference).point(1.0, 0.3), [1.0, 2.0, 3.0])
