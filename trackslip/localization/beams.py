"""The returns from the plate in many scans, one scan after the other, and the edges of the plate's silhouette."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.base import Rows
from trackslip.localization.scan import MIN_NOISE, Cluster, Points, Scan, places_of

_OUTWARDS = np.array([[-1.0], [1.0]])  # signs of bearings outwards from the middle, right and left
_MARGIN = 0.1  # the scanner's reach may cut off returns this close to it [m]


@dataclass(frozen=True)
class Edges(Rows):
    """The edges of the plate's silhouette, right and left, in M scans."""

    ahead: Points  # (M,) direction of the middle, half-way between the outermost returns
    bearing: Array  # (M, 2) from the middle [rad]
    weight: Array  # (M, 2) reciprocal of their standard deviation, 0 if not an edge of the plate [1/rad]
    slack: Array  # (M, 2) deviation of a hidden edge that costs nothing [rad]


@dataclass(frozen=True)
class PlateBeams:
    """The data of M scans: H returns from the plate, at least one per scan, and two edges each."""

    u: Array  # (2, H) directions of the beams that returned
    u_turned: Array  # (2, H) the same, turned by a right angle to the right
    range: Array  # (H,) [m]
    count: np.ndarray  # (M,) number of returns of each scan
    first: np.ndarray  # (M,) place of its first one
    edges: Edges  # (M,)
    noise: float  # of a range [m]

    @classmethod
    def of(cls, scan: Scan, cluster: Cluster) -> PlateBeams:
        """The beams of each cluster of a scan; each has a return."""
        step, count, bearing, distance = scan.beam_step, cluster.count, cluster.bearing, cluster.range
        first = count.cumsum() - count
        low, high = bearing[first], bearing[first + count - 1]
        middle = (low + high) / 2
        lost = np.maximum(cluster.lost / (cluster.lost + count), scan.dropout)  # of the beams inside the cluster
        beyond = lost / (1 - lost)  # expected number of beams missed beyond it
        hidden = cluster.hidden.T  # (2, M), as all that follows of the two edges
        told = np.isfinite(hidden)
        slack = np.where(told, hidden, 0.0) / 2
        reach = (high - low) / 2 + (0.5 + beyond) * step + slack
        spread = step * np.sqrt(1 / 12 + beyond / (1 - lost))
        told &= np.maximum.reduceat(distance, first) < scan.max_range - _MARGIN
        told &= np.array([low > scan.bearings[0] + step / 4, high < scan.bearings[-1] - step / 4])
        weight, ahead = np.where(told, 1 / spread, 0.0), np.exp(1j * middle)
        edges = Edges(ahead, (reach * _OUTWARDS).T, weight.T, slack.T)
        cos, sin = np.cos(bearing), np.sin(bearing)
        turned = np.stack([sin, -cos])
        return cls(np.stack([cos, sin]), turned, distance, count, first, edges, max(scan.noise, MIN_NOISE))

    def take(self, rows: np.ndarray) -> PlateBeams:
        """The beams of the scans `rows` (R,), in that order, possibly repeated."""
        count, kept = self.count[rows], places_of(self.count, rows)
        first = count.cumsum() - count
        u, u_turned = (part.take(kept, axis=1) for part in (self.u, self.u_turned))
        return PlateBeams(u, u_turned, self.range[kept], count, first, self.edges.take(rows), self.noise)

    def thinned(self, most: int) -> PlateBeams:
        """Only every n-th return of each scan, so that at most about `most` are left; the edges are kept."""
        every = np.maximum(1, self.count // most)
        place = np.arange(len(self.range)) - np.repeat(self.first, self.count)
        kept = np.flatnonzero(place % np.repeat(every, self.count) == 0)
        count = -(-self.count // every)
        few = {name: getattr(self, name).take(kept, axis=-1) for name in ("u", "u_turned", "range")}
        return replace(self, count=count, first=np.cumsum(count) - count, **few)

    def spread(self, of_scans: Array) -> Array:
        """Values (..., M) of the scans repeated for each of their returns, (..., H)."""
        return of_scans.repeat(self.count, axis=-1)

    def sums(self, of_returns: Array) -> Array:
        """Sums (..., M) over the returns (..., H) of each scan."""
        return np.add.reduceat(of_returns, self.first, axis=-1)
