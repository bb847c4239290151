"""Maximum likelihood of the known rectangle on the ranges of a scan.

A beam with direction u meets a face whose plane is m.p = h at range h / (m.u). Two faces at most are turned to the LRF,
one long and one short; together they are a wedge, and a beam meets it where it enters the second of the two
half-planes. The likelihood has two parts:

- every return's range, with the scanner's noise, under a Huber loss;
- the two edges of the silhouette: the plate's outermost corners lie somewhere between the last beam that missed it and
  the first that hit it, uniformly, so the middle of that gap measures the corner's bearing with variance step^2 / 12.
  Without them nothing would hold the plate along its own direction when it is seen broadside on.

The likelihood has several maxima (a plate seen nearly edge-on, and its mirror image about the line of sight, look much
the same), so it is climbed from several starts at once, by Levenberg-Marquardt over all scans and starts together.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.base import PoseEstimate
from trackslip.localization.line import fit_line
from trackslip.scan import Cluster, Plate, Scan, extract_plate

_EDGE_ON = np.radians(2.0)  # the two starts beside the line of sight
_STARTS = 4  # starts from a scan alone
_CHUNK = 20_000  # elements (starts x beams) worked on at a time, so that they stay in the cache


@dataclass(frozen=True)
class PlateLocator:
    """Fits the plate's rectangle to each scan; valid where the fit explains the returns and fixes the heading."""

    plate: Plate = field(default_factory=Plate)
    huber: float = 3.0
    """Residual beyond which a range counts linearly only [standard deviations]."""
    screening: int = 4
    """Iterations from every start, after which the best is kept."""
    iterations: int = 6
    """Iterations from the best start."""
    max_misfit: float = 3.0
    """Largest root mean square residual that is believed [standard deviations]."""
    max_heading_error: float = np.radians(6.0)
    """Largest standard error of the heading that is believed [rad]."""
    min_beams: int = 2
    """Fewest returns from the long face that tell the heading from its mirror image about the line of sight."""

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Poses of the plate in scans with ranges (S, B); see `Locator`."""
        near = None if predicted is None else scan.from_world(predicted)
        cluster = extract_plate(scan, self.plate, near)
        scans = len(cluster.count)
        pose, information, misfit = np.zeros((scans, 3)), np.zeros((scans, 3, 3)), np.full(scans, np.inf)
        beams = np.zeros(scans)
        width = cluster.width
        order = np.flatnonzero(cluster.count >= 3)
        order = order[np.argsort(width[order], kind="stable")]  # similar widths together: little padding
        while len(order):
            rows, order = np.split(order, [max(1, _CHUNK // (_STARTS * width[order[0]]))])
            fit = self._fit(scan, cluster.take(rows), None if near is None else near[rows])
            pose[rows], information[rows], misfit[rows] = fit.pose, fit.hessian, fit.misfit
            beams[rows] = fit.beams
        covariance, regular = _inverse(information)
        valid = (
            regular
            & (beams >= self.min_beams)
            & (misfit < self.max_misfit)
            & (covariance[:, 2, 2] < self.max_heading_error**2)
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

    def _climb(self, view: _View, pose: Array, iterations: int) -> _Fit:
        """Levenberg-Marquardt from poses (M, 3) in the LRF's frame."""
        fit = self._evaluate(view, pose)
        damping = np.full(len(pose), 1e-3)
        for _ in range(iterations):
            damped = fit.hessian + damping[:, None, None] * fit.hessian * np.eye(3)
            inverse, regular = _inverse(damped)
            step = -np.einsum("mij,mj->mi", inverse, fit.gradient)
            trial = self._evaluate(view, fit.pose + np.where(regular[:, None], step, 0.0))
            better = trial.cost < fit.cost
            fit = _Fit(
                *(
                    np.where(better.reshape(-1, *[1] * (old.ndim - 1)), new, old)
                    for old, new in zip(fit.arrays(), trial.arrays(), strict=True)
                )
            )
            damping = np.where(better, damping / 10, damping * 10)
        return fit

    def _evaluate(self, view: _View, pose: Array) -> _Fit:
        """Cost, gradient and Gauss-Newton Hessian at poses (M, 3)."""
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
        beams = np.sum(on_long & on_plate & view.hit, axis=1)
        return _Fit(pose, cost, gradient, hessian, misfit, beams)

    def _edges(self, view: _View, centre: Array, e: Array, n: Array) -> tuple[Array, Array]:
        """Residuals (M, 2) of the silhouette's two edges and their Jacobian (M, 2, 3)."""
        signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) / 2
        offset = (
            self.plate.length * signs[:, 0, None] * e[:, None, :]
            + self.plate.thickness * signs[:, 1, None] * n[:, None, :]
        )  # (M, 4, 2)
        corner = centre[:, None, :] + offset
        bearing = np.arctan2(corner[..., 1], corner[..., 0])  # the LRF looks forwards: no wrap at +-pi
        outermost = np.stack([np.argmin(bearing, axis=1), np.argmax(bearing, axis=1)], axis=1)  # (M, 2)
        rows = np.arange(len(centre))[:, None]
        x, y = np.moveaxis(corner[rows, outermost], -1, 0)
        d_x, d_y = np.moveaxis(offset[rows, outermost], -1, 0)
        square = np.maximum(x**2 + y**2, 1e-12)
        jacobian = np.stack([-y, x, x * d_x + y * d_y], axis=-1) / square[..., None]
        residual = bearing[rows, outermost] - view.edges
        return residual / view.edge_noise, jacobian / view.edge_noise


