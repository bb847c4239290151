"""Scans of a real or simulated laser range finder (LRF), and the points in them that are on the
plate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trackslip import se2
from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array
from trackslip.viewable import ShortRepr

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
_EXPECTED_MARGIN: Final = 0.15
# maximum distance of a return from its plate, unless five standard deviations are more [m]
_MAX_RESIDUAL: Final = 0.03
# range below which returns are from the LRF's housing or stand [m]
_HOUSING_RADIUS: Final = 0.05
# distance from the background within which returns belong to it [standard deviations]
_BACKGROUND_DEVIATIONS: Final = 5.0
# distance in front of the plate from which a return is from another object [m]
_IN_FRONT: Final = 0.05
_MAX_CANDIDATES: Final = 4  # maximum number of candidate clusters per scan


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

    def largest_extent(self, noise: float) -> float:
        """Largest side of a box around returns from the plate, with range errors [m].

        `noise` is the standard deviation of a range [m].
        """
        return self.length + self.thickness + 6 * noise

    def outside(self, pose: Array, which: np.ndarray, x: Array, y: Array) -> Array:
        """Distances (H,) [m] of points (x, y) from the plates `which` (H,) among those at `pose`
        (S, 3); < 0 inside.

        In the axes of its plate, a point is beyond the nearer end by `beyond_end`, and beyond the
        nearer long face by `beyond_face`; both are negative inside. Outside, the distance is the
        hypotenuse of the positive ones. Inside, it is the larger of both, to the nearest face.
        """
        heading = pose[:, 2]
        plates = np.array([pose[:, 0], pose[:, 1], np.cos(heading), np.sin(heading)])
        centre_x, centre_y, cos, sin = plates.take(which, axis=1)
        x = x - centre_x
        y = y - centre_y
        beyond_end = np.abs(cos * x + sin * y) - self.length / 2
        beyond_face = np.abs(cos * y - sin * x) - self.thickness / 2

        inside = np.minimum(np.maximum(beyond_end, beyond_face), 0)
        outside_x = np.maximum(beyond_end, 0)
        outside_y = np.maximum(beyond_face, 0)
        return np.sqrt(outside_x * outside_x + outside_y * outside_y) + inside


@dataclass(frozen=True, repr=False)
class Scan(ShortRepr):
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
        cos = np.cos(self.mount[2])
        sin = np.sin(self.mount[2])
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
        return turn @ covariance @ turn.T


@dataclass(frozen=True, repr=False)
class Cluster(ShortRepr):
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
            bearing=np.concatenate([part.bearing for part in parts]),
            range=np.concatenate([part.range for part in parts]),
            count=np.concatenate([part.count for part in parts]),
            lost=np.concatenate([part.lost for part in parts]),
            hidden=np.concatenate([part.hidden for part in parts]),
        )

    @property
    def positions(self) -> tuple[Array, Array]:
        """Positions x and y (H,) of the returns in the LRF's frame [m]."""
        x = self.range * np.cos(self.bearing)
        y = self.range * np.sin(self.bearing)
        return x, y

    def sums(self, values: Array) -> Array:
        """Sum the returns' values (H,) in each scan: (S,)."""
        return np.asarray(np.bincount(self.row, values, len(self.count)), float)

    def extremes(self, values: Array) -> tuple[Array, Array]:
        """Minimum and maximum (S,) of the returns' values (H,) in each scan; 0 for scans without
        returns.
        """
        low = np.zeros(len(self.count))
        high = np.zeros(len(self.count))
        filled = self.count > 0
        first = (self.count.cumsum() - self.count)[filled]
        if first.size:
            low[filled] = np.minimum.reduceat(values, first)
            high[filled] = np.maximum.reduceat(values, first)
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
        # a piece begins with a new scan, and after each gap
        distance_squared = (self.x[1:] - self.x[:-1]) ** 2 + (self.y[1:] - self.y[:-1]) ** 2
        is_apart = distance_squared > gap**2
        is_apart |= self.row[1:] != self.row[:-1]
        begins = np.ones(len(self.row), bool)
        begins[1:] = is_apart

        first = np.flatnonzero(begins)
        end = np.append(first, len(begins))[1:]
        width = np.maximum.reduceat(self.x, first) - np.minimum.reduceat(self.x, first)
        height = np.maximum.reduceat(self.y, first) - np.minimum.reduceat(self.y, first)
        return ReturnPieces(
            row=self.row[first],
            label=np.cumsum(begins) - 1,
            count=end - first,
            extent=np.maximum(width, height),
        )

    def centres(self, pieces: ReturnPieces) -> Array:
        """Mean positions (P, 2) of the returns in each piece [m]."""
        number = len(pieces.count)
        x_sums = np.bincount(pieces.label, self.x, number)
        y_sums = np.bincount(pieces.label, self.y, number)
        return np.stack([x_sums, y_sums], axis=-1) / pieces.count[:, None]


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
    # sorted by row and then by score, the last of each row is its best
    order = np.lexsort((score, row))
    sorted_row = row[order]
    is_last = np.ones(len(row), bool)
    is_last[:-1] = sorted_row[1:] != sorted_row[:-1]
    best = np.zeros(len(row), bool)
    best[order[is_last]] = True
    return best


