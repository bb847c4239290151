"""Paths by arc length. Points are complex numbers x + iy [m], so that a rotation is a product."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import InvalidValueError, require_at_most
from trackslip.kinematics import Array
from trackslip.trajectory.base import cell

Complex = NDArray[np.complexfloating[Any, Any]]

MAX_LENGTH = 1000.0  # maximum length of a path [m]
STEP = 0.005  # maximum spacing of the knots of a path [m]
_MIN_KNOT_SPACING = 1e-6  # a curve that needs closer knots has a cusp [m]
_MAX_TURN = 0.1  # between neighbouring knots [rad]
_CLOSE = 1e-12  # error of the arc length between knots [m]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class PlanarPath(ABC):
    """Base of paths parametrised by arc length s, from 0 to their length."""

    _s: Array

    @property
    def knots(self) -> Array:
        """Arc lengths (K,) from 0 to the path's length, at most STEP apart, with smooth curvature between them.

        There are at least three, so that a path can be driven from rest to rest.
        """
        return self._s

    @abstractmethod
    def pose(self, s: Array) -> Array:
        """Poses (..., 3) at arc lengths (...) [m]; phi unwrapped."""

    @abstractmethod
    def curvature(self, s: Array) -> Array:
        """Curvatures (...) at arc lengths (...) [1/m], positive to the left."""


Curve = Callable[[Array, int], Complex]
"""Points (...) at parameters (...) for 0, first and second derivatives for 1 and 2, as of SciPy's splines."""


class ParametricPath(PlanarPath):
    """A smooth curve parametrised by arc length.

    The arc length between knots is a Gauss-Legendre integral of the parametric speed, its inverse a cubic Hermite
    polynomial. The knots are close enough for an error of 1e-12 m, so pose and curvature are those of the curve itself.
    """

    def __init__(self, curve: Curve, breaks: ArrayLike, start: ArrayLike | None = None) -> None:
        """Follow a twice differentiable curve from the first to the last of ascending `breaks` (B,) of its parameter.

        Any derivative may jump at the breaks. With `start`, the curve is moved to that pose (3,). Raises
        InvalidValueError if the curve has a cusp or is longer than MAX_LENGTH.
        """
        self._curve = curve
        self._u, lengths = _cells(curve, np.asarray(breaks, float))
        self._s = np.concatenate([[0.0], np.cumsum(lengths)])
        self._velocity = curve(self._u, 1)  # (K,)
        turns = np.angle(self._velocity[1:] / self._velocity[:-1])
        heading = np.angle(self._velocity[0]) + np.concatenate([[0.0], np.cumsum(turns)])
        self._parameter = scipy.interpolate.CubicHermiteSpline(self._s, self._u, 1 / np.abs(self._velocity))
        self._rotation, self._shift = complex(1.0), complex(0.0)
        if start is not None:
            x, y, phi = np.asarray(start, float)
            self._rotation = np.exp(1j * (phi - heading[0]))
            self._shift = complex(complex(x, y) - self._rotation * curve(self._u[0], 0))
            heading += phi - heading[0]
        self._heading = heading

    def pose(self, s: Array) -> Array:
        """Poses (..., 3) at arc lengths (...) [m]; phi unwrapped."""
        k, u = cell(self._s, s), self._parameter(s)
        point = self._rotation * self._curve(u, 0) + self._shift
        heading = self._heading[k] + np.angle(self._curve(u, 1) * np.conj(self._velocity[k]))
        return np.stack([point.real, point.imag, heading], axis=-1)

    def parameter(self, s: Array) -> Array:
        """Parameters (...) of the curve at arc lengths (...) [m]."""
        return self._parameter(s)

    def curvature(self, s: Array) -> Array:
        """Curvatures (...) at arc lengths (...) [1/m], positive to the left."""
        u = self._parameter(s)
        velocity = self._curve(u, 1)
        return (np.conj(velocity) * self._curve(u, 2)).imag / np.abs(velocity) ** 3


def _arc_length(curve: Curve, start: Array, end: Array) -> Array:
    """Lengths (...) of the curve between parameters (...)."""
    half = (end - start) / 2
    u = ((start + end) / 2)[..., None] + half[..., None] * _NODES
    return half * (np.abs(curve(u, 1)) @ _WEIGHTS)


def _cells(curve: Curve, breaks: Array) -> tuple[Array, Array]:
    """Parameters (K,) of the knots and lengths (K - 1,) between them; cells are halved until they are fine enough."""
    u = breaks
    length = float(_arc_length(curve, u[:-1], u[1:]).sum())
    require_at_most("length of the path", round(length, 3), MAX_LENGTH, "m")
    while True:
        lengths = _arc_length(curve, u[:-1], u[1:])
        velocity = curve(u, 1)
        with np.errstate(divide="ignore", invalid="ignore"):  # the speed is zero at a cusp, and NaN is not close
            slope = 1 / np.abs(velocity)
            middle = (u[:-1] + u[1:]) / 2 + lengths * (slope[:-1] - slope[1:]) / 8  # of the inverse's polynomial
            miss = np.abs(_arc_length(curve, u[:-1], middle) - lengths / 2)
            turn = np.abs(np.angle(velocity[1:] / velocity[:-1]))
        coarse = (lengths > STEP) | ~(miss < _CLOSE) | ~(turn < _MAX_TURN) | (len(lengths) < 2)
        if not coarse.any():
            return u, lengths
        shortest = np.argmin(np.where(coarse, lengths, np.inf))
        if lengths[shortest] < _MIN_KNOT_SPACING:
            point = curve(u[shortest], 0)
            where = f"turns back sharply at ({point.real:.3f}, {point.imag:.3f})"
            raise InvalidValueError("path", where, "smooth; waypoints may reverse where a column yaw says so")
        u = np.sort(np.concatenate([u, (u[:-1] + u[1:])[coarse] / 2]))
