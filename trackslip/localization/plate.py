"""Maximum-likelihood fit of the known rectangle to the ranges of a scan (see `likelihood`).

The likelihood has several maxima (a plate seen nearly edge-on looks much like its mirror image about the line of
sight), so it is maximised from several starts, by damped Gauss-Newton steps for all scans and starts at once. If the
climb from an expected pose explains the scan as well as the noise allows, no other start is tried. Covariances follow
from the likelihood's curvature, except where it is misleading: a plate seen edge-on gives no valid pose, and one seen
from the side is located along its length only as well as the edges of its silhouette allow.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.likelihood import (
    EDGE_ON,
    UNKNOWN,
    Evaluation,
    PlateBeams,
    PlateLikelihood,
    in_axes,
    viewing_angle,
)
from trackslip.localization.line import starts
from trackslip.localization.scan import (
    FINER_GAPS,
    MAX_GAP,
    MIN_RETURNS,
    Cluster,
    Plate,
    PoseEstimate,
    Rows,
    Scan,
    best_of_each,
    candidates,
    extract_plate,
    returns_at,
)

_AT_ONCE = 2000  # most scans fitted at once, to limit memory
_HUBER = 3.0  # residual above which the loss of a range is linear [standard deviations]
_SCREENING = 4  # iterations from every start before the best one is selected
_ITERATIONS = 8  # most iterations from the best start
_MAX_MISFIT = 3.0  # rms residual of a valid pose [standard deviations]
_MAX_HEADING_ERROR = np.radians(3.0)  # standard error of the heading of a valid pose [rad]
_MAX_POSITION_ERROR = 0.05  # standard error of the position of a valid pose [m]
_STRAINED = 4.0  # standard deviations of the misfit above which the returns include something else
_EXPLAINED = 7.0  # gain in log likelihood of a return from the plate over one from anything within a few metres
_MIN_PLATE_RETURNS = 8  # fewer returns may look like a plate by chance
_ROUNDS = 2  # rounds of selecting the returns by the pose
_SCREENED = 24  # beams of a cluster used to screen the starts
_ALIKE = 1e-3  # cost difference of starts that led to the same pose: the first is taken, rounding does not decide
_FEW_BEAMS = 1.5  # beam steps that a short face spans if one or two beams fit on it
_FROM_SIDE = np.radians(45.0)  # viewing angle above which the long face prevails
_TINY = 1e-12  # avoids division by zero for edges without information
_MIN_DROPOUT = 0.02  # probability that a beam passes a plate in its way


@dataclass(frozen=True)
class PlateSolution(Rows):
    """The pose of each scan, assuming that its cluster is the plate."""

    pose: Array  # (S, 3) in the LRF's frame
    covariance: Array  # (S, 3, 3)
    misfit: Array  # (S,) rms residual of ranges and edges under the Huber loss [standard deviations]
    score: Array  # (S,) log likelihood of the scan relative to a scan without a plate
    doubtful: np.ndarray  # (S,) bool: something else may be among the returns or in front of the plate

    @classmethod
    def none(cls, scans: int) -> PlateSolution:
        """Placeholder for scans in which nothing was found."""
        unknown, unexplained = np.full((scans, 3, 3), UNKNOWN), np.full(scans, np.inf)
        return cls(np.zeros((scans, 3)), unknown, unexplained, -unexplained, np.zeros(scans, bool))

    def improve(self, rows: np.ndarray, other: PlateSolution) -> None:
        """Overwrite the solutions of the scans `rows` (R,) that the R solutions of `other` explain better."""
        better = other.score > self.score[rows]
        self.put(rows[better], other.take(better))


@dataclass(frozen=True)
class PlateLocator:
    """Fits the rectangle to each scan; a pose is valid if it explains the returns and its heading is determined."""

    plate: Plate = field(default_factory=Plate)

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Poses of the plate in scans with ranges (S, B); see `Locator`.

        Without an expected pose every cluster that could be a plate is tried, and the one that explains most is kept.
        If a cluster may contain returns from something else, or miss some from the plate, its returns are selected
        again using the pose found.
        """
        near = None if predicted is None else scan.from_world(predicted)
        found = PlateSolution.none(len(scan.ranges))
        for rows in np.array_split(np.arange(len(scan.ranges)), -(-len(scan.ranges) // _AT_ONCE) or 1):
            part = replace(scan, ranges=scan.ranges[rows])
            found.put(rows, self._located(part, None if near is None else near[rows]))
        valid = self._believed(found)
        covariance = scan.covariance_to_world(found.covariance)
        covariance[~valid] = np.nan
        return PoseEstimate(scan.to_world(found.pose), covariance, valid)

    def _located(self, scan: Scan, near: Array | None) -> PlateSolution:
        """Solutions, with expected poses `near` (S, 3) in the LRF's frame if there are any."""
        if near is None:
            found = self._best(scan, MAX_GAP)
            doubtful = astray = np.flatnonzero(found.doubtful | ~np.isfinite(found.misfit))
        else:
            found = self._solve(scan, extract_plate(scan, self.plate, near), near)
            strange = found.misfit > _MAX_MISFIT
            (astray,), (doubtful,) = strange.nonzero(), (found.doubtful | strange).nonzero()
        for gap in FINER_GAPS if astray.size else ():
            found.improve(astray, self._best(replace(scan, ranges=scan.ranges[astray]), gap))
        if doubtful.size:
            self._sort_out(scan, found, doubtful, near)
        return found

    def _sort_out(self, scan: Scan, found: PlateSolution, rows: np.ndarray, near: Array | None) -> None:
        """Improve the solutions `found` for the scans `rows` where selecting the returns by the pose explains more."""
        part = replace(scan, ranges=scan.ranges[rows])
        for _ in range(_ROUNDS):
            pose = found.pose[rows]
            if near is not None:
                pose = np.where((found.misfit[rows] < _MAX_MISFIT)[:, None], pose, near[rows])
            found.improve(rows, self._solve(part, returns_at(part, self.plate, pose), pose))

    def _best(self, scan: Scan, gap: float) -> PlateSolution:
        """The solution of the best cluster of each scan, clusters being separated by more than `gap` [m]."""
        cluster, row = candidates(scan, self.plate, gap)
        tried = self._solve(scan, cluster, None)
        best = np.flatnonzero(best_of_each(row, tried.score))
        found = PlateSolution.none(len(scan.ranges))
        found.put(row[best], tried.take(best))
        return found

    def _believed(self, found: PlateSolution) -> np.ndarray:
        """Mask (S,) of the valid solutions."""
        variance = np.einsum("sii->si", found.covariance)
        return (
            (found.misfit < _MAX_MISFIT)
            & (variance[:, :2].max(axis=1) < _MAX_POSITION_ERROR**2)
            & (variance[:, 2] < _MAX_HEADING_ERROR**2)
            & (viewing_angle(found.pose) > EDGE_ON)
        )

    def _solve(self, scan: Scan, cluster: Cluster, near: Array | None) -> PlateSolution:
        """The pose that explains each cluster of MIN_RETURNS or more returns best."""
        found, rows = PlateSolution.none(len(cluster.count)), np.flatnonzero(cluster.count >= MIN_RETURNS)
        if not rows.size:
            return found
        cluster, near = cluster.take(rows), None if near is None else near[rows]
        beams = PlateBeams.of(scan, cluster)
        fit, misfit = self._fit(beams, cluster, scan.beam_step, near)
        axes = in_axes(fit.pose[:, 2])
        short = self.plate.thickness / scan.beam_step
        covariance = axes.swapaxes(1, 2) @ _widened(fit.covariances(), fit.pose, beams.edges.weight, short) @ axes
        strained = _strained(misfit, cluster.count)
        covariance[strained] *= (misfit[strained] ** 2)[:, None, None]
        score = _EXPLAINED * cluster.count - fit.cost
        score += np.log(max(scan.dropout, _MIN_DROPOUT)) * cluster.lost
        cut = cluster.hidden.max(axis=1) > 0
        covariance[cut & (cluster.count < _MIN_PLATE_RETURNS)] = UNKNOWN
        found.put(rows, PlateSolution(fit.pose, covariance, misfit, score, strained | cut))
        return found

    def _fit(
        self, beams: PlateBeams, cluster: Cluster, beam_step: float, near: Array | None
    ) -> tuple[Evaluation, Array]:
        """The best fits and their misfits (S,), started only from the expected poses if these explain the returns."""
        if near is None:
            fit = self._screened(beams, starts(cluster, self.plate, beam_step, None))
            return fit, _misfit(fit, cluster)
        fit = PlateLikelihood(self.plate, _HUBER).climb(beams, near, _ITERATIONS)
        unexplained = _strained(_misfit(fit, cluster), cluster.count) | (cluster.count < _MIN_PLATE_RETURNS)
        rows = np.flatnonzero(unexplained)
        if rows.size:
            first = starts(cluster.take(rows), self.plate, beam_step, near[rows])
            fit.put(rows, self._screened(beams.take(rows), first))
        return fit, _misfit(fit, cluster)

    def _screened(self, beams: PlateBeams, first: Array) -> Evaluation:
        """The best fits (S,) reached from the poses `first` (S, K, 3)."""
        scans, k, _ = first.shape
        likelihood = PlateLikelihood(self.plate, _HUBER)
        thinned = beams.thinned(_SCREENED).take(np.repeat(np.arange(scans), k))
        screened = likelihood.climb(thinned, first.reshape(-1, 3), _SCREENING)
        cost = screened.cost.reshape(scans, k)
        best = np.argmax(cost < cost.min(axis=1, keepdims=True) + _ALIKE, axis=1) + k * np.arange(scans)
        return likelihood.climb(beams, screened.pose[best], _ITERATIONS)


def _widened(covariance: Array, pose: Array, weight: Array, short: float) -> Array:
    """Covariances (S, 3, 3) along and across plates at poses (S, 3), widened along them where too small.

    They are too small where one or two beams fit on the short face of a plate seen from the side. Such beams seem to
    determine the position along the plate precisely, but say nothing about it once the plate slides so that they hit
    the long face. The edges, with weights `weight` (S, 2) [1/rad], then limit the variance. `short` is the distance at
    which one beam fits on a short face that faces the LRF [m].
    """
    angle, distance = viewing_angle(pose), np.hypot(pose[:, 0], pose[:, 1])
    information = np.sum((weight * (np.sin(angle) / distance)[:, None]) ** 2, axis=1)  # [1/m^2]
    few = (angle > _FROM_SIDE) & (short * np.cos(angle) < _FEW_BEAMS * distance) & (information > 0)
    factor = np.sqrt(np.where(few, np.maximum(1 / np.maximum(information * covariance[:, 0, 0], _TINY), 1.0), 1.0))
    covariance[:, 0, :] *= factor[:, None]
    covariance[:, :, 0] *= factor[:, None]
    return covariance


def _misfit(fit: Evaluation, cluster: Cluster) -> Array:
    """Root mean square residuals (S,) of ranges and edges [standard deviations]."""
    return np.sqrt(2 * fit.cost / cluster.count)


def _strained(misfit: Array, count: np.ndarray) -> np.ndarray:
    """True where `count` returns (S,) scatter about the plate by more than noise explains."""
    return misfit - 1 > _STRAINED / np.sqrt(2 * count)
