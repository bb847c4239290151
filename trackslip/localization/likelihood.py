"""Likelihood of poses of the known rectangle, given the ranges of a scan, and its maximisation for
many scans at once.

A beam with direction u meets a face whose plane is m.p = h at range h / (m.u). At most two faces
point towards the LRF, one long and one short. Together they form a wedge, and a beam meets the
wedge where it enters the second of the two half-planes. The likelihood has two parts:

- the range of every return, with the scanner's noise, under a Huber loss;
- the two edges of the silhouette. The outermost corner of the plate is uniformly distributed
  between the last beam that missed the plate and the first that hit it, so the middle of this gap
  measures the bearing of the corner with variance step^2 / 12. Without the edges, a plate seen
  broadside could slide freely along itself. An edge of the field of view or of the scanner's reach
  is not an edge of the plate and measures nothing. If beams inside the cluster are missing at a
  rate p, beams beyond its last return may be missing too: their expected number is p / (1 - p),
  with variance p / (1 - p)^2. Where an object in front of the plate hides an edge, the corner may
  be anywhere behind the object: the cost rises only if the corner of a pose sticks out beyond the
  object or does not reach the last return.

Thus a beam that passes through the assumed plate adds to the cost through the edges. A return in a
direction where the assumed plate isn't costs as much as if it had been predicted at the near or far
end of the plate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array
from trackslip.localization.rows import Rows
from trackslip.localization.scan import MIN_NOISE, Cluster, Plate, Points, Scan, places_of

# signs of the bearings of the right and left edge from the middle
_OUTWARDS: Final = np.array([[-1.0], [1.0]])
# distance from the scanner's maximum range within which returns may be missing [m]
_MARGIN: Final = 0.1
EDGE_ON: Final = np.radians(2.0)
"""Viewing angle below which a scan determines no pose [rad]: heading errors are three to five times
as large as the likelihood's curvature implies, because few beams graze the long face and the mirror
image is nearly as likely.
"""
UNKNOWN: Final = 1e6  # variance of quantities that a scan does not determine
_BESIDE: Final = 1e-12  # avoids division by zero if a corner is at the LRF [m]
_TINY: Final = 1e-300  # avoids division by zero if a beam is parallel to a face
# damping of the first step, and least damping after a step that raised the cost
_DAMPING: Final = 1e-3
_REFUSED: Final = 1.0
# predicted cost decrease below which a step is the last; later ones would gain about its square
_CONVERGED: Final = 1e-2
# rows and columns of the six distinct elements of a Hessian
_ROW: Final = np.triu_indices(3)[0]
_COLUMN: Final = np.triu_indices(3)[1]
# element number at each place of the Hessian
_SYMMETRIC: Final = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


@dataclass(frozen=True)
class Edges(Rows):
    """The edges of the plate's silhouette, right and left, in M scans."""

    ahead: Points  # (M,) direction of the middle, halfway between the outermost returns
    bearing: Array  # (M, 2) bearings of the edges from the middle [rad]
    # (M, 2) reciprocal standard deviations of the bearings; 0 if not an edge of the plate [1/rad]
    weight: Array
    slack: Array  # (M, 2) largest deviation of a hidden edge without cost [rad]


