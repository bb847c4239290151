"""Paths parametrised by arc length, and the highest speeds along them within limits.

Points are complex numbers x + iy [m], so that rotations are products.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import (
    InvalidValueError,
    require,
    require_at_most,
    require_non_negative,
    require_positive,
)
from trackslip.kinematics import Array
from trackslip.trajectory.base import PiecewiseReference, cell

Complex = NDArray[np.complexfloating[Any, Any]]

MAX_LENGTH: Final = 1000.0
"""Maximum length of a path [m]."""
KNOT_SPACING: Final = 0.005
"""Maximum spacing of path knots [m]."""
MIN_SPEED: Final = 1e-3
"""Minimum speed that the tightest bend in a path must allow [m/s]."""
# minimum spacing of path knots; a curve that needs a smaller one has a cusp [m]
_MIN_KNOT_SPACING: Final = 1e-6
_MAX_TURN: Final = 0.1  # maximum turn between neighbouring knots [rad]
_MAX_LENGTH_ERROR: Final = 1e-12  # maximum error of the arc length between knots [m]
_MIN_ACCELERATION: Final = 1e-4  # smallest valid limit on the acceleration [m/s^2]
# places in a cell at which the speed is limited; at the ends the curvature may jump
_SPEED_PLACES: Final = np.array([1e-6, 0.25, 0.5, 0.75, 1 - 1e-6])
_GAUSS_LEGENDRE: Final = np.polynomial.legendre.leggauss(8)
_NODES: Final = _GAUSS_LEGENDRE[0]  # on [-1, 1]
_WEIGHTS: Final = _GAUSS_LEGENDRE[1]


class PlanarPath(ABC):
    """Base class of paths parametrised by arc length s, from 0 to the length of the path."""

    _s: Array

    @property
    def knots(self) -> Array:
        """Arc lengths (K,) from 0 to the path's length, with smooth curvature between them.

        They are at most KNOT_SPACING apart. There are at least three knots, so that a path can be
        driven from rest to rest.
        """
        return self._s

    @abstractmethod
    def pose(self, s: Array) -> Array:
        """Poses (..., 3) at arc lengths (...) [m], with phi unwrapped."""

    @abstractmethod
    def curvature(self, s: Array) -> Array:
        """Curvatures (...) [1/m] at arc lengths (...) [m], positive to the left."""


Curve = Callable[[Array, int], Complex]
"""Function of parameters (...) and an order, 0 for points and 1 and 2 for derivatives."""


class ParametricPath(PlanarPath):
    """A smooth curve parametrised by arc length.

    The arc length between knots is a Gauss-Legendre integral of the parametric speed. The parameter
    is a cubic Hermite polynomial of the arc length, with knots so close that the error is below
    1e-12 m.
    """

    def __init__(self, curve: Curve, breaks: ArrayLike, start: ArrayLike | None = None) -> None:
        """Follow a twice differentiable curve from the first to the last of `breaks` (B,).

        They are ascending values of its parameter. At the breaks any derivative may jump. With
        `start` (3,), the curve is moved to begin at that pose. Raises InvalidValueError if the
        curve has a cusp or is longer than MAX_LENGTH.
        """
        self._curve = curve
        self._u, lengths = _cells(curve, np.asarray(breaks, float))
        self._s = np.concatenate([[0.0], np.cumsum(lengths)])
        self._velocity = curve(self._u, 1)  # (K,) derivatives of the points by the parameter
        self._parameter = scipy.interpolate.CubicHermiteSpline(
            self._s, self._u, 1 / np.abs(self._velocity)
        )
        turns = np.angle(self._velocity[1:] / self._velocity[:-1])
        heading = np.angle(self._velocity[0]) + np.concatenate([[0.0], np.cumsum(turns)])
        self._rotation = complex(1.0)
        self._shift = complex(0.0)
        if start is not None:
            x, y, phi = np.asarray(start, float)
            self._rotation = np.exp(1j * (phi - heading[0]))
            self._shift = complex(complex(x, y) - self._rotation * curve(self._u[0], 0))
            heading += phi - heading[0]
        self._heading = heading

    def pose(self, s: Array) -> Array:
        """Poses (..., 3) at arc lengths (...) [m], with phi unwrapped."""
        k = cell(self._s, s)
        u = self._parameter(s)
        point = self._rotation * self._curve(u, 0) + self._shift
        turn = np.angle(self._curve(u, 1) * np.conj(self._velocity[k]))
        heading = self._heading[k] + turn
        return np.stack([point.real, point.imag, heading], axis=-1)

    def parameter(self, s: Array) -> Array:
        """Curve parameters (...) at arc lengths (...) [m]."""
        return self._parameter(s)

    def curvature(self, s: Array) -> Array:
        """Curvatures (...) [1/m] at arc lengths (...) [m], positive to the left."""
        u = self._parameter(s)
        velocity = self._curve(u, 1)
        acceleration = self._curve(u, 2)
        return (np.conj(velocity) * acceleration).imag / np.abs(velocity) ** 3


def _arc_length(curve: Curve, start: Array, end: Array) -> Array:
    """Lengths (...) [m] of the curve between parameters `start` (...) and `end` (...)."""
    half = (end - start) / 2
    middle = (start + end) / 2
    u = middle[..., None] + half[..., None] * _NODES
    return half * (np.abs(curve(u, 1)) @ _WEIGHTS)


def _cells(curve: Curve, breaks: Array) -> tuple[Array, Array]:
    """Parameters (K,) of the knots and lengths (K - 1,) between them.

    Cells are halved until the parameter, as a cubic Hermite polynomial of the arc length, is
    accurate halfway along each cell. With the parameters u_0 and u_1 and their slopes m_0 and m_1
    at the ends of a cell of length l, the polynomial there is (u_0 + u_1) / 2 + l (m_0 - m_1) / 8.
    """
    u = breaks
    length = float(_arc_length(curve, u[:-1], u[1:]).sum())
    require_at_most("length of the path", round(length, 3), MAX_LENGTH, "m")
    while True:
        start = u[:-1]
        end = u[1:]
        lengths = _arc_length(curve, start, end)
        velocity = curve(u, 1)
        # the speed is zero at a cusp; NaN counts as coarse
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = 1 / np.abs(velocity)
            halfway = (start + end) / 2 + lengths * (slope[:-1] - slope[1:]) / 8
            error = np.abs(_arc_length(curve, start, halfway) - lengths / 2)
            turn = np.abs(np.angle(velocity[1:] / velocity[:-1]))
        is_accurate = (error < _MAX_LENGTH_ERROR) & (turn < _MAX_TURN)
        is_coarse = (lengths > KNOT_SPACING) | ~is_accurate | (len(lengths) < 2)
        if not is_coarse.any():
            return u, lengths

        shortest = np.argmin(np.where(is_coarse, lengths, np.inf))
        if lengths[shortest] < _MIN_KNOT_SPACING:
            point = curve(u[shortest], 0)
            found = f"turns back sharply at ({point.real:.3f}, {point.imag:.3f})"
            allowed = "smooth; waypoints reverse or turn on the spot where a column yaw says so"
            raise InvalidValueError("path", found, allowed)

        middle = (start + end)[is_coarse] / 2
        u = np.sort(np.concatenate([u, middle]))


@dataclass(frozen=True)
class MotionLimits:
    """Limits on the motion along a reference."""

    speed: float = 0.15
    """Maximum speed [m/s]."""
    acceleration: float = 0.05
    """Maximum acceleration along the path [m/s^2]."""
    yaw_rate: float = 0.3
    """Maximum yaw rate [rad/s]."""
    track_speed: float = 0.27
    """Maximum surface speed of the faster track [m/s]."""
    half_gauge: float = 0.215
    """Distance of a track's ICR from the robot's centre line: half the gauge plus D [m]."""

    def __post_init__(self) -> None:
        require_non_negative("half_gauge", self.half_gauge)
        for name, least, unit in (
            ("speed", MIN_SPEED, "m/s"),
            ("acceleration", _MIN_ACCELERATION, "m/s^2"),
            ("yaw_rate", 0.0, "rad/s"),
            ("track_speed", MIN_SPEED, "m/s"),
        ):
            value = getattr(self, name)
            require_positive(name, value)
            require(value >= least, name, value, f"at least {least:g} {unit}")

    def scaled(self, speed: float, top_speed: float) -> MotionLimits:
        """The limits in proportion to another `speed` [m/s], which bends and starts reduce by the
        same factors, with a track speed up to `top_speed` [m/s].
        """
        factor = speed / self.speed
        return replace(
            self,
            speed=speed,
            acceleration=factor * self.acceleration,
            yaw_rate=factor * self.yaw_rate,
            track_speed=min(factor * self.track_speed, top_speed),
        )

    def speed_at(self, curvature: ArrayLike) -> Array:
        """Maximum speeds (...) [m/s] at curvatures (...) [1/m]."""
        bend = np.abs(np.asarray(curvature, float))
        by_track = self.track_speed / (1 + self.half_gauge * bend)
        by_yaw_rate = self.yaw_rate / np.maximum(bend, self.yaw_rate / self.speed)
        return np.minimum(np.minimum(self.speed, by_track), by_yaw_rate)


LIMITS: Final = MotionLimits()
"""Limits within which the default robot's motors can follow a reference, slip included."""


