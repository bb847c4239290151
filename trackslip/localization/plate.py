"""Maximum likelihood of the known rectangle on the ranges of a scan.

A beam with direction u meets a face whose plane is m.p = h at range h / (m.u). Two faces at most are turned to the LRF,
one long and one short; together they are a wedge, and a beam meets it where it enters the second of the two
half-planes. The likelihood has two parts:

- every return's range, with the scanner's noise, under a Huber loss;
- the two edges of the silhouette: the plate's outermost corners lie somewhere between the last beam that missed it and
  the first that hit it, uniformly, so the middle of that gap measures the corner's bearing with variance step^2 / 12.
  Without them nothing would hold the plate along its own direction when it is seen broadside on. An edge of the field
  of view, or of the scanner's reach, is no edge of the plate and measures nothing; and where beams inside the cluster
  are missing, at a rate p, beams beyond its last return may be too, p / (1 - p) of them with variance p / (1 - p)^2.

The likelihood has several maxima (a plate seen nearly edge-on, and its mirror image about the line of sight, look much
the same), so it is climbed from several starts at once, by Levenberg-Marquardt over all scans and starts together.
Within a few degrees of edge-on the heading's likelihood is no bell at all. There it is integrated over a grid of
headings, the position being fitted at each, and pose and covariance are the posterior's mean and covariance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.base import PoseEstimate
from trackslip.localization.line import fit_line
from trackslip.scan import Cluster, Plate, Scan, extract_plate

_BESIDE = np.radians(2.0)  # the two starts beside the line of sight
_EDGE_ON = np.radians(3.0)  # nearer to the line of sight than this, the heading is integrated
_GRID = np.radians(np.linspace(-5.0, 5.0, 81))  # headings of that integral, from the line of sight
_CHUNK = 20_000  # elements (starts x beams) worked on at a time, so that they stay in the cache
_MARGIN = 0.1  # returns this near to the scanner's reach may be cut off by it [m]
_LEAST_NOISE = 0.5e-3  # what a perfect scanner is taken to have, for the plate is never a perfect rectangle [m]
_UNKNOWN = 1e6  # variance of what a scan says nothing about
_CONVERGED = 1e-7  # a smaller fall of the cost ends a climb


@dataclass(frozen=True)
class PlateLocator:
    """Fits the plate's rectangle to each scan; valid where the fit explains the returns and fixes the heading."""

    plate: Plate = field(default_factory=Plate)
    huber: float = 3.0
    """Residual beyond which a range counts linearly only [standard deviations]."""
    screening: int = 4
    """Iterations from every start, after which the best is kept."""
    iterations: int = 8
    """Most iterations from the best start."""
    max_misfit: float = 3.0
    """Largest root mean square residual that is believed [standard deviations]."""
    max_heading_error: float = np.radians(3.0)
    """Largest standard error of the heading that is believed [rad]."""
    max_position_error: float = 0.05
    """Largest standard error of the position that is believed [m]."""

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Poses of the plate in scans with ranges (S, B); see `Locator`."""
        near = None if predicted is None else scan.from_world(predicted)
        cluster = extract_plate(scan, self.plate, near)
        scans = len(cluster.count)
        pose, covariance, misfit = np.zeros((scans, 3)), np.full((scans, 3, 3), _UNKNOWN), np.full(scans, np.inf)
        for rows in _chunks(cluster, 6):
            part = cluster.take(rows)
            fit = self._fit(scan, part, None if near is None else near[rows])
            pose[rows], misfit[rows] = fit.pose, fit.misfit
            inverse, regular = _inverse(fit.hessian)
            covariance[rows] = np.where(regular[:, None, None], inverse, _UNKNOWN)
        sight = np.arctan2(pose[:, 1], pose[:, 0])
        edge_on = (np.abs(_half_turn(pose[:, 2] - sight)) < _EDGE_ON) & (misfit < self.max_misfit)
        for rows in _chunks(cluster, len(_GRID), edge_on):
            pose[rows], covariance[rows] = self._integrate(scan, cluster.take(rows), sight[rows])
        variance = np.einsum("sii->si", covariance)
        valid = (
            (misfit < self.max_misfit)
            & (variance[:, :2].max(axis=1) < self.max_position_error**2)
            & (variance[:, 2] < self.max_heading_error**2)
        )
        covariance[~valid] = np.nan
        return PoseEstimate(scan.to_world(pose), scan.covariance_to_world(covariance), valid)

    def _fit(self, scan: Scan, cluster: Cluster, near: Array | None) -> _Fit:
        """The best fit to each cluster."""
        starts = _starts(cluster, self.plate, near)  # (S, K, 3)
        scans, k, _ = starts.shape
        view = _View.of(scan, cluster)
        screened = self._climb(view.take(np.repeat(np.arange(scans), k)), starts.reshape(-1, 3), self.screening)
        best = np.argmin(screened.cost.reshape(scans, k), axis=1) + k * np.arange(scans)
        return self._climb(view, screened.pose[best], self.iterations)

    def _integrate(self, scan: Scan, cluster: Cluster, sight: Array) -> tuple[Array, Array]:
        """Posterior means (S, 3) and covariances (S, 3, 3) for plates seen nearly edge-on at bearings `sight` (S,)."""
        scans, k = len(sight), len(_GRID)
        heading = sight[:, None] + _GRID  # (S, K)
        middle = fit_line(cluster).middle
        starts = np.stack([_place(cluster, heading[:, j], middle, self.plate) for j in range(k)], axis=1)
        view = _View.of(scan, cluster).take(np.repeat(np.arange(scans), k))
        fit = self._climb(view, starts.reshape(-1, 3), self.screening, turn=False)
        cost = fit.cost.reshape(scans, k)
        weight = np.exp(cost.min(axis=1, keepdims=True) - cost)
        weight /= weight.sum(axis=1, keepdims=True)
        pose = fit.pose.reshape(scans, k, 3)
        mean = np.sum(weight[..., None] * pose, axis=1)
        away = pose - mean[:, None]
        given_heading, regular = _inverse(fit.hessian)
        given_heading[:, 2, 2] = (
            _GRID[1] - _GRID[0]
        ) ** 2 / 12  # of the grid; the hessian has none for a fixed heading
        within = np.where(regular[:, None, None], given_heading, _UNKNOWN).reshape(scans, k, 3, 3)
        total = within + away[..., :, None] * away[..., None, :]
        return mean, np.sum(np.where(weight[..., None, None] > 1e-9, weight[..., None, None] * total, 0.0), axis=1)

    def _climb(self, view: _View, pose: Array, iterations: int, turn: bool = True) -> _Fit:
        """Levenberg-Marquardt from poses (M, 3) in the LRF's frame; without `turn` the heading stays as it is.

        A row that has converged is left alone, whatever the others do, so that each row's bits are its own.
        """
        fit = self._evaluate(view, pose, turn)
        damping = np.full(len(pose), 1e-3)
        climbing = np.ones(len(pose), bool)
        for _ in range(iterations):
            damped = fit.hessian + damping[:, None, None] * fit.hessian * np.eye(3)
            inverse, regular = _inverse(damped)
            step = -np.einsum("mij,mj->mi", inverse, fit.gradient)
            trial = self._evaluate(view, fit.pose + np.where(regular[:, None], step, 0.0), turn)
            fall = fit.cost - trial.cost
            better = climbing & (fall > 0)
            fit = fit.replaced(better, trial)
            climbing &= ~better | (fall > _CONVERGED)
            damping = np.where(better, damping / 10, damping * 10)
            if not climbing.any():
                break
        return fit

    def _evaluate(self, view: _View, pose: Array, turn: bool) -> _Fit:
        """Cost, gradient and Gauss-Newton Hessian at poses (M, 3); without `turn` as if the heading were known."""
        centre, phi = pose[:, :2], pose[:, 2]
        e = np.stack([np.cos(phi), np.sin(phi)], axis=-1)  # along the plate
        n = np.stack([-e[:, 1], e[:, 0]], axis=-1)  # across it
        along, across = np.sum(e * centre, axis=1), np.sum(n * centre, axis=1)
        u_e = e[:, :1] * view.u_x + e[:, 1:] * view.u_y  # (M, W)
        u_n = n[:, :1] * view.u_x + n[:, 1:] * view.u_y

        # range to the long and to the short face, whichever is turned to the LRF; -inf for one that isn't entered
        half_length, half_thickness = self.plate.length / 2, self.plate.thickness / 2
        long_face = np.where(np.abs(across) > half_thickness, across - np.sign(across) * half_thickness, 0.0)
        short_face = np.where(np.abs(along) > half_length, along - np.sign(along) * half_length, 0.0)
        to_long, to_short = _range_to(long_face, u_n), _range_to(short_face, u_e)
        on_long = to_long > to_short
        predicted = np.where(on_long, to_long, to_short)
        distance = np.hypot(centre[:, 0], centre[:, 1])
        reach = np.hypot(half_length, half_thickness)
        low, high = (distance - reach)[:, None], (distance + reach)[:, None]
        on_plate = (predicted > low) & (predicted < high)
        predicted = np.where(on_plate, predicted, np.where(predicted > low, high, low))

        residual = np.where(view.hit, (predicted - view.range) / view.noise, 0.0)
        size = np.abs(residual)
        weight = np.minimum(1.0, self.huber / np.maximum(size, 1e-12))
        cost = np.sum(np.where(size < self.huber, residual**2 / 2, self.huber * (size - self.huber / 2)), axis=1)

        # dr/dcentre = m / (m.u); dr/dphi = how far along the face the beam hits, over m.u
        m_u = np.where(on_long, u_n, u_e)
        slope = np.where(on_plate & view.hit, 1.0 / (np.where(m_u == 0, 1.0, m_u) * view.noise), 0.0)
        lever = np.where(on_long, predicted * u_e - along[:, None], across[:, None] - predicted * u_n) * slope
        in_long, in_short = np.where(on_long, slope, 0.0), np.where(on_long, 0.0, slope)
        d_x = n[:, :1] * in_long + e[:, :1] * in_short
        d_y = n[:, 1:] * in_long + e[:, 1:] * in_short
        jacobian = np.stack([d_x, d_y, lever], axis=1)  # (M, 3, W)
        weighted = jacobian * weight[:, None, :]
        gradient = np.einsum("miw,mw->mi", weighted, residual)
        hessian = weighted @ jacobian.swapaxes(1, 2)

        edge_residual, edge_jacobian = self._edges(view, centre, e, n)
        cost += np.sum(edge_residual**2, axis=1) / 2
        gradient += np.einsum("mei,me->mi", edge_jacobian, edge_residual)
        hessian += edge_jacobian.swapaxes(1, 2) @ edge_jacobian
        misfit = np.sqrt(np.sum(residual**2, axis=1) / np.maximum(view.hit.sum(axis=1), 1))
        if not turn:
            gradient[:, 2] = 0.0
            hessian[:, 2, :] = hessian[:, :, 2] = 0.0
            hessian[:, 2, 2] = 1.0
        return _Fit(pose, cost, gradient, hessian, misfit)

    def _edges(self, view: _View, centre: Array, e: Array, n: Array) -> tuple[Array, Array]:
        """Residuals (M, 2) of the silhouette's two edges and their Jacobian (M, 2, 3)."""
        signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) / 2
        offset = (
            self.plate.length * signs[:, 0, None] * e[:, None, :]
            + self.plate.thickness * signs[:, 1, None] * n[:, None, :]
        )  # (M, 4, 2)
        corner = centre[:, None, :] + offset
        cos, sin = np.cos(view.middle)[:, None], np.sin(view.middle)[:, None]  # bearings from the middle: no wrap there
        bearing = np.arctan2(cos * corner[..., 1] - sin * corner[..., 0], cos * corner[..., 0] + sin * corner[..., 1])
        outermost = np.stack([np.argmin(bearing, axis=1), np.argmax(bearing, axis=1)], axis=1)  # (M, 2)
        rows = np.arange(len(centre))[:, None]
        x, y = np.moveaxis(corner[rows, outermost], -1, 0)
        d_x, d_y = np.moveaxis(offset[rows, outermost], -1, 0)
        square = np.maximum(x**2 + y**2, 1e-12)
        jacobian = np.stack([-y, x, x * d_x + y * d_y], axis=-1) / square[..., None]
        residual = bearing[rows, outermost] - view.edges
        return residual * view.edge_weight, jacobian * view.edge_weight[..., None]


