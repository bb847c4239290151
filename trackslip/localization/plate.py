"""Maximum likelihood of the known rectangle on the ranges of a scan (see `likelihood`).

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
from trackslip.localization.likelihood import Fit, PlateLikelihood, View, inverses
from trackslip.localization.line import fit_line
from trackslip.scan import Cluster, Plate, Scan, extract_plate

_BESIDE = np.radians(2.0)  # the two starts beside the line of sight
_EDGE_ON = np.radians(3.0)  # nearer to the line of sight than this, the heading is integrated
_GRID = np.radians(np.linspace(-5.0, 5.0, 81))  # headings of that integral, from the line of sight
_STARTS = 6  # at most, with an expected pose
_CHUNK = 20_000  # elements (starts x beams) worked on at a time, so that they stay in the cache
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
        for rows in _chunks(cluster, _STARTS):
            part = cluster.take(rows)
            fit = self._fit(scan, part, None if near is None else near[rows])
            pose[rows], misfit[rows] = fit.pose, fit.misfit
            inverse, regular = inverses(fit.hessian)
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

    def _fit(self, scan: Scan, cluster: Cluster, near: Array | None) -> Fit:
        """The best fit to each cluster."""
        starts = _starts(cluster, self.plate, near)  # (S, K, 3)
        scans, k, _ = starts.shape
        view = View.of(scan, cluster)
        screened = self._climb(view.take(np.repeat(np.arange(scans), k)), starts.reshape(-1, 3), self.screening)
        best = np.argmin(screened.cost.reshape(scans, k), axis=1) + k * np.arange(scans)
        return self._climb(view, screened.pose[best], self.iterations)

    def _integrate(self, scan: Scan, cluster: Cluster, sight: Array) -> tuple[Array, Array]:
        """Posterior means (S, 3) and covariances (S, 3, 3) for plates seen nearly edge-on at bearings `sight` (S,)."""
        scans, k = len(sight), len(_GRID)
        every = np.repeat(np.arange(scans), k)
        heading = (sight[:, None] + _GRID).ravel()  # (S * K,)
        starts = _place(cluster.take(every), heading, fit_line(cluster).middle[every], self.plate)
        fit = self._climb(View.of(scan, cluster).take(every), starts, self.screening, turn=False)
        cost = fit.cost.reshape(scans, k)
        weight = np.exp(cost.min(axis=1, keepdims=True) - cost)
        weight /= weight.sum(axis=1, keepdims=True)
        pose = fit.pose.reshape(scans, k, 3)
        mean = np.sum(weight[..., None] * pose, axis=1)
        away = pose - mean[:, None]
        given_heading, regular = inverses(fit.hessian)
        given_heading[:, 2, 2] = (_GRID[1] - _GRID[0]) ** 2 / 12  # of the grid: a fixed heading has no hessian
        within = np.where(regular[:, None, None], given_heading, _UNKNOWN).reshape(scans, k, 3, 3)
        total = within + away[..., :, None] * away[..., None, :]
        return mean, np.sum(np.where(weight[..., None, None] > 1e-9, weight[..., None, None] * total, 0.0), axis=1)

    def _climb(self, view: View, pose: Array, iterations: int, turn: bool = True) -> Fit:
        """Levenberg-Marquardt from poses (M, 3) in the LRF's frame; without `turn` the heading stays as it is.

        A row that has converged is left alone, whatever the others do, so that each row's bits are its own.
        """
        likelihood = PlateLikelihood(self.plate, self.huber)
        fit = likelihood.evaluate(view, pose, turn)
        damping = np.full(len(pose), 1e-3)
        climbing = np.ones(len(pose), bool)
        for _ in range(iterations):
            damped = fit.hessian + damping[:, None, None] * fit.hessian * np.eye(3)
            inverse, regular = inverses(damped)
            step = -np.einsum("mij,mj->mi", inverse, fit.gradient)
            trial = likelihood.evaluate(view, fit.pose + np.where(regular[:, None], step, 0.0), turn)
            fall = fit.cost - trial.cost
            better = climbing & (fall > 0)
            fit = fit.replaced(better, trial)
            climbing &= ~better | (fall > _CONVERGED)
            damping = np.where(better, damping / 10, damping * 10)
            if not climbing.any():
                break
        return fit


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