class ProfiledReference(PiecewiseReference):
    """A path driven as fast as allowed from rest to rest, at constant acceleration in a cell."""

    def __init__(
        self,
        path: PlanarPath,
        limits: MotionLimits = LIMITS,
        speed_at: Callable[[Array], Array] | None = None,
        direction: int = 1,
    ) -> None:
        """Plan the speeds along `path`.

        `speed_at` returns limits (...) [m/s] at arc lengths (...) [m]; at least MIN_SPEED is used.
        `direction` is 1 for forwards and -1 for reverse. Raises InvalidValueError if a bend is too
        tight for MIN_SPEED.
        """
        self._path = path
        self._direction = direction
        turn = 0.0
        if direction < 0:  # half a turn, to a heading within half a turn
            turn = -np.copysign(np.pi, path.pose(path.knots[0])[2])
        self._turn = np.array([0.0, 0.0, turn])  # from the path's poses to the robot's
        speeds = _speeds(path, limits, speed_at)  # (K,)
        start_speeds = speeds[:-1]
        end_speeds = speeds[1:]
        durations = 2 * np.diff(path.knots) / (start_speeds + end_speeds)
        super().__init__(durations, direction * start_speeds, direction * end_speeds)

    def pose_in(self, k: NDArray[np.intp], distance: Array) -> Array:
        """See PiecewiseReference."""
        s = self._path.knots[k] + self._direction * distance
        return self._path.pose(s) + self._turn

    def twist_in(self, k: NDArray[np.intp], distance: Array, speed: Array) -> Array:
        """See PiecewiseReference."""
        s = self._path.knots[k] + self._direction * distance
        curvature = self._direction * self._path.curvature(s)
        return np.stack([speed, speed * curvature], axis=-1)


