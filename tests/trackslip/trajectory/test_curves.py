"""Shapes and speeds of the references, against their closed forms."""

import re

import numpy as np
import pytest
from scipy.special import fresnel

from trackslip.errors import InvalidValueError
from trackslip.trajectory.curves import ClothoidPath, PathPiece, figure_eight, rounded_square, slalom, spiral
from trackslip.trajectory.profile import LIMITS, MotionLimits, ProfiledReference
from trackslip.trajectory.segmented import Segment, circle

ORIGIN = (0.0, 0.0, 0.0)


def driven(reference, n=2001):
    time = np.linspace(0, reference.duration, n)
    return reference.pose(time), reference.twist(time)


def test_figure_eight_is_bernoullis_lemniscate():
    a = 1.5
    pose, twist = driven(figure_eight((0, 0, -np.pi / 4)))
    x, y, phi = pose.T
    np.testing.assert_allclose((x**2 + y**2) ** 2, a**2 * (x**2 - y**2), atol=1e-11)
    np.testing.assert_allclose([x[-1], y[-1], phi[-1]], [0, 0, -np.pi / 4], atol=1e-11)
    assert np.ptp(x) == pytest.approx(2 * a, abs=1e-4)
    moving = twist[:, 0] > 1e-3
    np.testing.assert_allclose(
        np.abs(twist[moving, 1] / twist[moving, 0]), 3 * np.hypot(x, y)[moving] / a**2, atol=1e-9
    )
    assert x[np.argmax(phi)] == pytest.approx(0, abs=2e-2)  # left round one lobe, right round the other


def test_slalom_is_a_sine():
    x, y, phi = driven(slalom(ORIGIN))[0].T
    np.testing.assert_allclose(y, 0.25 * (1 - np.cos(np.pi * x)), atol=1e-11)
    np.testing.assert_allclose(np.tan(phi), 0.25 * np.pi * np.sin(np.pi * x), atol=1e-10)
    assert x[-1] == pytest.approx(4.0, abs=1e-11)


def test_spiral_is_archimedes():
    """The distance to the centre falls evenly with the angle about it."""
    outer, inner, turns = 1.2, 0.45, 1.5
    shrinkage = (outer - inner) / (2 * np.pi * turns)
    heading = np.pi / 2 + np.arctan(shrinkage / outer)
    x, y, phi = driven(spiral((outer, 0, heading)))[0].T
    angle = np.unwrap(np.arctan2(y, x))
    np.testing.assert_allclose(np.hypot(x, y), outer - shrinkage * angle, atol=1e-11)
    assert angle[-1] == pytest.approx(2 * np.pi * turns, abs=1e-10)
    assert np.all(np.diff(phi) >= 0)


@pytest.mark.parametrize("sharpness", [1.5, -0.4])
def test_clothoid_is_fresnels(sharpness):
    path = ClothoidPath(ORIGIN, [PathPiece(2.3, 0.0, 2.3 * sharpness)])
    s = np.linspace(0, 2.3, 301)
    scale = np.sqrt(np.pi / abs(sharpness))
    sine, cosine = fresnel(s / scale)
    expected = np.column_stack([scale * cosine, np.sign(sharpness) * scale * sine, sharpness * s**2 / 2])
    np.testing.assert_allclose(path.pose(s), expected, atol=1e-13)
    np.testing.assert_allclose(path.curvature(s), sharpness * s, atol=1e-13)


def test_refused_shapes_name_the_field_the_value_and_what_is_allowed():
    for make, field, value, allowed in (
        (lambda: Segment(0.0, 0.1, 0.1), "duration", "0.0", "> 0"),
        (lambda: circle(0.0, 0.1, 10.0), "abs(radius)", "0.0", "> 0"),
        (lambda: MotionLimits(track_speed=1e-4), "track_speed", "0.0001", "at least 0.001 m/s"),
        (lambda: MotionLimits(half_gauge=-0.1), "half_gauge", "-0.1", ">= 0"),
    ):
        with pytest.raises(
            InvalidValueError, match=f"^{re.escape(field)}.* = {re.escape(value)}.*{re.escape(allowed)}"
        ) as caught:
            make()
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("length", "duration"), [(3.0, 3.0 / 0.2 + 0.2 / 0.05), *((way, 2 * np.sqrt(way / 0.05)) for way in (0.01, 0.3))]
)
def test_a_straight_takes_as_long_as_a_trapezium_or_triangle_of_speed(length, duration):
    reference = ProfiledReference(ClothoidPath(ORIGIN, [PathPiece(length)]), MotionLimits(speed=0.2, acceleration=0.05))
    assert reference.duration == pytest.approx(duration, rel=1e-3)
    np.testing.assert_allclose(reference.twist(duration / 9), [0.05 * duration / 9, 0.0], rtol=1e-6)


def test_it_brakes_before_a_corner_and_speeds_up_after_it():
    limits, reference = LIMITS, rounded_square(ORIGIN)
    v, w = reference.twist(reference.knots).T
    in_corner = np.abs(w) > 0
    np.testing.assert_allclose(v[in_corner], 0.12, atol=1e-9)
    assert v[~in_corner].max() == pytest.approx(0.15)
    # nowhere could it be quicker: it always accelerates, brakes, or is at a limit
    acceleration = np.abs(np.diff(v) / np.diff(reference.knots))
    at_limit = np.isclose(v, limits.speed_at(np.where(in_corner, 2.5, 0.0)))
    busy = np.isclose(acceleration, limits.acceleration, rtol=1e-6)
    idle = ~busy & ~(at_limit[1:] & at_limit[:-1])
    assert idle.sum() <= 3 * 5 + 4  # cells in which it changes from one to the other
