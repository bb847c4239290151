"""Scans of a laser range finder (LRF), real or simulated, and the cluster of points on the plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trackslip import se2
from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array
from trackslip.localization.returns import Returns, best_of_each
from trackslip.localization.rows import Rows

MAX_GAP = 0.7
"""Neighbouring returns farther apart than this belong to different objects [m]. It exceeds the length of the plate,
whose returns can be that far apart when it is seen nearly edge-on."""
FINER_GAPS = (0.25, 0.1)
"""Smaller gaps, tried where MAX_GAP does not separate the plate from a close object [m]."""
MIN_RETURNS = 3
"""Minimum number of returns for a pose."""
MIN_NOISE = 0.5e-3
"""Noise assumed for a perfect scanner, because the plate is never a perfect rectangle [m]."""
_ABOUT = 0.15  # distance of returns from the expected plate: more than the error of a tracker [m]
_ON_PLATE = 0.03  # maximum distance of a return from its plate, or five standard deviations if that is more [m]
_HOUSING = 0.05  # closer returns are from the LRF's own housing or whatever it stands in [m]
_STATIC = 5.0  # returns this close to the background belong to it [standard deviations]
_IN_FRONT = 0.05  # a return this much closer than the plate is from something else [m]
_CANDIDATES = 4  # per scan, at most
_PADDING = 16  # cluster widths are multiples of this


@dataclass(frozen=True)
class Plate:
    """The upright plate on the robot's axis of symmetry, a rectangle in the scan plane centred on the robot."""

    length: float = 0.60
    """Along the robot [m]."""
    thickness: float = 0.04
    """Across it [m]."""

    def __post_init__(self) -> None:
        require_positive("length", self.length)
        require_positive("thickness", self.thickness)
        if self.thickness >= self.length:
            raise InvalidValueError("thickness", self.thickness, f"less than length = {self.length}")

    def outside(self, pose: Array, which: np.ndarray, x: Array, y: Array) -> Array:
        """Distances (H,) of points from the plates `which` (H,) of those at poses (S, 3), negative inside [m]."""
        places = np.array([pose[:, 0], pose[:, 1], np.cos(pose[:, 2]), np.sin(pose[:, 2])])
        p_x, p_y, cos, sin = places.take(which, axis=1)
        x, y = x - p_x, y - p_y
        along = np.abs(cos * x + sin * y) - self.length / 2
        across = np.abs(cos * y - sin * x) - self.thickness / 2
        inside, x, y = np.minimum(np.maximum(along, across), 0), np.maximum(along, 0), np.maximum(across, 0)
        return np.sqrt(x * x + y * y) + inside


@dataclass(frozen=True)
class Scan:
    """One or more scans of a stationary LRF."""

    bearings: Array  # (B,) of the beams in the LRF's frame, equally spaced, ascending [rad]
    ranges: Array  # (..., B), NaN where nothing came back [m]
    noise: float
    """Standard deviation of a range [m]."""
    mount: Array  # (3,) pose of the LRF in the world
    max_range: float = np.inf
    """Nothing farther away gives a return [m]."""
    dropout: float = 0.0
    """Probability that a beam that hits an object gives no return, if known [-]."""
    background: Array | None = None
    """Ranges (B,), or several for each beam (L, B), of the field without the robot, NaN for no return [m]; None for an
    unknown field."""

    @property
    def beam_step(self) -> float:
        """Angle between neighbouring beams [rad]."""
        return float((self.bearings[-1] - self.bearings[0]) / (len(self.bearings) - 1))

    def to_world(self, pose: Array) -> Array:
        """Convert poses (..., 3) from the LRF's frame to the world frame."""
        return se2.compose(self.mount, pose)

    def from_world(self, pose: Array) -> Array:
        """Convert poses (..., 3) from the world frame to the LRF's frame."""
        return se2.between(self.mount, pose)

    def covariance_to_world(self, covariance: Array) -> Array:
        """Convert covariances (..., 3, 3) of (x, y, phi) from the LRF's frame to the world frame."""
        cos, sin = np.cos(self.mount[2]), np.sin(self.mount[2])
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
        return turn @ covariance @ turn.T