def _speeds(
    path: PlanarPath, limits: MotionLimits, speed_at: Callable[[Array], Array] | None
) -> Array:
    """Maximum speeds (K,) [m/s] at the knots, zero at both ends; between knots, v^2 is linear."""
    s = path.knots
    places = s[:-1, None] + np.diff(s)[:, None] * _SPEED_PLACES
    curvature = path.curvature(places)
    allowed = limits.speed_at(curvature).min(axis=1)  # (K - 1,)
    if allowed.min() < MIN_SPEED:
        row, column = np.unravel_index(np.argmax(np.abs(curvature)), curvature.shape)
        x, y, _ = path.pose(places[row, column])
        radius = 1 / abs(curvature[row, column])
        raise InvalidValueError(
            f"radius of curvature at ({x:.3f}, {y:.3f})",
            float(f"{radius:.3g}"),
            f"large enough to drive at {MIN_SPEED:g} m/s within the limits of yaw rate and track "
            "speed",
        )
    if speed_at is not None:
        stated = np.maximum(speed_at(places).min(axis=1), MIN_SPEED)
        allowed = np.minimum(allowed, stated)

    # a knot belongs to the cells on both sides of it, the first and last also to the rest
    allowed_before = np.insert(allowed, 0, 0.0)
    allowed_after = np.append(allowed, 0.0)
    square = np.minimum(allowed_after, allowed_before) ** 2

    # v^2 may increase by 2 a per metre, forwards from the start and backwards from the end
    growth = 2 * limits.acceleration * s
    square = np.minimum.accumulate(square - growth) + growth
    from_end = (square + growth)[::-1]
    square = np.minimum.accumulate(from_end)[::-1] - growth
    return np.sqrt(np.maximum(square, 0.0))