@dataclass(frozen=True)
class _View:
    """What is measured of the plate in M scans."""

    u_x: Array  # (M, W) directions of the beams
    u_y: Array  # (M, W)
    range: Array  # (M, W) [m]
    hit: np.ndarray  # (M, W) bool
    middle: Array  # (M,) bearing half-way between the outermost returns [rad]
    edges: Array  # (M, 2) bearings of the silhouette's edges, from the middle [rad]
    edge_weight: Array  # (M, 2) one over their standard deviation, 0 for what is no edge [1/rad]
    noise: float  # of a range [m]

    @classmethod
    def of(cls, scan: Scan, cluster: Cluster) -> _View:
        """What a scan shows of each cluster."""
        step = scan.beam_step
        low = np.min(cluster.bearing, axis=1, where=cluster.hit, initial=np.inf)
        high = np.max(cluster.bearing, axis=1, where=cluster.hit, initial=-np.inf)
        middle = (low + high) / 2
        inside_lost = 1 - cluster.count / np.maximum(
            cluster.width, 1
        )  # beams that didn't come back, inside the cluster
        lost = np.maximum(inside_lost, scan.dropout)
        beyond = lost / (1 - lost)  # and, expected, outside
        reach = (high - low) / 2 + (0.5 + beyond) * step
        spread = step * np.sqrt(1 / 12 + beyond / (1 - lost))
        farthest = np.max(cluster.range, axis=1, where=cluster.hit, initial=0.0)
        within = farthest < scan.max_range - _MARGIN
        tolerance = step / 4
        inside = np.stack([low > scan.bearings[0] + tolerance, high < scan.bearings[-1] - tolerance], axis=1)
        weight = np.where(inside & within[:, None], 1 / spread[:, None], 0.0)
        noise = max(scan.noise, _LEAST_NOISE)
        u_x, u_y = np.cos(cluster.bearing), np.sin(cluster.bearing)
        edges = np.stack([-reach, reach], axis=1)
        return cls(u_x, u_y, cluster.range, cluster.hit, middle, edges, weight, noise)

    def take(self, rows: np.ndarray) -> _View:
        """The scans `rows`, in that order, repeated where asked."""
        return _View(
            self.u_x[rows],
            self.u_y[rows],
            self.range[rows],
            self.hit[rows],
            self.middle[rows],
            self.edges[rows],
            self.edge_weight[rows],
            self.noise,
        )


