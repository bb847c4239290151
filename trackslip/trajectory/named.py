"""References by name: the paper's path, curves, straights, arcs, clothoids and waypoint files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip.arguments import checks_arguments
from trackslip.errors import require_one_of
from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference, cell
from trackslip.trajectory.path import (
    KNOT_SPACING,
    LIMITS,
    Complex,
    MotionLimits,
    ParametricPath,
    PlanarPath,
    ProfiledReference,
)
from trackslip.trajectory.segmented import (
    PAPER_START,
    SegmentedReference,
    circle,
    paper_reference,
    stop_and_go,
)
from trackslip.trajectory.waypoints import TOLERANCE, read_waypoints

_GAUSS_LEGENDRE: Final = np.polynomial.legendre.leggauss(5)
_NODES: Final = (_GAUSS_LEGENDRE[0] + 1) / 2  # on [0, 1]
_WEIGHTS: Final = _GAUSS_LEGENDRE[1] / 2  # on [0, 1]

CIRCLE_RADIUS: Final = 1.0
"""Radius of the reference `circle` [m]."""
CIRCLE_SPEED: Final = 0.15
"""Speed on the reference `circle` [m/s]."""
_CIRCLE_START: Final = (-1.5, 0.4, 0.0)


@dataclass(frozen=True)
class PathPiece:
    """A straight line, an arc or a clothoid."""

    length: float  # arc length [m]
    start_curvature: float = 0.0  # curvature at the start, positive to the left [1/m]
    end_curvature: float = 0.0  # curvature at the end [1/m]

    @property
    def sharpness(self) -> float:
        """Change of the curvature per length [1/m^2]."""
        return (self.end_curvature - self.start_curvature) / self.length


class ClothoidPath(PlanarPath):
    """A sequence of straights, arcs and clothoids, in cells of at most KNOT_SPACING.

    In a cell, with the curvature kappa at its start and the sharpness sigma, the robot turns by s
    (kappa + sigma s / 2) over the length s. Positions are Gauss-Legendre integrals.
    """

    def __init__(self, start: ArrayLike, pieces: Sequence[PathPiece]) -> None:
        """Join the pieces, the first from the pose `start` (3,)."""
        x, y, phi = np.asarray(start, float)

        # the cells of each piece: lengths, sharpness, and curvatures at the starts
        cell_lengths = []
        sharpness = []
        curvature = []
        for piece in pieces:
            count = max(math.ceil(piece.length / KNOT_SPACING), 2)
            step = piece.length / count
            starts = np.arange(count) * step
            cell_lengths.append(np.full(count, step))
            sharpness.append(np.full(count, piece.sharpness))
            curvature.append(piece.start_curvature + piece.sharpness * starts)
        lengths = np.concatenate(cell_lengths)
        self._s = np.concatenate([[0.0], np.cumsum(lengths)])  # (K,)
        self._sharpness = np.concatenate(sharpness)  # (K - 1,)
        self._curvature = np.concatenate(curvature)  # (K - 1,)

        # headings and positions at the starts of the cells
        turns = self._turn(np.arange(len(lengths)), lengths)
        self._heading = phi + np.concatenate([[0.0], np.cumsum(turns)[:-1]])  # (K - 1,)
        chords = self._chord(np.arange(len(lengths)), lengths)
        self._point = complex(x, y) + np.concatenate([[0.0], np.cumsum(chords)[:-1]])  # (K - 1,)

    def pose(self, s: Array) -> Array:
        """Poses (..., 3) at arc lengths (...) [m], with phi unwrapped."""
        k = cell(self._s, s)
        distance = s - self._s[k]
        point = self._point[k] + self._chord(k, distance)
        heading = self._heading[k] + self._turn(k, distance)
        return np.stack([point.real, point.imag, heading], axis=-1)

    def curvature(self, s: Array) -> Array:
        """Curvatures (...) [1/m] at arc lengths (...) [m], positive to the left."""
        k = cell(self._s, s)
        return self._curvature[k] + self._sharpness[k] * (s - self._s[k])

    def _turn(self, k: np.ndarray, distance: Array) -> Array:
        """Turns (...) [rad] from knots k (...) to points at `distance` (...) [m] from them."""
        return np.asarray(distance * (self._curvature[k] + self._sharpness[k] * distance / 2))

    def _chord(self, k: np.ndarray, distance: Array) -> Complex:
        """Vectors (...) from knots k (...) to points at `distance` (...) [m] from them."""
        k = k[..., None]
        heading = self._heading[k] + self._turn(k, distance[..., None] * _NODES)
        return distance * (np.exp(1j * heading) @ _WEIGHTS)


def one_circle(
    radius: float = CIRCLE_RADIUS,
    speed: float = CIRCLE_SPEED,
    duration: float | None = None,
    start: ArrayLike = _CIRCLE_START,
) -> SegmentedReference:
    """The reference `circle`: to the left, by default once round.

    `radius` is in m, `speed` in m/s, `duration` in s, and `start` (3,) is the first pose.
    """
    if duration is None:
        duration = 2 * np.pi * radius / speed
    return circle(radius, speed, duration, start)


def clothoid(start: ArrayLike) -> ProfiledReference:
    """A left and a right bend of continuous curvature, from the pose `start` (3,).

    Clothoids join straights and arcs. The straights are 0.6 m long, the arcs 0.5 m with a radius of
    0.5 m, the outer clothoids 1 m and the middle one 2 m.
    """
    bend = 2.0  # [1/m]
    pieces = [
        PathPiece(0.6),
        PathPiece(1.0, 0.0, bend),
        PathPiece(0.5, bend, bend),
        PathPiece(2.0, bend, -bend),
        PathPiece(0.5, -bend, -bend),
        PathPiece(1.0, -bend, 0.0),
        PathPiece(0.6),
    ]
    return ProfiledReference(ClothoidPath(start, pieces))


def rounded_square(start: ArrayLike) -> ProfiledReference:
    """An anticlockwise 2 m square with corners of 0.4 m radius.

    `start` (3,) is the pose in the middle of a side.
    """
    radius = 0.4
    side = PathPiece(1.2)
    half_side = PathPiece(0.6)
    corner = PathPiece(np.pi / 2 * radius, 1 / radius, 1 / radius)
    pieces = [half_side, *[corner, side] * 3, corner, half_side]
    return ProfiledReference(ClothoidPath(start, pieces))


def figure_eight(start: ArrayLike) -> ProfiledReference:
    """Bernoulli's lemniscate, 3 m long, from its crossing: first the left loop, then the right.

    `start` (3,) is the pose at the crossing. The long axis is 45 deg to the left of its heading.
    The smallest radius is 0.5 m. With a = 1 - i sin(u), the point is cos(u) / a in half lengths.
    """
    half_length = 1.5

    def lemniscate(u: Array, order: int) -> Complex:
        sine = np.sin(u)
        cosine = np.cos(u)
        a = 1 - 1j * sine
        if order == 0:
            return half_length * (cosine / a)
        if order == 1:
            return half_length * (1j * (1 + 1j * sine) / a**2)
        return half_length * (-cosine * (3 + 1j * sine) / a**3)

    breaks = [-np.pi / 2, np.pi / 2, 3 * np.pi / 2]
    return ProfiledReference(ParametricPath(lemniscate, breaks, start))


def slalom(start: ArrayLike) -> ProfiledReference:
    """Two periods of a sine wave along a line, each 2 m long and 0.5 m wide, first to the left.

    `start` (3,) is the first pose, at a minimum, with the heading of the line. The smallest radius
    is 0.4 m.
    """
    amplitude = 0.25j  # to the left of the line

    def wave_line(x: Array, order: int) -> Complex:
        if order == 0:
            return x + amplitude * (1 - np.cos(np.pi * x))
        if order == 1:
            return 1.0 + amplitude * (np.pi * np.sin(np.pi * x))
        return 0.0 + amplitude * (np.pi**2 * np.cos(np.pi * x))

    return ProfiledReference(ParametricPath(wave_line, [0.0, 2.0, 4.0], start))


def spiral(start: ArrayLike) -> ProfiledReference:
    """One and a half turns of Archimedes' spiral to the left, from a radius of 1.2 m to 0.45 m.

    `start` (3,) is the pose at the outer end. The point is r exp(i u) with r = 1.2 m - c u.
    """
    end = 3 * np.pi
    shrinkage = (1.2 - 0.45) / end

    def archimedes(u: Array, order: int) -> Complex:
        radius = 1.2 - shrinkage * u
        turned = np.exp(1j * u)
        if order == 0:
            return radius * turned
        if order == 1:
            return (1j * radius - shrinkage) * turned
        return (-radius - 2j * shrinkage) * turned

    return ProfiledReference(ParametricPath(archimedes, np.linspace(0, end, 8), start))


# The scanner is at (-1.5, -1.5) and sees everything with y > -1.5. With these starts the plate
# stays more than 1 m from the scanner and within its field of view even if the robot is 0.4 m off.
REFERENCES: Final[dict[str, Callable[..., Reference]]] = {
    "paper": partial(paper_reference, start=PAPER_START),
    "circle": one_circle,
    "figure_eight": partial(figure_eight, start=(-1.5, 1.6, -np.pi / 4)),
    "slalom": partial(slalom, start=(-3.5, 1.2, 0.0)),
    "rounded_square": partial(rounded_square, start=(-1.5, 0.5, 0.0)),
    "clothoid": partial(clothoid, start=(-2.5, 0.6, 0.0)),
    "spiral": partial(spiral, start=(-1.5, 0.5, 0.0)),
    "stop_and_go": partial(stop_and_go, start=(-2.5, 1.0, np.pi / 4)),
}
"""Functions that build references, by name. Each accepts another `start` (3,) as a keyword."""


@checks_arguments
def named_reference(name: str, start: ArrayLike | None = None) -> Reference:
    """Build the reference called `name` in REFERENCES, by default from its own start.

    `start` (3,) is another first pose. Raises InvalidValueError for an unknown name.
    """
    require_one_of("reference", name, REFERENCES)
    build = REFERENCES[name]
    return build() if start is None else build(start=start)


def load_reference(
    name_or_path: str | Path, limits: MotionLimits = LIMITS, tolerance: float = TOLERANCE
) -> Reference:
    """Build a reference from its name in REFERENCES or from the waypoints in a `.csv` file.

    For files, `limits` are those on the motion, and the path may miss waypoints by `tolerance` [m].

    Raises:
        InvalidValueError: if `name_or_path` is neither a known name nor a `.csv` path.
        ReferenceFileError: if the file cannot be read or its path cannot be driven.
    """
    name = str(name_or_path)
    if Path(name).suffix.lower() == ".csv":
        return read_waypoints(Path(name), limits, tolerance)
    require_one_of("reference", name, REFERENCES, ", or a .csv file of waypoints")
    return REFERENCES[name]()