@dataclass(frozen=True)
class _View:
    """What is measured of the plate in M scans."""

    u_x: Array  # (M, W) directions of the beams
    u_y: Array  # (M, W)
    range: Array  # (M, W) [m]
    hit: np.ndarray  # (M, W) bool
    edges: Array  # (M, 2) bearings of the silhouette's edges [rad]
    noise: float  # of a range [m]
    edge_noise: float  # of an edge's bearing [rad]

    @classmethod
    def of(cls, scan: Scan, cluster: Cluster) -> _View:
        """What a scan shows of each cluster."""
        low = np.min(cluster.bearing, axis=1, where=cluster.hit, initial=np.inf)
        high = np.max(cluster.bearing, axis=1, where=cluster.hit, initial=-np.inf)
        step = scan.beam_step
        edges = np.stack([low - step / 2, high + step / 2], axis=1)
        noise = max(scan.noise, 1e-4)  # a perfect scanner still needs a scale
        u_x, u_y = np.cos(cluster.bearing), np.sin(cluster.bearing)
        return cls(u_x, u_y, cluster.range, cluster.hit, edges, noise, step / np.sqrt(12))

    def take(self, rows: np.ndarray) -> _View:
        """The scans `rows`, in that order, repeated where asked."""
        return _View(
            self.u_x[rows],
            self.u_y[rows],
            self.range[rows],
            self.hit[rows],
            self.edges[rows],
            self.noise,
            self.edge_noise,
        )


@dataclass(frozen=True)
class _Fit:
    """A point on the climb."""

    pose: Array  # (M, 3) in the LRF's frame
    cost: Array  # (M,) minus log likelihood
    gradient: Array  # (M, 3)
    hessian: Array  # (M, 3, 3)
    misfit: Array  # (M,) rms residual of the ranges [standard deviations]
    beams: Array  # (M,) number of returns from the long face

    def arrays(self) -> tuple[Array, ...]:
        return self.pose, self.cost, self.gradient, self.hessian, self.misfit, self.beams


def _range_to(face: Array, m_u: Array) -> Array:
    """Range (M, W) at which beams enter the half-plane behind a face m.p = h (M,); -inf where they don't."""
    entering = (face[:, None] * m_u) > 0
    return np.where(entering, face[:, None] / np.where(entering, m_u, 1.0), -np.inf)


def _starts(cluster: Cluster, plate: Plate, near: Array | None) -> Array:
    """Poses (S, K, 3) to climb from: the line's heading, its mirror image, both sides of edge-on, the expected pose."""
    line = fit_line(cluster)
    x = cluster.range * np.cos(cluster.bearing)
    y = cluster.range * np.sin(cluster.bearing)
    sight = np.arctan2(line.middle[:, 1], line.middle[:, 0])
    headings = [line.heading, 2 * sight - line.heading, sight + _EDGE_ON, sight - _EDGE_ON]
    if near is not None:
        headings.append(near[:, 2])
    starts = [_place(x, y, cluster.hit, heading, line.middle, plate) for heading in headings]
    if near is not None:
        starts.append(near)
    return np.stack(starts, axis=1)


def _place(x: Array, y: Array, hit: np.ndarray, heading: Array, middle: Array, plate: Plate) -> Array:
    """Poses (S, 3) of plates with `heading` (S,) whose nearer faces touch the points (S, W)."""
    e = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    n = np.stack([-e[:, 1], e[:, 0]], axis=-1)
    centre = np.zeros((len(heading), 2))
    for axis, size in ((e, plate.length), (n, plate.thickness)):
        coordinate = x * axis[:, :1] + y * axis[:, 1:]
        low = np.min(coordinate, axis=1, where=hit, initial=np.inf)
        high = np.max(coordinate, axis=1, where=hit, initial=-np.inf)
        away = np.sum(axis * middle, axis=1) > 0  # the LRF is on the low side
        anchored = np.where(away, low + size / 2, high - size / 2)
        spanned = (low + high) / 2
        place = np.where(high - low > 0.8 * size, spanned, anchored)
        centre += place[:, None] * axis
    return np.concatenate([centre, heading[:, None]], axis=-1)


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