@dataclass(frozen=True)
class _Fit:
    """A point on the climb."""

    pose: Array  # (M, 3) in the LRF's frame
    cost: Array  # (M,) minus log likelihood
    gradient: Array  # (M, 3)
    hessian: Array  # (M, 3, 3)
    misfit: Array  # (M,) rms residual of the ranges [standard deviations]

    def replaced(self, rows: np.ndarray, other: _Fit) -> _Fit:
        """The same with the rows (M,) where `rows` is true taken from `other`."""
        return _Fit(
            np.where(rows[:, None], other.pose, self.pose),
            np.where(rows, other.cost, self.cost),
            np.where(rows[:, None], other.gradient, self.gradient),
            np.where(rows[:, None, None], other.hessian, self.hessian),
            np.where(rows, other.misfit, self.misfit),
        )


def _range_to(face: Array, m_u: Array) -> Array:
    """Range (M, W) at which beams enter the half-plane behind a face m.p = h (M,); -inf where they don't."""
    entering = (face[:, None] * m_u) > 0
    return np.where(entering, face[:, None] / np.where(entering, m_u, 1.0), -np.inf)


def _starts(cluster: Cluster, plate: Plate, near: Array | None) -> Array:
    """Poses (S, K, 3) to climb from: the line's heading, its mirror image, both sides of edge-on, the expected pose."""
    line = fit_line(cluster)
    sight = np.arctan2(line.middle[:, 1], line.middle[:, 0])
    headings = [line.heading, 2 * sight - line.heading, sight + _BESIDE, sight - _BESIDE]
    if near is not None:
        headings.append(near[:, 2])
    starts = [_place(cluster, heading, line.middle, plate) for heading in headings]
    if near is not None:
        starts.append(near)
    return np.stack(starts, axis=1)


