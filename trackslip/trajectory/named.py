"""References by name: the paper's path, smooth curves, straights, arcs and clothoids, and waypoint
files.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import require
from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference, cell
from trackslip.trajectory.path import STEP, Complex, ParametricPath, PlanarPath, ProfiledReference
from trackslip.trajectory.segmented import PAPER_START, circle, paper_reference, stop_and_go
from trackslip.trajectory.waypoints import read_waypoints

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_NODES, _WEIGHTS = (_NODES + 1) / 2, _WEIGHTS / 2  # nodes and weights on [0, 1]


@dataclass(frozen=True)
class PathPiece:
    """A straight line, an arc or a clothoid."""

    length: float  # arc length [m]
    start_curvature: float = 0.0  # curvature at the start, positive to the left [1/m]
    end_curvature: float = 0.0  # curvature at the end [1/m]


class ClothoidPath(PlanarPath):
    """A sequence of pieces. Headings are quadratic in the arc length, and positions are
    Gauss-Legendre integrals.
    """

    def __init__(self, start: ArrayLike, pieces: Sequence[PathPiece]) -> None:
        """Join the pieces, the first from the pose `start` (3,)."""
        counts = [max(int(np.ceil(piece.length / STEP)), 2) for piece in pieces]
        steps = np.repeat(
            [piece.length / n for piece, n in zip(pieces, counts, strict=True)], counts
        )
        self._s = np.concatenate([[0.0], np.cumsum(steps)])  # (K,)
        self._sharpness = np.repeat(
            [(p.end_curvature - p.start_curvature) / p.length for p in pieces], counts
        )
        fractions = np.concatenate(
            [np.arange(n) * (p.length / n) for p, n in zip(pieces, counts, strict=True)]
        )
        self._curvature = (
            np.repeat([p.start_curvature for p in pieces], counts) + self._sharpness * fractions
        )
        x, y, phi = np.asarray(start, float)
        turns = steps * (self._curvature + self._sharpness * steps / 2)
        # (K - 1,), like _curvature
        self._heading = phi + np.concatenate([[0.0], np.cumsum(turns)[:-1]])
        chords = self._chord(np.arange(len(steps)), steps)
        self._point = complex(x, y) + np.concatenate([[0.0], np.cumsum(chords)[:-1]])

    def pose(self, s: Array) -> Array:
        """Poses (..., 3) at arc lengths (...) [m], with phi unwrapped."""
        k = cell(self._s, s)
        way = s - self._s[k]
        point = self._point[k] + self._chord(k, way)
        heading = self._heading[k] + way * (self._curvature[k] + self._sharpness[k] * way / 2)
        return np.stack([point.real, point.imag, heading], axis=-1)

    def curvature(self, s: Array) -> Array:
        """Curvatures (...) [1/m] at arc lengths (...) [m], positive to the left."""
        k = cell(self._s, s)
        return self._curvature[k] + self._sharpness[k] * (s - self._s[k])

    def _chord(self, k: np.ndarray, way: Array) -> Complex:
        """Vectors (...) from knots k (...) to points `way` (...) [m] further along, by
        Gauss-Legendre quadrature.
        """
        at = way[..., None] * _NODES
        heading = self._heading[k, None] + at * (
            self._curvature[k, None] + self._sharpness[k, None] * at / 2
        )
        return way * (np.exp(1j * heading) @ _WEIGHTS)


def clothoid(start: ArrayLike) -> ProfiledReference:
    """A left and a right bend of continuous curvature, from the pose `start` (3,): clothoids join
    straights and arcs.

    The straights are 0.6 m long, the arcs 0.5 m with a radius of 0.5 m, the outer clothoids 1 m and
    the middle one 2 m.
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
    """An anticlockwise 2 m square with corners of 0.4 m radius, from the pose `start` (3,) in the
    middle of a side.
    """
    half, straight, corner = PathPiece(0.6), PathPiece(1.2), PathPiece(np.pi / 2 * 0.4, 2.5, 2.5)
    return ProfiledReference(ClothoidPath(start, [half, *[corner, straight] * 3, corner, half]))


