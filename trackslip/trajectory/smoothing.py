"""The smoothest curve within a distance of given points.

C. H. Reinsch, "Smoothing by spline functions", Numerische Mathematik 10, 1967; with bounds on the
distances, "Smoothing by spline functions II", 16, 1971. Points are complex numbers x + iy [m].
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import scipy

from trackslip.kinematics import Array
from trackslip.trajectory.path import Complex

# parametrisations: by chords, and by the length of the curve found with them
_PARAMETRISATIONS: Final = 2
# length of the chords, which is more than the noise [tolerance]
_LEAST_CHORD: Final = 2.0
# least step of the parameter, for points that noise moves back [distance between the points]
_LEAST_STEP: Final = 0.1
_MAX_ITERATIONS: Final = 150
# fraction of the tolerance that is aimed at, so that iterations need not converge
_AIM: Final = 0.995
_STEADY: Final = 1e-3  # largest change of a distance in the last iteration [tolerance]
# length over which noise is averaged at most; longer bends never slow a robot [m]
_LONGEST_AVERAGE: Final = 0.5
_PARTS: Final = np.linspace(0.0, 1.0, 9)  # of a piece of the curve, to measure its length


class Ends(NamedTuple):
    """Directions of a curve at its ends, as complex numbers of magnitude 1; None for no bend."""

    first: complex | None = None
    last: complex | None = None


def interpolated(parameter: Array, points: Complex, ends: Ends) -> scipy.interpolate.CubicSpline:
    """The cubic spline of parameters (N,) through points (N,)."""
    conditions = [(2, 0.0) if end is None else (1, end) for end in ends]
    return scipy.interpolate.CubicSpline(parameter, points, bc_type=tuple(conditions))


def chord_lengths(points: Complex) -> Array:
    """Parameters (N,) of points (N,): the way to each along the chords [m]."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))])


def smoothed(points: Complex, tolerance: Array, ends: Ends) -> tuple[Array, Complex]:
    """Parameters (N,) and points (N,), whose spline has the least squared second derivatives.

    Each point is within its `tolerance` (N,) [m] of the given point; the first and the last are
    the given points.

    With the second derivatives g at the points, the matrices R and Q of Reinsch and the given
    points p, the smoothest spline has

        (R + Q' S Q) g = Q' p        q = p - S f        f = Q g

    where f are the jumps of its third derivative, and the diagonal matrix S holds a compliance of
    each point. It is smoothest within the tolerance t if each s f = t where the curve is t from
    its point, and f = 0 elsewhere. So the iterations set s = t / |f| (iteratively reweighted least
    squares on the dual problem, the minimum of g' R g / 2 - p' Q g + the sum of t |f|).
    """
    least = _LEAST_STEP * np.abs(np.diff(points))
    lengths = np.diff(_along_chords(points, _LEAST_CHORD * float(tolerance.max())))
    for _ in range(_PARAMETRISATIONS):
        parameter = np.concatenate([[0.0], np.cumsum(np.maximum(lengths, least))])
        reached = _within(parameter, points, tolerance, ends)
        curve = interpolated(parameter, reached, ends)
        places = parameter[:-1, None] + np.diff(parameter)[:, None] * _PARTS
        lengths = np.abs(np.diff(curve(places), axis=1)).sum(axis=1)
    return parameter, reached


def _along_chords(points: Complex, least: float) -> Array:
    """Ways (N,) to points (N,), along chords of at least `least` [m] between some of them [m]."""
    kept = [0]
    for row, point in enumerate(points[:-1]):
        if abs(point - points[kept[-1]]) >= least <= abs(points[-1] - point):
            kept.append(row)
    kept.append(len(points) - 1)
    corners = points[kept]
    rows = np.arange(len(points))
    piece = np.searchsorted(kept[1:-1], rows, side="right")
    chord = np.diff(corners)[piece]
    length = np.abs(chord)
    along = (np.conj(chord) * (points - corners[piece])).real / np.maximum(length, least)
    way = chord_lengths(corners)[piece] + np.clip(along, 0.0, length)
    return np.maximum.accumulate(way)


def _within(parameter: Array, points: Complex, tolerance: Array, ends: Ends) -> Complex:
    """Points (N,) of the smoothest spline of these parameters (N,)."""
    most = _LONGEST_AVERAGE**4 / np.mean(np.diff(parameter))
    is_inside = np.ones(len(points))
    is_inside[[0, -1]] = 0.0
    compliance = most * is_inside
    distance = np.full(len(points), np.inf)
    for _ in range(_MAX_ITERATIONS):
        before = distance
        reached, force = _relaxed(parameter, points, compliance, ends)
        distance = np.abs(reached - points)
        change = np.abs(distance - before)
        if (distance <= tolerance).all() and (change <= _STEADY * tolerance).all():
            return reached
        aim = _AIM * tolerance
        compliance = is_inside * aim / np.maximum(np.abs(force), aim / most)

    # what is still outside is pulled inside; without compliances, the curve meets the points
    while (distance > tolerance).any():
        excess = np.maximum(distance / (_AIM * tolerance), 1.0)
        compliance = compliance / excess**2
        reached, _ = _relaxed(parameter, points, compliance, ends)
        distance = np.abs(reached - points)
    return reached


def _relaxed(
    parameter: Array, points: Complex, compliance: Array, ends: Ends
) -> tuple[Complex, Complex]:
    """Points (N,) of the smoothing spline with compliances s (N,), and its forces f (N,).

    A natural spline has no second derivatives at its ends, so these unknowns are left out.
    """
    count = len(points)
    step = np.diff(parameter)

    # column k of Q: before, at and after point k
    before = np.concatenate([[0.0], 1 / step])
    after = np.concatenate([1 / step, [0.0]])
    here = -(before + after)

    # Q' p, the changes of slope
    slope = np.concatenate([[ends.first or 0.0], np.diff(points) / step, [ends.last or 0.0]])
    bend = np.diff(slope)

    # R + Q' S Q, in the upper form of LAPACK's symmetric bands
    bands = np.zeros((3, count))
    bands[2] = here**2 * compliance
    bands[2, 1:] += before[1:] ** 2 * compliance[:-1] + step / 3
    bands[2, :-1] += after[:-1] ** 2 * compliance[1:] + step / 3
    bands[1, 1:] = step / 6
    bands[1, 1:] += here[:-1] * before[1:] * compliance[:-1]
    bands[1, 1:] += after[:-1] * here[1:] * compliance[1:]
    bands[0, 2:] = after[:-2] * before[2:] * compliance[1:-1]

    first = 1 if ends.first is None else 0
    last = count - 1 if ends.last is None else count
    inner = bands[:, first:last].copy()
    inner[1, :1] = 0.0
    inner[0, :2] = 0.0
    second = np.zeros(count, complex)
    second[first:last] = scipy.linalg.solveh_banded(inner, bend[first:last])

    force = here * second
    force[:-1] += before[1:] * second[1:]
    force[1:] += after[:-1] * second[:-1]
    return points - compliance * force, force
