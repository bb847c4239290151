"""Scans of a laser range finder (LRF), real or simulated, and the cluster of points that is the plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array

MAX_GAP = 0.7
"""Neighbouring returns farther apart than this belong to different things [m]: longer than the plate, which seen
nearly edge-on returns points as far apart as its whole length."""
_PADDING = 16  # widths of clusters are multiples of this


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


@dataclass(frozen=True)
class Scan:
    """One or more scans of an LRF that stands still."""

    bearings: Array  # (B,) of the beams in the LRF's frame, equally spaced, ascending [rad]
    ranges: Array  # (..., B), NaN where nothing came back [m]
    noise: float
    """Standard deviation of a range [m]."""
    mount: Array  # (3,) pose of the LRF in the world
    max_range: float = np.inf
    """Beyond it nothing comes back [m]."""
    dropout: float = 0.0
    """Probability that a beam doesn't come back though it hit something, where that is known [-]."""

    @property
    def beam_step(self) -> float:
        """Angle between neighbouring beams [rad]."""
        return float((self.bearings[-1] - self.bearings[0]) / (len(self.bearings) - 1))

    def to_world(self, pose: Array) -> Array:
        """Poses (..., 3) given in the LRF's frame, in the world."""
        x, y, phi = self.mount
        cos, sin = np.cos(phi), np.sin(phi)
        return np.stack(
            [
                x + cos * pose[..., 0] - sin * pose[..., 1],
                y + sin * pose[..., 0] + cos * pose[..., 1],
                pose[..., 2] + phi,
            ],
            axis=-1,
        )

    def from_world(self, pose: Array) -> Array:
        """Poses (..., 3) given in the world, in the LRF's frame."""
        x, y, phi = self.mount
        cos, sin = np.cos(phi), np.sin(phi)
        dx, dy = pose[..., 0] - x, pose[..., 1] - y
        return np.stack([cos * dx + sin * dy, -sin * dx + cos * dy, pose[..., 2] - phi], axis=-1)

    def covariance_to_world(self, covariance: Array) -> Array:
        """Covariances (..., 3, 3) of (x, y, phi) given in the LRF's frame, in the world."""
        cos, sin = np.cos(self.mount[2]), np.sin(self.mount[2])
        turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
        return turn @ covariance @ turn.T


@dataclass(frozen=True)
class Cluster:
    """The returns of each scan that are taken for the plate, gathered into rows of equal width."""

    bearing: Array  # (S, W) of the beams from the cluster's first to its last [rad]
    range: Array  # (S, W) [m]; 1 where `hit` is false
    hit: np.ndarray  # (S, W) bool: the beam came back, and from the plate
    count: np.ndarray  # (S,) number of returns; 0 where no cluster was found

    @property
    def width(self) -> np.ndarray:
        """(S,) beams from the first to the last return."""
        return np.where(self.count > 0, self.hit.shape[1] - np.argmax(self.hit[:, ::-1], axis=1), 0)

    @property
    def padded_width(self) -> np.ndarray:
        """(S,) the width rounded up, so that few different ones occur."""
        return -(-self.width // _PADDING) * _PADDING

    def take(self, rows: np.ndarray) -> Cluster:
        """The clusters `rows`, padded to the widest of them."""
        width = int(self.padded_width[rows].max(initial=_PADDING))
        return Cluster(self.bearing[rows, :width], self.range[rows, :width], self.hit[rows, :width], self.count[rows])

    @classmethod
    def joined(cls, parts: Sequence[Cluster]) -> Cluster:
        """The clusters of all parts, in order."""
        width = max(part.hit.shape[1] for part in parts)

        def padded(arrays: Sequence[np.ndarray], mode: str) -> np.ndarray:
            wide = [np.pad(a, ((0, 0), (0, width - a.shape[1])), mode=mode) for a in arrays]  # type: ignore[call-overload]
            return np.concatenate(wide)

        return cls(
            padded([part.bearing for part in parts], "edge"),
            padded([part.range for part in parts], "edge"),
            padded([part.hit for part in parts], "constant"),
            np.concatenate([part.count for part in parts]),
        )


def extract_plate(scan: Scan, plate: Plate, near: Array | None = None) -> Cluster:
    """The cluster of points (paper, Sec. III-B) that is the plate, for scans with ranges (S, B).

    Returns are split where neighbours lie more than MAX_GAP apart. Of the clusters no larger than the plate, the one
    nearest to `near` is taken, else the one with most returns.

    Args:
        scan: ranges (S, B).
        plate: what is looked for.
        near: where the plate is expected, poses (S, 3) in the LRF's frame.
    """
    ranges = scan.ranges
    scans, beams = ranges.shape
    hit = np.isfinite(ranges)
    # hits only, row by row: (H,) arrays
    row, beam = np.nonzero(hit)
    distance = ranges[row, beam]
    x, y = distance * np.cos(scan.bearings[beam]), distance * np.sin(scan.bearings[beam])
    starts = np.ones(len(row), bool)
    starts[1:] = (row[1:] != row[:-1]) | (np.hypot(np.diff(x), np.diff(y)) > MAX_GAP)
    first = np.flatnonzero(starts)
    if first.size == 0:
        return Cluster(np.zeros((scans, 1)), np.ones((scans, 1)), np.zeros((scans, 1), bool), np.zeros(scans, int))
    label = np.cumsum(starts) - 1
    count = np.bincount(label)
    last = first + count - 1
    extent = np.maximum(
        np.maximum.reduceat(x, first) - np.minimum.reduceat(x, first),
        np.maximum.reduceat(y, first) - np.minimum.reduceat(y, first),
    )
    fits = extent < plate.length + plate.thickness + 6 * scan.noise
    if near is None:
        score = count.astype(float)
    else:
        centre_x, centre_y = np.add.reduceat(x, first) / count, np.add.reduceat(y, first) / count
        expected = near[row[first]]
        score = -np.hypot(centre_x - expected[:, 0], centre_y - expected[:, 1])
    score = np.where(fits, score, -np.inf)
    # the best cluster of each scan: sort by (scan, score) and take the last of each scan
    order = np.lexsort((score, row[first]))
    best = order[np.append(np.diff(row[first][order]) != 0, True)]
    best = best[np.isfinite(score[best])]

    found = row[first[best]]
    low = np.zeros(scans, int)
    width = np.zeros(scans, int)
    low[found] = beam[first[best]]
    width[found] = beam[last[best]] - low[found] + 1
    total = np.zeros(scans, int)
    total[found] = count[best]
    widest = max(1, -(-int(width.max()) // _PADDING)) * _PADDING
    column = np.minimum(low[:, None] + np.arange(widest), beams - 1)
    inside = np.arange(column.shape[1]) < width[:, None]
    taken = ranges[np.arange(scans)[:, None], column]
    keep = inside & np.isfinite(taken)
    return Cluster(scan.bearings[column], np.where(keep, taken, 1.0), keep, total)
