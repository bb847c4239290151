"""Paths of piecewise linear curvature: straights, arcs and clothoids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import require, require_finite, require_positive
from trackslip.kinematics import Array
from trackslip.trajectory.base import cell
from trackslip.trajectory.path import STEP, Complex, PlanarPath, require_length
from trackslip.trajectory.profile import LIMITS, MotionLimits, ProfiledReference

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_NODES, _WEIGHTS = (_NODES + 1) / 2, _WEIGHTS / 2  # on [0, 1]


@dataclass(frozen=True)
class PathPiece:
    """A straight, an arc or a clothoid."""

    length: float  # arc length [m]
    start_curvature: float = 0.0  # curvature at its start, positive to the left [1/m]
    end_curvature: float = 0.0  # curvature at its end [1/m]

    def __post_init__(self) -> None:
        require_positive("length", self.length)
        require_finite("start_curvature", self.start_curvature)
        require_finite("end_curvature", self.end_curvature)


class ClothoidPath(PlanarPath):
    """Pieces in sequence. The heading is quadratic in the arc length, the position its Gauss-Legendre integral."""

    def __init__(self, start: ArrayLike, pieces: Sequence[PathPiece]) -> None:
        """`start` is the first pose (3,); raises InvalidValueError without pieces or above MAX_LENGTH."""
        require(pieces, "pieces", pieces, "at least one piece")
        require_length(sum(piece.length for piece in pieces))
        counts = [max(int(np.ceil(piece.length / STEP)), 2) for piece in pieces]
        steps = np.repeat([piece.length / n for piece, n in zip(pieces, counts, strict=True)], counts)
        self._s = np.concatenate([[0.0], np.cumsum(steps)])  # (K,)
        self._sharpness = np.repeat([(p.end_curvature - p.start_curvature) / p.length for p in pieces], counts)
        fractions = np.concatenate([np.arange(n) * (p.length / n) for p, n in zip(pieces, counts, strict=True)])
        self._curvature = np.repeat([p.start_curvature for p in pieces], counts) + self._sharpness * fractions
        x, y, phi = np.asarray(start, float)
        turns = steps * (self._curvature + self._sharpness * steps / 2)
        self._heading = phi + np.concatenate([[0.0], np.cumsum(turns)[:-1]])  # (K - 1,), as the two before
        chords = self._chord(np.arange(len(steps)), steps)
        self._point = complex(x, y) + np.concatenate([[0.0], np.cumsum(chords)[:-1]])

    def pose(self, s: Array) -> Array:
        """Poses (..., 3) at arc lengths (...) [m]; phi unwrapped."""
        k = cell(self._s, s)
        way = s - self._s[k]
        point = self._point[k] + self._chord(k, way)
        heading = self._heading[k] + way * (self._curvature[k] + self._sharpness[k] * way / 2)
        return np.stack([point.real, point.imag, heading], axis=-1)

    def curvature(self, s: Array) -> Array:
        """Curvatures (...) at arc lengths (...) [1/m], positive to the left."""
        k = cell(self._s, s)
        return self._curvature[k] + self._sharpness[k] * (s - self._s[k])

    def _chord(self, k: np.ndarray, way: Array) -> Complex:
        """Vectors from knots k (...) to points `way` (...) further along the path."""
        at = way[..., None] * _NODES
        heading = self._heading[k, None] + at * (self._curvature[k, None] + self._sharpness[k, None] * at / 2)
        return way * (np.exp(1j * heading) @ _WEIGHTS)


def clothoid(
    start: ArrayLike,
    straight: float = 0.6,
    transition: float = 1.0,
    radius: float = 0.5,
    arc: float = 0.5,
    limits: MotionLimits = LIMITS,
) -> ProfiledReference:
    """A left and a right bend of continuous curvature: clothoids join the straights and arcs.

    Args:
        start: first pose (3,).
        straight: length of the first and the last piece [m].
        transition: length of the clothoid between a straight and an arc [m]; that between the arcs is twice as long.
        radius: of the arcs [m].
        arc: length of each arc [m].
    """
    require_positive("radius", radius)
    bend = 1 / radius
    pieces = [
        PathPiece(straight),
        PathPiece(transition, 0.0, bend),
        PathPiece(arc, bend, bend),
        PathPiece(2 * transition, bend, -bend),
        PathPiece(arc, -bend, -bend),
        PathPiece(transition, -bend, 0.0),
        PathPiece(straight),
    ]
    return ProfiledReference(ClothoidPath(start, pieces), limits)


def rounded_square(
    start: ArrayLike, side: float = 2.0, radius: float = 0.4, limits: MotionLimits = LIMITS
) -> ProfiledReference:
    """Once around a square with rounded corners, to the left, from the middle of a side.

    Args:
        start: pose (3,), along the side.
        side: length of a side [m].
        radius: of the corners [m], less than half a side.
    """
    require_positive("side", side)
    require(0 < radius < side / 2, "radius", radius, f"greater than 0, less than half of side = {side:g} m")
    straight, corner = PathPiece(side - 2 * radius), PathPiece(np.pi / 2 * radius, 1 / radius, 1 / radius)
    half = PathPiece(straight.length / 2)
    return ProfiledReference(ClothoidPath(start, [half, *[corner, straight] * 3, corner, half]), limits)