@dataclass(frozen=True)
class Cluster(Rows):
    """The returns of each scan that are attributed to the plate, in rows of equal width."""

    bearing: Array  # (S, W) of the beams from the cluster's first to its last [rad]
    range: Array  # (S, W) [m]; 1 where `hit` is false
    hit: np.ndarray  # (S, W) bool: the beam gave a return from the plate
    count: np.ndarray  # (S,) number of returns; 0 where no cluster was found
    lost: np.ndarray  # (S,) beams between the first and the last return that nothing in front explains
    hidden: Array  # (S, 2) angle hidden by closer objects beyond the first and last return; inf up to the edge [rad]

    @property
    def width(self) -> np.ndarray:
        """(S,) beams from the first to the last return."""
        return np.where(self.count > 0, self.hit.shape[1] - np.argmax(self.hit[:, ::-1], axis=1), 0)

    @property
    def padded_width(self) -> np.ndarray:
        """(S,) the width, rounded up so that few distinct values occur."""
        return -(-self.width // _PADDING) * _PADDING

    def take(self, rows: np.ndarray) -> Cluster:
        """The clusters `rows`, padded to the widest of them."""
        return Rows.take(self._narrowed(self.padded_width[rows]), rows)

    def between(self, first: int, end: int) -> Cluster:
        """The clusters from `first` up to, but not including, `end`, padded to the widest of them; no copies."""
        part = Cluster(*(value[first:end] for value in vars(self).values()))
        return part._narrowed(part.padded_width)

    def _narrowed(self, widths: np.ndarray) -> Cluster:
        width = int(widths.max(initial=_PADDING))
        return replace(self, **{name: getattr(self, name)[:, :width] for name in ("bearing", "range", "hit")})

    @classmethod
    def joined(cls, parts: Sequence[Cluster]) -> Cluster:
        """The clusters of all parts, in order."""
        width = max(part.hit.shape[1] for part in parts)

        def padded(name: str, mode: Any) -> np.ndarray:
            arrays = [(getattr(part, name), width - part.hit.shape[1]) for part in parts]
            return np.concatenate([np.pad(a, ((0, 0), (0, more)), mode=mode) if more else a for a, more in arrays])

        rest = (np.concatenate([getattr(part, name) for part in parts]) for name in ("count", "lost", "hidden"))
        return cls(padded("bearing", "edge"), padded("range", "edge"), padded("hit", "constant"), *rest)


def extract_plate(scan: Scan, plate: Plate, near: Array | None = None) -> Cluster:
    """The cluster of points on the plate (paper, Sec. III-B), for scans with ranges (S, B).

    If expected poses `near` (S, 3) in the LRF's frame are given, all pieces around them are taken: more than one if
    something in front divides the plate. Otherwise, or if there are none, it is the piece nearest to `near`, or the one
    with most returns, among those no larger than the plate; pieces are split where neighbours lie more than MAX_GAP
    apart.
    """
    returns = returns_of(scan)
    mine = np.zeros(len(returns.row), bool)
    expected = np.zeros(len(scan.ranges), bool)
    if near is not None:
        mine = _about(returns, plate, near)
        expected[returns.row[mine]] = True
    if not expected.all():
        pieces = returns.split(MAX_GAP)
        fits = pieces.extent < plate.length + plate.thickness + 6 * scan.noise
        score = pieces.count if near is None else -np.hypot(*(returns.centres(pieces) - near[pieces.row, :2]).T)
        best = (fits & best_of_each(pieces.row, np.where(fits, score, -np.inf)))[pieces.label]
        mine = np.where(expected[returns.row], mine, best)
    return gather(scan, np.arange(len(scan.ranges)), returns.row[mine], returns.beam[mine])


def candidates(scan: Scan, plate: Plate, gap: float) -> tuple[Cluster, np.ndarray]:
    """The C clusters in scans (S, B) that could be the plate, and the scan (C,) of each.

    These are the largest pieces of each scan that are no larger than the plate, split at gaps above `gap` [m].
    """
    returns = returns_of(scan)
    pieces = returns.split(gap)
    possible = (pieces.count >= MIN_RETURNS) & (pieces.extent < plate.length + plate.thickness + 6 * scan.noise)
    order = np.flatnonzero(possible)
    order = order[np.lexsort((-pieces.count[order], pieces.row[order]))]
    row = pieces.row[order]
    largest = np.arange(len(row)) - np.searchsorted(row, row) < _CANDIDATES
    place = np.full(len(pieces.row), -1)
    place[order[largest]] = np.arange(np.sum(largest))
    member = place[pieces.label]
    mine = np.flatnonzero(member >= 0)
    mine = mine[np.argsort(member[mine], kind="stable")]
    return gather(scan, row[largest], member[mine], returns.beam[mine]), row[largest]


def returns_at(scan: Scan, plate: Plate, pose: Array) -> Cluster:
    """The returns of scans (S, B) that lie, within the noise, on plates at poses (S, 3) in the LRF's frame."""
    returns = returns_of(scan)
    outside = plate.outside(pose, returns.row, returns.x, returns.y)
    mine = np.abs(outside) < max(_ON_PLATE, 5 * scan.noise)
    return gather(scan, np.arange(len(scan.ranges)), returns.row[mine], returns.beam[mine])


def gather(scan: Scan, rows: np.ndarray, cluster: np.ndarray, beam: np.ndarray) -> Cluster:
    """Clusters of the scans `rows` (C,) from returns, given by their cluster (H,), ascending, and beam (H,)."""
    clusters, beams = len(rows), scan.ranges.shape[1]
    count = np.bincount(cluster, minlength=clusters)
    end = count.cumsum()
    filled = count > 0
    whole = filled.all()
    if whole:
        low, high = beam[end - count], beam[end - 1]
    else:
        low, high = np.zeros(clusters, int), np.full(clusters, -1)
        low[filled], high[filled] = beam[(end - count)[filled]], beam[end[filled] - 1]
    width = high - low + 1
    widest = max(1, -(-int(width.max(initial=0)) // _PADDING)) * _PADDING
    column = np.minimum(low[:, None] + np.arange(widest), beams - 1)
    hit = np.zeros((clusters, widest), bool)
    hit[cluster, beam - low[cluster]] = True
    ranges = scan.ranges[rows[:, None], column]
    distance = np.where(hit, ranges, 1.0)
    lost = np.zeros(clusters, int)
    (gaps,) = (width > count).nonzero()
    if gaps.size:
        inside = np.arange(widest) < width[gaps, None] - 1
        in_front = ranges[gaps] < np.max(distance[gaps], axis=1, where=hit[gaps], initial=0.0)[:, None]
        lost[gaps] = np.sum(inside & ~hit[gaps] & ~in_front, axis=1)
    hidden = _hidden(scan, rows, low, high)
    if not whole:
        hidden[~filled] = 0.0
    return Cluster(scan.bearings[column], distance, hit, count, lost, hidden)


def returns_of(scan: Scan) -> Returns:
    """All returns that are not from the background."""
    kept = scan.ranges > _HOUSING  # false for NaN
    if scan.background is not None:
        tolerance = _STATIC * max(scan.noise, MIN_NOISE)
        for level in np.atleast_2d(scan.background):
            kept &= ~(np.abs(scan.ranges - level) < tolerance)
    place = np.flatnonzero(kept)
    row, beam = np.divmod(place, kept.shape[1])
    distance, bearing = scan.ranges.ravel()[place], scan.bearings[beam]
    return Returns(row, beam, distance * np.cos(bearing), distance * np.sin(bearing))


def _hidden(scan: Scan, rows: np.ndarray, low: np.ndarray, high: np.ndarray) -> Array:
    """Angles (C, 2) hidden by closer objects, below the beams `low` (C,) of the scans `rows` and above `high` (C,).

    It is inf if the hidden part ends at the edge of the field of view or at a return that may be from the plate again,
    and also if nothing hides the plate but two returns follow that may be from it. (A single one may be a mixture of
    plate and background.)
    """
    last = scan.ranges.shape[1] - 1
    beside = scan.ranges[rows, np.maximum(low - 1, 0)], scan.ranges[rows, np.minimum(high + 1, last)]
    if np.isnan(beside).all():  # nothing is beside any of them, as in an open field
        return np.zeros((len(rows), 2))
    way = np.repeat([-1, 1], len(rows))
    rows, edge = np.concatenate([rows, rows]), np.concatenate([low, high])
    own = scan.ranges[rows, edge]
    beam, second = edge + way, edge + 2 * way
    on = (beam >= 0) & (beam <= last)
    farther = np.where(on, scan.ranges[rows, np.minimum(np.maximum(beam, 0), last)] - own, np.inf)
    goes_on = (farther > -_IN_FRONT) & (farther < FINER_GAPS[0]) & (second >= 0) & (second <= last)
    angle = np.zeros(len(rows))
    if goes_on.any():
        some = np.flatnonzero(goes_on)
        angle[some[scan.ranges[rows[some], second[some]] < own[some] + MAX_GAP]] = np.inf
    active = np.flatnonzero((farther < -_IN_FRONT) & (angle == 0))
    while active.size:
        angle[active] += scan.beam_step
        beam[active] += way[active]
        on = (beam[active] >= 0) & (beam[active] <= last)
        next_range = np.where(on, scan.ranges[rows[active], np.clip(beam[active], 0, last)], 0.0)
        nearer = on & (next_range < own[active] - _IN_FRONT)
        angle[active[~nearer & (next_range < own[active] + MAX_GAP)]] = np.inf
        active = active[nearer]
    return angle.reshape(2, -1).T.copy()


def _about(returns: Returns, plate: Plate, near: Array) -> np.ndarray:
    """Mask (H,) of the returns in pieces that lie mostly around the plates expected at `near` (S, 3)."""
    close = plate.outside(near, returns.row, returns.x, returns.y) < _ABOUT
    if close.all():  # all pieces do, as in an open field
        return close
    pieces = returns.split(FINER_GAPS[-1])
    share = np.bincount(pieces.label, weights=close, minlength=len(pieces.count)) / np.maximum(pieces.count, 1)
    fits = pieces.extent <= np.hypot(plate.length, plate.thickness) + 2 * _ABOUT  # as all pieces around the plate do
    return (fits & (share >= 0.5))[pieces.label]
