"""Scans of a real or simulated laser range finder (LRF), the points in them that are on the plate,
and estimates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from trackslip import se2
from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array

Points = NDArray[np.complex128]  # points or directions in the scan plane, as x + iy
MAX_GAP: Final = 0.7
"""Distance above which neighbouring returns are from different objects [m]. It exceeds the length
of the plate, because neighbouring returns can be a plate's length apart when the plate is seen
nearly edge-on.
"""
FINER_GAPS: Final = (0.25, 0.1)
"""Smaller gaps, tried where MAX_GAP does not separate the plate from a close object [m]."""
# fewest returns for a pose; three always fit exactly, on whichever face they are
MIN_RETURNS: Final = 4
MIN_NOISE: Final = 0.5e-3
"""Smallest assumed noise of a scanner, because the plate is never a perfect rectangle [m]."""
# maximum distance of a return from an expected plate, above a tracker's error [m]
_ABOUT: Final = 0.15
# maximum distance of a return from its plate, unless five standard deviations are more [m]
_ON_PLATE: Final = 0.03
_HOUSING: Final = 0.05  # range below which returns are from the LRF's housing or stand [m]
# distance from the background within which returns belong to it [standard deviations]
_STATIC: Final = 5.0
# distance in front of the plate from which a return is from another object [m]
_IN_FRONT: Final = 0.05
_CANDIDATES: Final = 4  # maximum number of candidate clusters per scan


@dataclass(frozen=True)
class Plate:
    """The upright plate on the robot's axis of symmetry, a rectangle in the scan plane centred on
    the robot.
    """

    length: float = 0.60
    """Size along the robot [m]."""
    thickness: float = 0.04
    """Size across the robot [m]."""

    def __post_init__(self) -> None:
        require_positive("length", self.length)
        require_positive("thickness", self.thickness)
        if self.thickness >= self.length:
            raise InvalidValueError(
                "thickness", self.thickness, f"less than length = {self.length}"
            )

    def outside(self, pose: Array, which: np.ndarray, x: Array, y: Array) -> Array:
        """Distances (H,) [m] of points (x, y) from the plates `which` (H,) among those at `pose`
        (S, 3); < 0 inside.
        """
        places = np.array([pose[:, 0], pose[:, 1], np.cos(pose[:, 2]), np.sin(pose[:, 2])])
        p_x, p_y, cos, sin = places.take(which, axis=1)
        x, y = x - p_x, y - p_y
        along = np.abs(cos * x + sin * y) - self.length / 2
        across = np.abs(cos * y - sin * x) - self.thickness / 2
        inside, x, y = (
            np.minimum(np.maximum(along, across), 0),
            np.maximum(along, 0),
            np.maximum(across, 0),
        )
        return np.sqrt(x * x + y * y) + inside


@dataclass(frozen=True)
class Scan:
    """One or more scans of a stationary LRF."""

    # (B,) bearings of the beams in the LRF's frame, equally spaced, ascending [rad]
    bearings: Array
    ranges: Array  # (..., B), NaN for no return [m]
    noise: float
    """Standard deviation of a range [m]."""
    mount: Array  # (3,) pose of the LRF in the world
    max_range: float = np.inf
    """Range beyond which no object gives a return [m]."""
    dropout: float = 0.0
    """Probability that a beam that hits an object gives no return, if known [-]."""
    background: Array | None = None
    """Ranges (B,) without the robot, or L alternatives (L, B), NaN for no return [m]. None if they
    are unknown.
    """

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
        """Convert covariances (..., 3, 3) of (x, y, phi) from the LRF's frame to the world
        frame.
        """
        cos, sin = np.cos(self.mount[2]), np.sin(self.mount[2])
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
        return turn @ covariance @ turn.T


@dataclass(frozen=True)
class Cluster:
    """The H returns in S scans that are attributed to the plate, ordered by scan."""

    bearing: Array  # (H,) bearings of the returns [rad]
    range: Array  # (H,) ranges of the returns [m]
    count: np.ndarray  # (S,) number of returns; 0 for a scan without a cluster
    # (S,) beams without a return between the first and last return, if no closer object explains
    # them
    lost: np.ndarray
    # (S, 2) angle hidden by closer objects beyond the first and last return; inf if unlimited [rad]
    hidden: Array

    @property
    def row(self) -> np.ndarray:
        """Index (H,) of the scan of each return."""
        return np.repeat(np.arange(len(self.count)), self.count)

    def take(self, rows: np.ndarray) -> Cluster:
        """Select the clusters of the scans `rows`."""
        kept = places_of(self.count, rows)
        return Cluster(
            self.bearing[kept],
            self.range[kept],
            self.count[rows],
            self.lost[rows],
            self.hidden[rows],
        )

    def among(self, where: np.ndarray) -> Cluster:
        """Spread the clusters over T scans: scans in the mask `where` (T,) have one cluster each,
        other scans none.
        """

        def spread(values: np.ndarray) -> np.ndarray:
            wider = np.zeros((len(where), *values.shape[1:]), values.dtype)
            wider[where] = values
            return wider

        return Cluster(
            self.bearing, self.range, spread(self.count), spread(self.lost), spread(self.hidden)
        )

    @classmethod
    def joined(cls, parts: Sequence[Cluster]) -> Cluster:
        """Concatenate the clusters of all parts, in order."""
        return cls(
            *(
                np.concatenate(values)
                for values in zip(*(vars(part).values() for part in parts), strict=True)
            )
        )

    def sums(self, values: Array) -> Array:
        """Sum the returns' values (H,) in each scan: (S,)."""
        return np.asarray(np.bincount(self.row, values, len(self.count)), float)

    def extremes(self, values: Array) -> tuple[Array, Array]:
        """Minimum and maximum (S,) of the returns' values (H,) in each scan; 0 for scans without
        returns.
        """
        low, high = np.zeros(len(self.count)), np.zeros(len(self.count))
        filled = self.count > 0
        first = (self.count.cumsum() - self.count)[filled]
        if first.size:
            low[filled], high[filled] = (
                np.minimum.reduceat(values, first),
                np.maximum.reduceat(values, first),
            )
        return low, high