def places_of(count: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Indices of the returns from the scans `rows`, where `count` (S,) is the number of returns in
    each scan.
    """
    first = (count.cumsum() - count)[rows]
    selected = count[rows]
    first_selected = selected.cumsum() - selected
    shift = np.repeat(first - first_selected, selected)
    return shift + np.arange(len(shift))


def extract_plate(scan: Scan, plate: Plate, near: Array | None = None) -> Cluster:
    """Extract the cluster of points on the plate (paper, Sec. III-B) from scans with ranges (S, B).

    With expected poses `near` (S, 3) in the LRF's frame, the cluster consists of all pieces around
    the expected plate, which an object in front may have divided. If there are no such pieces, the
    cluster is the piece nearest to `near`; without `near`, it is the piece with most returns. Only
    pieces no larger than the plate are considered, split where neighbouring returns are more than
    MAX_GAP apart.
    """
    returns = returns_of(scan)
    scans = np.arange(len(scan.ranges))

    # the returns around the expected plates
    is_on_plate = np.zeros(len(returns.row), bool)
    is_as_expected = np.zeros(len(scan.ranges), bool)
    if near is not None:
        is_on_plate = _near_expected(returns, plate, near)
        is_as_expected[returns.row[is_on_plate]] = True

    # in scans without such returns, the best piece
    if not is_as_expected.all():
        pieces = returns.split(MAX_GAP)
        fits = pieces.extent < plate.largest_extent(scan.noise)
        score: Array = pieces.count
        if near is not None:
            away = returns.centres(pieces) - near[pieces.row, :2]
            score = -np.hypot(away[:, 0], away[:, 1])
        is_best = fits & best_of_each(pieces.row, np.where(fits, score, -np.inf))
        is_on_plate = np.where(is_as_expected[returns.row], is_on_plate, is_best[pieces.label])
    return gather(scan, scans, returns.row[is_on_plate], returns.beam[is_on_plate])


def candidates(scan: Scan, plate: Plate, gap: float) -> tuple[Cluster, np.ndarray]:
    """Clusters in scans (S, B) that could be the plate, and the index of the scan (C,) for each
    cluster.

    The pieces of each scan with most returns are chosen, if no larger than the plate, split at gaps
    above `gap` [m].
    """
    returns = returns_of(scan)
    pieces = returns.split(gap)
    is_possible = pieces.count >= MIN_RETURNS
    is_possible &= pieces.extent < plate.largest_extent(scan.noise)

    # the possible pieces by scan, the largest first, and of each scan only the first few
    order = np.flatnonzero(is_possible)
    order = order[np.lexsort((-pieces.count[order], pieces.row[order]))]
    row = pieces.row[order]
    rank = np.arange(len(row)) - np.searchsorted(row, row)
    is_chosen = rank < _MAX_CANDIDATES
    chosen = order[is_chosen]
    chosen_row = row[is_chosen]

    # the returns by cluster, in the order of the clusters
    cluster_of_piece = np.full(len(pieces.row), -1)
    cluster_of_piece[chosen] = np.arange(len(chosen))
    cluster = cluster_of_piece[pieces.label]
    members = np.flatnonzero(cluster >= 0)
    members = members[np.argsort(cluster[members], kind="stable")]
    return gather(scan, chosen_row, cluster[members], returns.beam[members]), chosen_row


def returns_at(scan: Scan, plate: Plate, pose: Array) -> Cluster:
    """Select the returns in scans (S, B) that are, within the noise, on plates at poses (S, 3) in
    the LRF's frame.
    """
    returns = returns_of(scan)
    outside = plate.outside(pose, returns.row, returns.x, returns.y)
    is_on_plate = np.abs(outside) < max(_MAX_RESIDUAL, 5 * scan.noise)
    scans = np.arange(len(scan.ranges))
    return gather(scan, scans, returns.row[is_on_plate], returns.beam[is_on_plate])


def gather(scan: Scan, rows: np.ndarray, cluster: np.ndarray, beam: np.ndarray) -> Cluster:
    """Build clusters of the scans `rows` (C,) from the returns' cluster indices (H,), ascending,
    and beams (H,).
    """
    count = np.bincount(cluster, minlength=len(rows))
    found = Cluster(
        bearing=scan.bearings[beam],
        range=scan.ranges[rows[cluster], beam],
        count=count,
        lost=np.zeros_like(count),
        hidden=np.zeros((len(rows), 2)),
    )
    # the first and last beams of the clusters that have any
    filled = np.flatnonzero(count)
    end = count.cumsum()[filled]
    low = beam[end - count[filled]]
    high = beam[end - 1]

    has_gaps = high - low + 1 > count[filled]
    if has_gaps.any():
        gappy = filled[has_gaps]
        found.lost[gappy] = _lost(scan, rows, found, gappy, low[has_gaps], high[has_gaps])
    found.hidden[filled] = _hidden(scan, rows[filled], low, high)
    return found


def _lost(
    scan: Scan,
    rows: np.ndarray,
    clusters: Cluster,
    which: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Beams (G,) between `low` (G,) and `high` (G,) that were lost in the clusters `which` (G,).

    `rows` (C,) are the scans of all clusters. A beam isn't lost if it is in the cluster, or if it
    returned from an object closer than the cluster's farthest return.
    """
    width = high - low + 1
    gappy = np.repeat(np.arange(len(which)), width)  # index in `which` of each beam in between
    place = np.arange(len(gappy)) - np.repeat(width.cumsum() - width, width)
    between = low[gappy] + place

    farthest = clusters.extremes(clusters.range)[1]
    ranges = scan.ranges[rows[which[gappy]], between]
    is_in_front = ranges < farthest[which[gappy]]  # false for NaN
    # the cluster's own farthest returns aren't in front either
    own = clusters.sums(clusters.range >= farthest[clusters.row])
    return np.bincount(gappy, ~is_in_front) - own[which]


def returns_of(scan: Scan) -> Returns:
    """Select all returns that are not from the background."""
    is_kept = scan.ranges > _HOUSING_RADIUS  # false for NaN
    if scan.background is not None:
        tolerance = _BACKGROUND_DEVIATIONS * max(scan.noise, MIN_NOISE)
        for level in np.atleast_2d(scan.background):
            is_kept &= ~(np.abs(scan.ranges - level) < tolerance)
    place = np.flatnonzero(is_kept)
    row, beam = np.divmod(place, is_kept.shape[1])
    distance = scan.ranges.ravel()[place]
    bearing = scan.bearings[beam]
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
    below = scan.ranges[rows, np.maximum(low - 1, 0)]
    above = scan.ranges[rows, np.minimum(high + 1, last)]
    if np.isnan(below).all() and np.isnan(above).all():  # no returns beside any cluster
        return np.zeros((len(rows), 2))

    def is_beam(beam: np.ndarray) -> np.ndarray:
        return (beam >= 0) & (beam <= last)

    def range_at(rows: np.ndarray, beam: np.ndarray) -> Array:
        return np.asarray(scan.ranges[rows, np.clip(beam, 0, last)])

    # the edges of all clusters, first the lower and then the upper, with the beams beyond
    outwards = np.repeat([-1, 1], len(rows))
    rows = np.concatenate([rows, rows])
    edge = np.concatenate([low, high])
    edge_range = scan.ranges[rows, edge]
    beam = edge + outwards
    second = edge + 2 * outwards

    # without a hidden part: does the plate continue beyond the edge?
    farther = np.where(is_beam(beam), range_at(rows, beam) - edge_range, np.inf)
    continues = (farther > -_IN_FRONT) & (farther < FINER_GAPS[0]) & is_beam(second)
    if scan.background is None:
        continues &= range_at(rows, second) < edge_range + MAX_GAP
    angle = np.where(continues, np.inf, 0.0)

    # with a hidden part: go on beam by beam until its end
    active = np.flatnonzero((farther < -_IN_FRONT) & (angle == 0))
    while active.size:
        angle[active] += scan.beam_step
        beam[active] += outwards[active]
        is_inside = is_beam(beam[active])
        next_range = np.where(is_inside, range_at(rows[active], beam[active]), 0.0)
        is_in_front = is_inside & (next_range < edge_range[active] - _IN_FRONT)
        may_be_plate = next_range < edge_range[active] + MAX_GAP
        angle[active[~is_in_front & may_be_plate]] = np.inf
        active = active[is_in_front]
    return angle.reshape(2, -1).T.copy()


def _near_expected(returns: Returns, plate: Plate, near: Array) -> np.ndarray:
    """Mask (H,) of the returns in pieces that are mostly close to the plates expected at `near` (S,
    3).
    """
    outside = plate.outside(near, returns.row, returns.x, returns.y)
    is_close = outside < _EXPECTED_MARGIN
    if is_close.all():  # as in an open field
        return is_close
    pieces = returns.split(FINER_GAPS[-1])
    close_count = np.bincount(pieces.label, weights=is_close, minlength=len(pieces.count))
    share = close_count / np.maximum(pieces.count, 1)
    # the largest piece of which all is close
    diagonal = np.hypot(plate.length, plate.thickness)
    fits = pieces.extent <= diagonal + 2 * _EXPECTED_MARGIN
    is_expected = fits & (share >= 0.5)
    return is_expected[pieces.label]