def figure_eight(start: ArrayLike) -> ProfiledReference:
    """Bernoulli's lemniscate, 3 m long, from its crossing: first the left loop, then the right
    loop.

    `start` (3,) is the pose at the crossing. The long axis is 45 deg to the left of its heading.
    The smallest radius is 0.5 m.
    """

    def lemniscate(u: Array, nu: int) -> Complex:
        sine, cosine = np.sin(u), np.cos(u)
        away = 1 - 1j * sine
        factor = (
            cosine / away,
            1j * (1 + 1j * sine) / away**2,
            -cosine * (3 + 1j * sine) / away**3,
        )[nu]
        return 1.5 * factor

    return ProfiledReference(
        ParametricPath(lemniscate, [-np.pi / 2, np.pi / 2, 3 * np.pi / 2], start)
    )


def slalom(start: ArrayLike) -> ProfiledReference:
    """Two periods of a sine wave along a line, each 2 m long and 0.5 m wide, from a minimum and
    first to the left.

    `start` (3,) is the first pose, with the heading of the line. The smallest radius is 0.4 m.
    """

    def wave_line(x: Array, nu: int) -> Complex:
        sine, cosine = np.sin(np.pi * x), np.cos(np.pi * x)
        rise = (1 - cosine, np.pi * sine, np.pi**2 * cosine)[nu]
        return (x, 1.0, 0.0)[nu] + 0.25j * rise

    return ProfiledReference(ParametricPath(wave_line, [0.0, 2.0, 4.0], start))


def spiral(start: ArrayLike) -> ProfiledReference:
    """One and a half turns of Archimedes' spiral to the left, inwards from a radius of 1.2 m to
    0.45 m.

    `start` (3,) is the pose at the outer end.
    """
    end = 3 * np.pi
    shrinkage = (1.2 - 0.45) / end

    def archimedes(u: Array, nu: int) -> Complex:
        radius = 1.2 - shrinkage * u
        return (radius, 1j * radius - shrinkage, -radius - 2j * shrinkage)[nu] * np.exp(1j * u)

    return ProfiledReference(ParametricPath(archimedes, np.linspace(0, end, 8), start))


# The scanner is at (-1.5, -1.5) and sees everything with y > -1.5. With these starts the plate
# stays more than 1 m from the scanner and within its field of view even if the robot is 0.4 m off.
REFERENCES: dict[str, Callable[..., Reference]] = {
    "paper": partial(paper_reference, start=PAPER_START),
    "circle": partial(circle, 1.0, 0.15, 2 * np.pi / 0.15, start=(-1.5, 0.4, 0.0)),
    "figure_eight": partial(figure_eight, start=(-1.5, 1.6, -np.pi / 4)),
    "slalom": partial(slalom, start=(-3.5, 1.2, 0.0)),
    "rounded_square": partial(rounded_square, start=(-1.5, 0.5, 0.0)),
    "clothoid": partial(clothoid, start=(-2.5, 0.6, 0.0)),
    "spiral": partial(spiral, start=(-1.5, 0.5, 0.0)),
    "stop_and_go": partial(stop_and_go, start=(-2.5, 1.0, np.pi / 4)),
}
"""Functions that build references, by name. Each accepts another `start` (3,) as a keyword."""


def named_reference(name: str, start: ArrayLike | None = None) -> Reference:
    """Build the reference called `name` in REFERENCES, from the pose `start` (3,) or else its
    default start.

    Raises InvalidValueError for an unknown name.
    """
    require(name in REFERENCES, "reference", name, f"one of {', '.join(REFERENCES)}")
    return REFERENCES[name]() if start is None else REFERENCES[name](start=start)


def load_reference(name_or_path: str | Path) -> Reference:
    """Build a reference from its name in REFERENCES or from the waypoints in a `.csv` file.

    Raises:
        InvalidValueError: if `name_or_path` is neither a known name nor a `.csv` path.
        ReferenceFileError: if the file cannot be read or its path cannot be driven.
    """
    name = str(name_or_path)
    if Path(name).suffix.lower() == ".csv":
        return read_waypoints(Path(name))
    require(
        name in REFERENCES,
        "reference",
        name,
        f"one of {', '.join(REFERENCES)}, or a .csv file of waypoints",
    )
    return REFERENCES[name]()