@dataclass(frozen=True)
class Returns:
    """The H returns of some scans, ordered by scan and beam."""

    row: np.ndarray  # (H,) index of the scan
    beam: np.ndarray  # (H,) index of the beam
    x: Array  # (H,) position in the LRF's frame [m]
    y: Array  # (H,) position in the LRF's frame [m]

    def split(self, gap: float) -> ReturnPieces:
        """Split the returns into pieces where neighbouring returns are more than `gap` [m]
        apart.
        """
        apart = (self.x[1:] - self.x[:-1]) ** 2 + (self.y[1:] - self.y[:-1]) ** 2 > gap**2
        apart |= self.row[1:] != self.row[:-1]
        starts = np.ones(len(self.row), bool)
        starts[1:] = apart
        first = np.flatnonzero(starts)
        label = np.cumsum(starts) - 1
        count = np.append(first[1:], len(starts)) - first
        spans = [
            np.maximum.reduceat(c, first) - np.minimum.reduceat(c, first) for c in (self.x, self.y)
        ]
        return ReturnPieces(self.row[first], label, count[: len(first)], np.maximum(*spans))

    def centres(self, pieces: ReturnPieces) -> Array:
        """Mean positions (P, 2) of the returns in each piece [m]."""
        sums = [np.bincount(pieces.label, c, len(pieces.count)) for c in (self.x, self.y)]
        return np.stack(sums, axis=-1) / pieces.count[:, None]


@dataclass(frozen=True)
class ReturnPieces:
    """P pieces, which are sequences of neighbouring returns."""

    row: np.ndarray  # (P,) index of the scan
    label: np.ndarray  # (H,) index of the piece of each return
    count: np.ndarray  # (P,) number of returns
    extent: Array  # (P,) longer side of the bounding box [m]


def best_of_each(row: np.ndarray, score: Array) -> np.ndarray:
    """Mask (P,) of the pieces with the highest score in each row; of pieces with equal scores, the
    last.
    """
    order = np.lexsort((score, row))
    best = np.zeros(len(row), bool)
    best[order[np.append(np.diff(row[order]) != 0, True)[: len(order)]]] = True
    return best


