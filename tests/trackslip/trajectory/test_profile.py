"""The quickest speeds within limits, against closed forms."""

import numpy as np
import pytest

from trackslip.trajectory.clothoid import ClothoidPath, Piece, rounded_square
from trackslip.trajectory.profile import Limits, ProfiledReference

ORIGIN = (0.0, 0.0, 0.0)


def test_a_straight_takes_as_long_as_a_trapezium_of_speed():
    limits = Limits(speed=0.2, acceleration=0.05)
    reference = ProfiledReference(ClothoidPath(ORIGIN, [Piece(3.0)]), limits)
    assert reference.duration == pytest.approx(3.0 / 0.2 + 0.2 / 0.05, rel=1e-3)
    np.testing.assert_allclose(reference.twist(2.0), [0.1, 0.0], atol=1e-12)


@pytest.mark.parametrize("length", [0.01, 0.3])
def test_a_short_straight_as_long_as_a_triangle(length):
    reference = ProfiledReference(ClothoidPath(ORIGIN, [Piece(length)]), Limits(acceleration=0.05))
    assert reference.duration == pytest.approx(2 * np.sqrt(length / 0.05), rel=1e-9)


def test_speed_limits_by_cause():
    limits = Limits(speed=0.15, yaw_rate=0.3, track_speed=0.2, half_gauge=0.2)
    np.testing.assert_allclose(limits.speed_at([0.0, 1.0, -4.0]), [0.15, 0.15, 0.075])
    np.testing.assert_allclose(Limits(track_speed=0.2, half_gauge=0.2).speed_at([2.0]), [0.2 / 1.4])
    assert limits.speed_at(np.zeros((2, 3))).shape == (2, 3)


def test_it_brakes_before_a_corner_and_speeds_up_after_it():
    limits = Limits(speed=0.15, acceleration=0.05, yaw_rate=0.25)
    reference = rounded_square(ORIGIN, side=2.0, radius=0.4, limits=limits)
    v, w = reference.twist(reference.knots).T
    in_corner = np.abs(w) > 0
    np.testing.assert_allclose(v[in_corner], 0.1, atol=1e-9)
    assert v[~in_corner].max() == pytest.approx(0.15)
    # nowhere could it be quicker: it always accelerates, brakes, or is at a limit
    acceleration = np.abs(np.diff(v) / np.diff(reference.knots))
    at_limit = np.isclose(v, limits.speed_at(np.where(in_corner, 2.5, 0.0)))
    busy = np.isclose(acceleration, limits.acceleration, rtol=1e-6)
    idle = ~busy & ~(at_limit[1:] & at_limit[:-1])
    assert idle.sum() <= 3 * 5 + 4  # cells in which it changes from one to the other