def _place(cluster: Cluster, heading: Array, middle: Array, plate: Plate) -> Array:
    """Poses (S, 3) of plates with `heading` (S,) whose nearer faces touch the returns about `middle` (S, 2)."""
    x = cluster.range * np.cos(cluster.bearing)
    y = cluster.range * np.sin(cluster.bearing)
    e = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    n = np.stack([-e[:, 1], e[:, 0]], axis=-1)
    centre = np.zeros((len(heading), 2))
    for axis, size in ((e, plate.length), (n, plate.thickness)):
        coordinate = x * axis[:, :1] + y * axis[:, 1:]
        low = np.min(coordinate, axis=1, where=cluster.hit, initial=np.inf)
        high = np.max(coordinate, axis=1, where=cluster.hit, initial=-np.inf)
        away = np.sum(axis * middle, axis=1) > 0  # the LRF is on the low side
        anchored = np.where(away, low + size / 2, high - size / 2)
        spanned = (low + high) / 2
        place = np.where(high - low > 0.8 * size, spanned, anchored)
        centre += place[:, None] * axis
    return np.concatenate([centre, heading[:, None]], axis=-1)


def _chunks(cluster: Cluster, starts: int, among: np.ndarray | None = None) -> Iterator[np.ndarray]:
    """Rows of clusters with three returns or more, some at a time: all of a chunk padded to the same width.

    The width is a matter of the cluster alone, not of its neighbours, so that sums over beams round alike in any
    company.
    """
    wanted = cluster.count >= 3 if among is None else among & (cluster.count >= 3)
    padded = cluster.padded_width
    for width in np.unique(padded[wanted]):
        rows = np.flatnonzero(wanted & (padded == width))
        most = max(1, _CHUNK // (starts * int(width)))
        yield from np.split(rows, range(most, len(rows), most))


def _half_turn(angle: Array) -> Array:
    """Angles in [-pi/2, pi/2) that differ by half turns only."""
    return (angle + np.pi / 2) % np.pi - np.pi / 2


def _inverse(matrix: Array) -> tuple[Array, np.ndarray]:
    """Inverses of symmetric (M, 3, 3) matrices by cofactors, and which of them (M,) are positive definite.

    Written out because numpy's inverse takes a call into LAPACK for each matrix.
    """
    xx, xy, xz = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 0, 2]
    yy, yz, zz = matrix[:, 1, 1], matrix[:, 1, 2], matrix[:, 2, 2]
    c_xx, c_xy, c_xz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * c_xx + xy * c_xy + xz * c_xz
    regular = (determinant > 1e-12 * xx * yy * zz) & (xx > 0)
    scale = 1 / np.where(regular, determinant, 1.0)
    c_yy, c_yz, c_zz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    inverse = np.stack([c_xx, c_xy, c_xz, c_xy, c_yy, c_yz, c_xz, c_yz, c_zz], axis=-1) * scale[:, None]
    return inverse.reshape(-1, 3, 3), regular