def places_of(count: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Indices of the returns from the scans `rows`, where `count` (S,) is the number of returns in
    each scan.
    """
    first, count = (count.cumsum() - count)[rows], count[rows]
    end = count.cumsum()
    return np.repeat(first - end + count, count) + np.arange(end[-1] if end.size else 0)


def extract_plate(scan: Scan, plate: Plate, near: Array | None = None) -> Cluster:
    """Extract the cluster of points on the plate (paper, Sec. III-B) from scans with ranges (S, B).

    With expected poses `near` (S, 3) in the LRF's frame, the cluster consists of all pieces around
    the expected plate, which an object in front may have divided. If there are no such pieces, the
    cluster is the piece nearest to `near`; without `near`, it is the piece with most returns. Only
    pieces no larger than the plate are considered, split where neighbouring returns are more than
    MAX_GAP apart.
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
        score = (
            pieces.count
            if near is None
            else -np.hypot(*(returns.centres(pieces) - near[pieces.row, :2]).T)
        )
        best = (fits & best_of_each(pieces.row, np.where(fits, score, -np.inf)))[pieces.label]
        mine = np.where(expected[returns.row], mine, best)
    return gather(scan, np.arange(len(scan.ranges)), returns.row[mine], returns.beam[mine])


def candidates(scan: Scan, plate: Plate, gap: float) -> tuple[Cluster, np.ndarray]:
    """Clusters in scans (S, B) that could be the plate, and the index of the scan (C,) for each
    cluster.

    The pieces of each scan with most returns are chosen, if no larger than the plate, split at gaps
    above `gap` [m].
    """
    returns = returns_of(scan)
    pieces = returns.split(gap)
    possible = (pieces.count >= MIN_RETURNS) & (
        pieces.extent < plate.length + plate.thickness + 6 * scan.noise
    )
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
    """Select the returns in scans (S, B) that are, within the noise, on plates at poses (S, 3) in
    the LRF's frame.
    """
    returns = returns_of(scan)
    outside = plate.outside(pose, returns.row, returns.x, returns.y)
    mine = np.abs(outside) < max(_ON_PLATE, 5 * scan.noise)
    return gather(scan, np.arange(len(scan.ranges)), returns.row[mine], returns.beam[mine])


def gather(scan: Scan, rows: np.ndarray, cluster: np.ndarray, beam: np.ndarray) -> Cluster:
    """Build clusters of the scans `rows` (C,) from the returns' cluster indices (H,), ascending,
    and beams (H,).
    """
    count = np.bincount(cluster, minlength=len(rows))
    found = Cluster(
        scan.bearings[beam],
        scan.ranges[rows[cluster], beam],
        count,
        0 * count,
        np.zeros((len(rows), 2)),
    )
    filled = np.flatnonzero(count)
    end = count.cumsum()[filled]
    low, high = beam[end - count[filled]], beam[end - 1]
    gaps = np.flatnonzero(high - low + 1 > count[filled])
    if gaps.size:
        width = (high - low + 1)[gaps]
        gap = np.repeat(np.arange(len(gaps)), width)
        between = low[gaps][gap] + np.arange(len(gap)) - (width.cumsum() - width)[gap]
        farthest = found.extremes(found.range)[1]
        not_in_front = ~(
            scan.ranges[rows[filled[gaps]][gap], between] < farthest[filled[gaps]][gap]
        )
        # the farthest returns aren't in front either
        own = found.sums(found.range >= farthest[cluster])
        found.lost[filled[gaps]] = np.bincount(gap, not_in_front) - own[filled[gaps]]
    found.hidden[filled] = _hidden(scan, rows[filled], low, high)
    return found


def returns_of(scan: Scan) -> Returns:
    """Select all returns that are not from the background."""
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
    """Angles (C, 2) hidden by closer objects below the beams `low` (C,) of scans `rows` (C,) and
    above `high` (C,).

    An angle is inf if the hidden part ends at the edge of the field of view or at a return that may
    be from the plate. Without a hidden part, an angle is inf if the next two returns may be from
    the plate: a single return may be a mixture of plate and background, but suffices if the
    background is known.
    """
    last = scan.ranges.shape[1] - 1
    beside = (
        scan.ranges[rows, np.maximum(low - 1, 0)],
        scan.ranges[rows, np.minimum(high + 1, last)],
    )
    if np.isnan(beside).all():  # no returns beside any cluster, as in an open field
        return np.zeros((len(rows), 2))
    way = np.repeat([-1, 1], len(rows))
    rows, edge = np.concatenate([rows, rows]), np.concatenate([low, high])
    own = scan.ranges[rows, edge]
    beam, second = edge + way, edge + 2 * way
    on = (beam >= 0) & (beam <= last)
    farther = np.where(on, scan.ranges[rows, np.minimum(np.maximum(beam, 0), last)] - own, np.inf)
    goes_on = (farther > -_IN_FRONT) & (farther < FINER_GAPS[0]) & (second >= 0) & (second <= last)
    if scan.background is None:
        goes_on &= scan.ranges[rows, np.clip(second, 0, last)] < own + MAX_GAP
    angle = np.where(goes_on, np.inf, 0.0)
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
    """Mask (H,) of the returns in pieces that are mostly close to the plates expected at `near` (S,
    3).
    """
    close = plate.outside(near, returns.row, returns.x, returns.y) < _ABOUT
    if close.all():  # all returns are close, as in an open field
        return close
    pieces = returns.split(FINER_GAPS[-1])
    share = np.bincount(pieces.label, weights=close, minlength=len(pieces.count)) / np.maximum(
        pieces.count, 1
    )
    # if all of a piece is close
    fits = pieces.extent <= np.hypot(plate.length, plate.thickness) + 2 * _ABOUT
    return (fits & (share >= 0.5))[pieces.label]


@dataclass(frozen=True)
class Rows:
    """Base class of dataclasses of arrays with the same first axis."""

    def take(self, rows: np.ndarray) -> Self:
        """Select the rows with indices `rows`, in that order, possibly repeated."""
        return type(self)(**{name: values[rows] for name, values in vars(self).items()})

    def put(self, rows: np.ndarray, other: Self) -> None:
        """Overwrite the rows with indices `rows` (R,) with the R rows of `other`."""
        for mine, others in zip(vars(self).values(), vars(other).values(), strict=True):
            mine[rows] = others


@dataclass(frozen=True)
class PoseEstimate(Rows):
    """Poses of the robot in the world frame, with covariances and validity."""

    pose: Array  # (S, 3) [m, m, rad]
    covariance: Array  # (S, 3, 3) of (x, y, phi); NaN where a locator found no valid pose
    # (S,) bool; a locator's invalid pose is meaningless, a tracker's is predicted
    valid: np.ndarray


class Locator(Protocol):
    """Locator of the plate in single scans, from which headings are ambiguous by half a turn (see
    `Tracker`).
    """

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Locate the plate in scans with ranges (S, B), near expected robot poses `predicted` (S,
        3) in the world.
        """
