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
from dataclasses import dataclass
from typing import Final

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array
from trackslip.localization.rows import Rows
from trackslip.localization.scan import MIN_NOISE, Cluster, Plate, Points, Scan, places_of

EDGE_ON: Final = np.radians(2.0)
"""Viewing angle below which a scan determines no pose [rad]: heading errors are three to five times
as large as the likelihood's curvature implies, because few beams graze the long face and the mirror
image is nearly as likely.
"""
UNKNOWN: Final = 1e6
"""Variance of quantities that a scan does not determine [m^2, rad^2]."""

# signs of the bearings of the right and left edge from the middle
_EDGE_SIGNS: Final = np.array([[-1.0], [1.0]])
# distance from the scanner's maximum range within which returns may be missing [m]
_MAX_RANGE_MARGIN: Final = 0.1
_MIN_CORNER_DISTANCE: Final = 1e-12  # avoids division by zero if a corner is at the LRF [m]
_MIN_DIVISOR: Final = 1e-300  # avoids division by zero if a beam is parallel to a face
# damping of the first step, and least damping after a step that raised the cost
_FIRST_DAMPING: Final = 1e-3
_REJECTED_DAMPING: Final = 1.0
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
        first = cluster.count.cumsum() - cluster.count
        cos = np.cos(cluster.bearing)
        sin = np.sin(cluster.bearing)
        return cls(
            u=np.array([cos, sin]),
            u_turned=np.array([sin, -cos]),
            range=cluster.range,
            count=cluster.count,
            first=first,
            edges=_edges(scan, cluster, first),
            noise=max(scan.noise, MIN_NOISE),
        )

    def take(self, rows: np.ndarray) -> PlateBeams:
        """Select the data of the scans `rows` (R,), in that order, possibly repeated."""
        count = self.count[rows]
        places = places_of(self.count, rows)
        return PlateBeams(
            u=self.u.take(places, axis=1),
            u_turned=self.u_turned.take(places, axis=1),
            range=self.range[places],
            count=count,
            first=count.cumsum() - count,
            edges=self.edges.take(rows),
            noise=self.noise,
        )

    def thinned(self, most: int) -> PlateBeams:
        """Keep every n-th return of each scan, so that `most` to 2 `most` are left, or all if there
        are no more, and both edges.
        """
        stride = np.maximum(1, self.count // most)  # of each scan
        number_in_scan = np.arange(len(self.range)) - self.spread(self.first)
        is_kept = number_in_scan % self.spread(stride) == 0
        kept = np.flatnonzero(is_kept)
        count = np.ceil(self.count / stride).astype(int)
        return PlateBeams(
            u=self.u.take(kept, axis=1),
            u_turned=self.u_turned.take(kept, axis=1),
            range=self.range[kept],
            count=count,
            first=count.cumsum() - count,
            edges=self.edges,
            noise=self.noise,
        )

    def spread(self, of_scans: Array) -> Array:
        """Repeat values (..., M) of the scans for each of their returns: (..., H)."""
        return of_scans.repeat(self.count, axis=-1)

    def sums(self, of_returns: Array) -> Array:
        """Sum values (..., H) of the returns in each scan: (..., M)."""
        return np.add.reduceat(of_returns, self.first, axis=-1)


def _edges(scan: Scan, cluster: Cluster, first: np.ndarray) -> Edges:
    """Edges of the silhouettes in M clusters whose returns begin at the indices `first` (M,).

    Right and left are on the first axis of the arrays below, (2, M).
    """
    step = scan.beam_step
    last = first + cluster.count - 1
    low = cluster.bearing[first]
    high = cluster.bearing[last]
    middle = (low + high) / 2

    # beams missing beyond the cluster: their expected number and its standard deviation follow
    # from the share of missing beams inside it
    lost_share = np.maximum(cluster.lost / (cluster.lost + cluster.count), scan.dropout)
    missing = lost_share / (1 - lost_share)
    spread = step * np.sqrt(1 / 12 + missing / (1 - lost_share))

    # a hidden edge may be anywhere behind the object in front
    hidden = cluster.hidden.T
    is_limited = np.isfinite(hidden)
    slack = np.where(is_limited, hidden, 0.0) / 2
    from_middle = (high - low) / 2 + (0.5 + missing) * step + slack

    # the edges of the field of view and of the scanner's reach aren't edges of the plate
    farthest = np.maximum.reduceat(cluster.range, first)
    is_in_reach = farthest < scan.max_range - _MAX_RANGE_MARGIN
    is_in_view = np.array([low > scan.bearings[0] + step / 4, high < scan.bearings[-1] - step / 4])
    is_edge = is_limited & is_in_reach & is_in_view
    weight = np.where(is_edge, 1 / spread, 0.0)
    return Edges(
        ahead=np.exp(1j * middle),
        bearing=(from_middle * _EDGE_SIGNS).T,
        weight=weight.T,
        slack=slack.T,
    )


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
        centre = pose[:, 0] + 1j * pose[:, 1]
        return cls(plate, place=centre * axis.conj(), axis=axis)

    def silhouette(self, ahead: Points) -> Array:
        """Bearings of the outermost corners, right and left, and their derivatives, (4, 2, M).

        The bearings are relative to the directions `ahead` (M,), so they do not wrap [rad]. The
        derivatives are with respect to the position along and across the plate's axes and to the
        heading.

        In the plate's axes, a corner is at z = c + k from the LRF, with the centre c of the plate
        and k from there to the corner. Its bearing is the imaginary part of log(z exp(i phi)). So
        it changes by Im(dc / z) with c, which is Im(1 / z) along and Re(1 / z) across the plate. As
        the plate turns about its centre, z changes by i k, and the bearing by Im(i k / z) =
        Re(k / z).
        """
        half = complex(self.plate.length, self.plate.thickness) / 2
        from_centre = np.array([[half], [half.conjugate()], [-half], [-half.conjugate()]])
        corners = from_centre + self.place + _MIN_CORNER_DISTANCE  # (4, M)
        bearing = np.angle(corners * (self.axis * ahead.conj()))

        outermost = np.array([bearing.argmin(axis=0), bearing.argmax(axis=0)])  # (2, M)
        views = np.arange(len(ahead))
        inverse = 1 / corners[outermost, views]
        by_heading = (inverse * from_centre[outermost, 0]).real
        return np.array([bearing[outermost, views], inverse.imag, inverse.real, by_heading])


def viewing_angle(pose: Array) -> Array:
    """Angles (S,) [rad] between the line of sight and plates at poses (S, 3) in the LRF's frame; 0
    is edge-on.
    """
    sight = np.arctan2(pose[:, 1], pose[:, 0])
    from_sight = pose[:, 2] - sight
    return np.abs((from_sight + np.pi / 2) % np.pi - np.pi / 2)


def in_axes(heading: Array) -> Array:
    """Matrices (M, 3, 3) that convert changes of (x, y, phi) into changes along and across plates
    at `heading` (M,).
    """
    cos = np.cos(heading)
    sin = np.sin(heading)
    axes = np.zeros((len(heading), 3, 3))
    # along the plate
    axes[:, 0, 0] = cos
    axes[:, 0, 1] = sin
    # across the plate
    axes[:, 1, 0] = -sin
    axes[:, 1, 1] = cos
    # the heading
    axes[:, 2, 2] = 1.0
    return axes


def in_lrf_axes(covariance: Array, heading: Array) -> Array:
    """Covariances (M, 3, 3) of (x, y, phi) from those along and across plates at `heading` (M,)."""
    axes = in_axes(heading)
    return np.asarray(axes.swapaxes(1, 2) @ covariance @ axes)


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
        heading = self.pose[:, 2]
        back = in_axes(heading).swapaxes(1, 2)
        return Evaluation(
            pose=self.pose,
            cost=self.cost,
            gradient=(back @ self.gradient[..., None])[..., 0],
            hessian=in_lrf_axes(self.hessian, heading),
        )

    def newton(self, damping: Array) -> tuple[Array, Array]:
        """Poses (M, 3) after Newton steps with `damping` (M,), and the predicted cost decreases
        (M,).

        With the gradient g and the damped Hessian H, a step is s = -H^-1 g, and it lowers the cost
        g s + s H s / 2 by -g s / 2.
        """
        damped = _regular(self.hessian, damping)
        step = np.linalg.solve(damped, -self.gradient[..., None])[..., 0]
        decrease = (step * self.gradient).sum(axis=1) / -2
        moved = self.pose + step
        # the step is along and across the plate
        moved[:, :2] = self.pose[:, :2] + se2.rotate(self.pose[:, 2], step[:, :2])
        return moved, decrease

    def covariances(self) -> Array:
        """Inverses (M, 3, 3) of the Hessians, with variance UNKNOWN in directions that a scan does
        not determine.
        """
        return np.linalg.inv(_regular(self.hessian, np.zeros(len(self.cost))))


def _regular(hessian: Array, damping: Array) -> Array:
    """The Hessians (M, 3, 3) with damping (M,) and a prior whose variances are UNKNOWN."""
    regular = hessian.copy()
    diagonal = np.einsum("mkk->mk", regular)  # a view
    diagonal *= 1 + damping[:, None]
    diagonal += 1 / UNKNOWN
    return regular


@dataclass(frozen=True)
class _Ranges:
    """Residuals of H ranges, and factors of their derivatives."""

    residual: Array  # (H,) [standard deviations]
    on_long: np.ndarray  # (H,) whether the beam hits the long face, not the short one
    # (H,) derivatives of the residuals by the position of the face [standard deviations / m]
    slope: Array
    # (H,) movement of the face at the beam as the plate turns [m/rad]
    lever: Array


@dataclass(frozen=True)
class PlateLikelihood:
    """Negative log likelihood of the poses of a plate, with its derivatives and minima."""

    plate: Plate
    huber: float  # residual above which the loss of a range is linear [standard deviations]

    def evaluate(self, beams: PlateBeams, pose: Array) -> Evaluation:
        """Compute cost, gradient and Gauss-Newton Hessian at poses (M, 3).

        With the weights w of the Huber loss, the ranges' residuals r with the Jacobian J, and the
        edges' residuals e with the Jacobian E, the gradient is J' w r + E' e, and the Hessian
        J' w J + E' E.
        """
        view = View.of(self.plate, pose)

        # sums over the returns of each scan, all at once
        ranges = self._ranges(beams, view)
        residual = ranges.residual
        weight, cost = self.loss(residual)
        by_along = np.where(ranges.on_long, 0.0, ranges.slope)
        by_across = np.where(ranges.on_long, ranges.slope, 0.0)
        jacobian = np.array([by_along, by_across, ranges.lever * ranges.slope])  # (3, H)
        weighted = weight * jacobian
        products = weighted[_ROW] * jacobian[_COLUMN]  # (6, H)
        sums = beams.sums(np.concatenate([cost[None], weighted * residual, products]))

        # and the two edges
        edges = self.edges(beams.edges, view)  # (4, 2, M)
        missed = edges[0]
        by_edges = edges[1:]
        total = sums[0] + (missed**2).sum(axis=0) / 2
        gradient = sums[1:4] + (by_edges * missed).sum(axis=1)
        elements = sums[4:] + (by_edges[_ROW] * by_edges[_COLUMN]).sum(axis=1)
        hessian = elements[_SYMMETRIC].transpose(2, 0, 1)
        return Evaluation(pose, total, gradient.T, hessian)

    def misfit(self, beams: PlateBeams, pose: Array) -> Array:
        """Root mean square residuals (M,) of the ranges at poses (M, 3) [standard deviations]."""
        residual = self._ranges(beams, View.of(self.plate, pose)).residual
        return np.sqrt(beams.sums(residual * residual) / beams.count)

    def climb(self, beams: PlateBeams, pose: Array, iterations: int) -> Evaluation:
        """Minimise the cost from poses (M, 3) in the LRF's frame, by damped Gauss-Newton steps
        (Levenberg).

        A step that raises the cost has crossed a kink, where beams leave a face of the plate, and
        is rejected. A row whose next step would gain almost nothing takes that step and stops,
        independently of the other rows.
        """
        fit = self.evaluate(beams, pose.copy())
        climbing = np.arange(len(pose))
        damping = np.full(len(pose), _FIRST_DAMPING)
        for _ in range(iterations):
            target, decrease = fit.take(climbing).newton(damping[climbing])
            goes_on = decrease >= _CONVERGED

            # last steps are taken without another evaluation, unless the step before was rejected
            is_last = ~goes_on & (damping[climbing] < _REJECTED_DAMPING)
            fit.pose[climbing[is_last]] = target[is_last]
            fit.cost[climbing[is_last]] -= decrease[is_last]
            if not goes_on.any():
                break
            if not goes_on.all():
                climbing = climbing[goes_on]
                beams = beams.take(np.flatnonzero(goes_on))
                target = target[goes_on]

            trial = self.evaluate(beams, target)
            is_better = trial.cost < fit.cost[climbing]
            fit.put(climbing[is_better], trial.take(is_better))
            before = damping[climbing]
            after_rejection = np.maximum(10 * before, _REJECTED_DAMPING)
            damping[climbing] = np.where(is_better, before / 10, after_rejection)
        return fit

    def loss(self, residual: Array) -> tuple[Array, Array]:
        """Weights (...) and costs (...) of residuals (...) [standard deviations] under the Huber
        loss.
        """
        size = np.abs(residual)
        weight = self.huber / np.maximum(size, self.huber)
        weighted = weight * size
        return weight, weighted * (size - weighted / 2)

    def _ranges(self, beams: PlateBeams, view: View) -> _Ranges:
        """Residuals of the ranges, and the factors of their derivatives.

        In the plate's axes, the LRF is at -p, and a beam has the direction u. The face towards the
        LRF of each pair is in a plane at the signed distance d, along one axis, so that the beam
        meets it at the range d / u of that axis. It enters the plate where it meets the second of
        both planes, at the longer range. Where it misses the plate, this is limited to the ranges
        at which the plate can be.

        The range changes by 1 / u with p along that axis. As the plate turns about its centre, the
        face at the beam moves by the place on the face, counted from the plate's centre.
        """
        # values of the scans, spread over their returns in one array, which is faster
        half = np.array([[self.plate.length], [self.plate.thickness]]) / 2
        radius = math.hypot(self.plate.length, self.plate.thickness) / 2
        centre_distance = np.abs(view.place)
        of_scans = np.empty((10, len(view.place)))
        of_scans[0] = view.axis.real
        of_scans[1] = view.axis.imag
        place = of_scans[2:4]  # along and across, like the pairs of rows below
        place[0] = view.place.real
        place[1] = view.place.imag
        # the planes' distances d; 0 if neither face of a pair is towards the LRF
        np.subtract(place, np.minimum(np.maximum(place, -half), half), out=of_scans[4:6])
        np.copysign(_MIN_DIVISOR, place, out=of_scans[6:8])
        np.maximum(centre_distance - radius, _MIN_DIVISOR, out=of_scans[8])
        np.add(centre_distance, radius, out=of_scans[9])
        spread = beams.spread(of_scans)
        cos = spread[0]
        sin = spread[1]
        place_of_beams = spread[2:4]
        plane_distance = spread[4:6]
        tiny = spread[6:8]
        nearest = spread[8]
        farthest = spread[9]

        # ranges to both planes, negative where the beam does not enter the half-plane behind it
        u = beams.u * cos + beams.u_turned * sin
        per_distance: Array = 1 / (u - tiny)
        to_short, to_long = plane_distance * per_distance
        on_long = to_long > to_short
        entered = np.maximum(to_short, to_long)
        predicted = np.minimum(np.maximum(entered, nearest), farthest)

        # in standard deviations; a limited range doesn't depend on the pose
        scale = 1 / beams.noise
        residual = (predicted - beams.range) * scale
        slope = np.where(on_long, per_distance[1], per_distance[0])
        slope *= (predicted == entered) * scale
        along, across = predicted * u - place_of_beams  # where the beams end, from the centre
        return _Ranges(residual, on_long, slope, lever=np.where(on_long, along, -across))

    def edges(self, edges: Edges, view: View) -> Array:
        """Residuals of the silhouette's two edges, followed by their three derivatives, (4, 2,
        M).
        """
        silhouette = view.silhouette(edges.ahead)
        slack = edges.slack.T
        off = silhouette[0] - edges.bearing.T
        missed = off - off.clip(-slack, slack)
        values = np.array([missed, *silhouette[1:]])
        # an edge within its slack costs nothing
        counts = (slack == 0) | (missed != 0)
        return values * np.where(counts, edges.weight.T, 0.0)