@dataclass(frozen=True)
class PlateBeams:
    """The data of M scans: H returns from the plate, at least one per scan, and two edges each."""

    u: Array  # (2, H) directions of the beams that returned
    u_turned: Array  # (2, H) u turned by a right angle to the right
    range: Array  # (H,) measured ranges [m]
    count: np.ndarray  # (M,) number of returns in each scan
    first: np.ndarray  # (M,) index of the first return in each scan
    edges: Edges  # (M,) edges of the silhouettes
    noise: float  # standard deviation of a range [m]

    @classmethod
    def of(cls, scan: Scan, cluster: Cluster) -> PlateBeams:
        """Collect the data of clusters from `scan`, each of which has at least one return."""
        step, count, bearing, distance = (
            scan.beam_step,
            cluster.count,
            cluster.bearing,
            cluster.range,
        )
        first = count.cumsum() - count
        low, high = bearing[first], bearing[first + count - 1]
        middle = (low + high) / 2
        # share of missing beams in the cluster
        lost = np.maximum(cluster.lost / (cluster.lost + count), scan.dropout)
        beyond = lost / (1 - lost)  # expected number of missing beams beyond the cluster
        hidden = cluster.hidden.T  # (2, M) for right and left, like all arrays for edges below
        seen = np.isfinite(hidden)
        slack = np.where(seen, hidden, 0.0) / 2
        reach = (high - low) / 2 + (0.5 + beyond) * step + slack
        spread = step * np.sqrt(1 / 12 + beyond / (1 - lost))
        seen &= np.maximum.reduceat(distance, first) < scan.max_range - _MARGIN
        seen &= np.array([low > scan.bearings[0] + step / 4, high < scan.bearings[-1] - step / 4])
        weight, ahead = np.where(seen, 1 / spread, 0.0), np.exp(1j * middle)
        edges = Edges(ahead, (reach * _OUTWARDS).T, weight.T, slack.T)
        cos, sin = np.cos(bearing), np.sin(bearing)
        turned = np.array([sin, -cos])
        return cls(
            np.array([cos, sin]), turned, distance, count, first, edges, max(scan.noise, MIN_NOISE)
        )

    def take(self, rows: np.ndarray) -> PlateBeams:
        """Select the data of the scans `rows` (R,), in that order, possibly repeated."""
        count, kept = self.count[rows], places_of(self.count, rows)
        first = count.cumsum() - count
        u, u_turned = (part.take(kept, axis=1) for part in (self.u, self.u_turned))
        return PlateBeams(
            u, u_turned, self.range[kept], count, first, self.edges.take(rows), self.noise
        )

    def thinned(self, most: int) -> PlateBeams:
        """Keep every n-th return of each scan, so that about `most` or fewer are left, and both
        edges.
        """
        every = np.maximum(1, self.count // most)
        place = np.arange(len(self.range)) - np.repeat(self.first, self.count)
        kept = np.flatnonzero(place % np.repeat(every, self.count) == 0)
        count = -(-self.count // every)
        few = {name: getattr(self, name).take(kept, axis=-1) for name in ("u", "u_turned", "range")}
        return replace(self, count=count, first=np.cumsum(count) - count, **few)

    def spread(self, of_scans: Array) -> Array:
        """Repeat values (..., M) of the scans for each of their returns: (..., H)."""
        return of_scans.repeat(self.count, axis=-1)

    def sums(self, of_returns: Array) -> Array:
        """Sum values (..., H) of the returns in each scan: (..., M)."""
        return np.add.reduceat(of_returns, self.first, axis=-1)


@dataclass(frozen=True)
class View:
    """Positions of plates relative to the LRF, along and across the plates' axes."""

    plate: Plate
    place: Points  # (M,) the centre, along + i across [m]
    axis: Points  # (M,) direction of the long axis in the LRF's frame

    @classmethod
    def of(cls, plate: Plate, pose: Array) -> View:
        """Compute the view of plates at poses (M, 3) in the LRF's frame."""
        axis = np.exp(1j * pose[:, 2])
        return cls(plate, (pose[:, 0] + 1j * pose[:, 1]) * axis.conj(), axis)

    def silhouette(self, ahead: Points) -> Array:
        """Bearings of the outermost corners, right and left, and their derivatives, (4, 2, M).

        The bearings are relative to the directions `ahead` (M,), so they do not wrap [rad]. The
        derivatives are with respect to the position along and across the plate's axes and to the
        heading.
        """
        half = complex(self.plate.length, self.plate.thickness) / 2
        from_centre = np.array([[half], [half.conjugate()], [-half], [-half.conjugate()]])
        corners = from_centre + self.place + _BESIDE  # (4, M)
        bearing = np.angle(corners * (self.axis * ahead.conj()))
        outermost = np.array([bearing.argmin(axis=0), bearing.argmax(axis=0)])  # (2, M)
        views = np.arange(len(ahead))
        inverse = 1 / corners[outermost, views]  # the bearing is the imaginary part of a logarithm
        by_heading = inverse * from_centre[outermost, 0]
        return np.array([bearing[outermost, views], inverse.imag, inverse.real, by_heading.real])


def viewing_angle(pose: Array) -> Array:
    """Angles (S,) [rad] between the line of sight and plates at poses (S, 3) in the LRF's frame; 0
    is edge-on.
    """
    off = pose[:, 2] - np.arctan2(pose[:, 1], pose[:, 0])
    return np.abs((off + np.pi / 2) % np.pi - np.pi / 2)


def in_axes(heading: Array) -> Array:
    """Matrices (M, 3, 3) that convert changes of (x, y, phi) into changes along and across plates
    at `heading` (M,).
    """
    axes = np.zeros((len(heading), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(heading)
    axes[:, 0, 1] = np.sin(heading)
    axes[:, 1, 0] = -axes[:, 0, 1]
    axes[:, 2, 2] = 1.0
    return axes


@dataclass(frozen=True)
class Evaluation(Rows):
    """Likelihoods of M poses, with derivatives by the position along and across the plate and by
    the heading.
    """

    pose: Array  # (M, 3) in the LRF's frame
    cost: Array  # (M,) negative log likelihoods
    gradient: Array  # (M, 3)
    hessian: Array  # (M, 3, 3)

    def in_lrf_frame(self) -> Evaluation:
        """Convert the derivatives into derivatives with respect to x, y and phi."""
        axes = in_axes(self.pose[:, 2])
        back = axes.swapaxes(1, 2)
        return Evaluation(
            self.pose,
            self.cost,
            (back @ self.gradient[..., None])[..., 0],
            back @ self.hessian @ axes,
        )

    def newton(self, damping: Array) -> tuple[Array, Array]:
        """Poses (M, 3) after Newton steps with `damping` (M,), and the predicted cost decreases
        (M,).
        """
        step = np.linalg.solve(_regular(self.hessian, damping), -self.gradient[..., None])[..., 0]
        moved = self.pose + step
        moved[:, :2] = self.pose[:, :2] + se2.rotate(self.pose[:, 2], step[:, :2])
        return moved, (step * self.gradient).sum(axis=1) / -2

    def covariances(self) -> Array:
        """Inverses (M, 3, 3) of the Hessians, with variance UNKNOWN in directions that a scan does
        not determine.
        """
        return np.linalg.inv(_regular(self.hessian, np.zeros(len(self.cost))))


def _regular(hessian: Array, damping: Array) -> Array:
    """The Hessians (M, 3, 3) with damping (M,) and a prior whose variances are UNKNOWN."""
    regular = hessian.copy()
    diagonal = regular.reshape(-1, 9)[:, ::4]  # a view
    diagonal *= 1 + damping[:, None]
    diagonal += 1 / UNKNOWN
    return regular


@dataclass(frozen=True)
class PlateLikelihood:
    """Negative log likelihood of the poses of a plate, with its derivatives and minima."""

    plate: Plate
    huber: float  # residual above which the loss of a range is linear [standard deviations]

    def evaluate(self, beams: PlateBeams, pose: Array) -> Evaluation:
        """Compute cost, gradient and Gauss-Newton Hessian at poses (M, 3)."""
        view = View.of(self.plate, pose)
        residual, on_long, slope, lever = self._ranges(beams, view)
        weight, cost = self.loss(residual)
        # (3, H)
        jacobian = np.array(
            [np.where(on_long, 0.0, slope), np.where(on_long, slope, 0.0), lever * slope]
        )
        weighted = weight * jacobian
        sums = beams.sums(
            np.concatenate([cost[None], weighted * residual, weighted[_ROW] * jacobian[_COLUMN]])
        )
        edges = self.edges(beams.edges, view)  # (4, 2, M)
        missed, by_edges = edges[0], edges[1:]
        total = sums[0] + (missed**2).sum(axis=0) / 2
        gradient = sums[1:4] + (by_edges * missed).sum(axis=1)
        elements = sums[4:] + (by_edges[_ROW] * by_edges[_COLUMN]).sum(axis=1)
        return Evaluation(pose, total, gradient.T, elements[_SYMMETRIC].transpose(2, 0, 1))

    def misfit(self, beams: PlateBeams, pose: Array) -> Array:
        """Root mean square residuals (M,) of the ranges at poses (M, 3) [standard deviations]."""
        residual = self._ranges(beams, View.of(self.plate, pose))[0]
        return np.sqrt(beams.sums(residual * residual) / beams.count)

    def climb(self, beams: PlateBeams, pose: Array, iterations: int) -> Evaluation:
        """Minimise the cost from poses (M, 3) in the LRF's frame, by damped Gauss-Newton steps
        (Levenberg).

        A step that raises the cost has crossed a kink, where beams leave a face of the plate, and
        is rejected. A row whose next step would gain almost nothing takes that step and stops,
        independently of the other rows.
        """
        fit = self.evaluate(beams, pose.copy())
        climbing, damping = np.arange(len(pose)), np.full(len(pose), _DAMPING)
        for _ in range(iterations):
            target, fall = fit.take(climbing).newton(damping[climbing])
            going = fall >= _CONVERGED
            last = ~going & (damping[climbing] < _REFUSED)
            fit.pose[climbing[last]] = target[last]
            fit.cost[climbing[last]] -= fall[last]
            if not going.any():
                break
            if not going.all():
                climbing, beams, target = (
                    climbing[going],
                    beams.take(np.flatnonzero(going)),
                    target[going],
                )
            trial = self.evaluate(beams, target)
            better = trial.cost < fit.cost[climbing]
            fit.put(climbing[better], trial.take(better))
            before = damping[climbing]
            damping[climbing] = np.where(better, before / 10, np.maximum(10 * before, _REFUSED))
        return fit

    def loss(self, residual: Array) -> tuple[Array, Array]:
        """Weights (...) and costs (...) of residuals (...) [standard deviations] under the Huber
        loss.
        """
        size = np.abs(residual)
        weight = self.huber / np.maximum(size, self.huber)
        weighted = weight * size
        return weight, weighted * (size - weighted / 2)

    def _ranges(self, beams: PlateBeams, view: View) -> tuple[Array, Array, Array, Array]:
        """Residuals (H,) of the ranges [standard deviations], and three factors of their
        derivatives.

        These are whether a beam hits the long face (H,), the derivative of its residual by the
        position of the face (H,) [standard deviations per m], and the place on the face where the
        beam hits (H,) [m].
        """
        half = np.array([[self.plate.length], [self.plate.thickness]]) / 2
        of_scans = np.empty((10, len(view.place)))
        of_scans[0], of_scans[1] = view.axis.real, view.axis.imag
        place = of_scans[2:4]  # along and across, like the pairs of rows below
        place[0], place[1] = view.place.real, view.place.imag
        # signed distances of the planes of the short and long faces that point to the LRF; 0 if
        # neither of a pair does
        np.subtract(place, np.minimum(np.maximum(place, -half), half), out=of_scans[4:6])
        np.copysign(_TINY, place, out=of_scans[6:8])
        distance, reach = (
            np.abs(view.place),
            math.hypot(self.plate.length, self.plate.thickness) / 2,
        )
        np.maximum(distance - reach, _TINY, out=of_scans[8])
        np.add(distance, reach, out=of_scans[9])
        spread = beams.spread(of_scans)
        cos, sin, near, far = spread[0], spread[1], spread[8], spread[9]
        u = beams.u * cos + beams.u_turned * sin
        # the range to a face is negative where the beam does not enter the half-plane behind the
        # face
        per_distance: Array = 1 / (u - spread[6:8])
        to_short, to_long = spread[4:6] * per_distance
        on_long = to_long > to_short
        entered = np.maximum(to_short, to_long)
        predicted = np.minimum(np.maximum(entered, near), far)
        scale = 1 / beams.noise
        residual = (predicted - beams.range) * scale
        slope = np.where(on_long, per_distance[1], per_distance[0])
        slope *= (predicted == entered) * scale
        along, across = predicted * u - spread[2:4]
        return residual, on_long, slope, np.where(on_long, along, -across)

    def edges(self, edges: Edges, view: View) -> Array:
        """Residuals of the silhouette's two edges, followed by their three derivatives, (4, 2,
        M).
        """
        bearing, *slopes = view.silhouette(edges.ahead)
        slack, missed = edges.slack.T, bearing - edges.bearing.T
        missed -= missed.clip(-slack, slack)
        return np.array([missed, *slopes]) * np.where(
            (slack == 0) | (missed != 0), edges.weight.T, 0.0
        )
