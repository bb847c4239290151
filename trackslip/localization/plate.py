"""Maximum-likelihood fit of the known rectangle to the ranges of a scan (see `likelihood`).

The likelihood has several maxima (a plate seen nearly edge-on looks much like its mirror image
about the line of sight), so it is maximised from several initial poses, by damped Gauss-Newton
steps for all scans and poses at once. If the fit from an expected pose explains the scan as well as
the noise allows, no other initial pose is tried. Covariances follow from the likelihood's
curvature, except where this is misleading: a plate seen edge-on has no valid pose, and the position
of a plate seen from the side, along its length, is only as precise as the edges of its silhouette.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

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
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.localization.rows import Rows
from trackslip.localization.scan import (
    FINER_GAPS,
    MAX_GAP,
    MIN_RETURNS,
    Cluster,
    Plate,
    Scan,
    best_of_each,
    candidates,
    extract_plate,
    returns_at,
)

_AT_ONCE: Final = 2000  # maximum number of scans fitted at once, to limit memory
_HUBER: Final = 3.0  # residual above which the loss of a range is linear [standard deviations]
_SCREENING: Final = 4  # iterations from every initial pose before the best fit is selected
_ITERATIONS: Final = 8  # maximum number of iterations from the best screened fit
_MAX_MISFIT: Final = 3.0  # maximum rms residual of a valid pose [standard deviations]
_MAX_HEADING_ERROR: Final = np.radians(3.0)  # maximum standard error of a valid heading [rad]
_MAX_POSITION_ERROR: Final = 0.05  # maximum standard error of a valid position [m]
# excess of a misfit over 1 that indicates returns from other objects [standard deviations]
_STRAINED: Final = 4.0
# log likelihood gain if a return is from the plate instead of anything within a few metres
_EXPLAINED: Final = 7.0
# number of returns below which a cluster may look like a plate by chance
_MIN_PLATE_RETURNS: Final = 8
_ROUNDS: Final = 2  # number of times that returns are selected by the fitted pose
_SCREENED: Final = 24  # number of beams per cluster with which initial poses are screened
# cost difference below which the first fit is used, so that rounding does not decide
_ALIKE: Final = 1e-3
_FEW_BEAMS: Final = 1.5  # beam steps on a short face below which the face holds one or two beams
# viewing angle above which a plate counts as seen from the side
_FROM_SIDE: Final = np.radians(45.0)
_TINY: Final = 1e-12  # avoids division by zero for edges without information
# lowest assumed probability that a beam that hits the plate gives no return
_MIN_DROPOUT: Final = 0.02


@dataclass(frozen=True)
class PlateSolution(Rows):
    """The pose of the plate in each scan, assuming that the scan's cluster is the plate."""

    pose: Array  # (S, 3) in the LRF's frame
    covariance: Array  # (S, 3, 3)
    # (S,) rms residual of ranges and edges under the Huber loss [standard deviations]
    misfit: Array
    score: Array  # (S,) log likelihood of the scan relative to a scan without a plate
    # (S,) bool: other objects may be among the returns or in front of the plate
    doubtful: np.ndarray

    @classmethod
    def none(cls, scans: int) -> PlateSolution:
        """Return placeholders for scans without a solution."""
        unknown, unexplained = np.full((scans, 3, 3), UNKNOWN), np.full(scans, np.inf)
        return cls(np.zeros((scans, 3)), unknown, unexplained, -unexplained, np.zeros(scans, bool))

    def improve(self, rows: np.ndarray, other: PlateSolution) -> None:
        """Overwrite the solutions for the scans `rows` (R,) where the R solutions in `other` have
        higher scores.
        """
        better = other.score > self.score[rows]
        self.put(rows[better], other.take(better))


@dataclass(frozen=True)
class PlateLocator:
    """Locator that fits the rectangle to each scan; poses are valid if they explain the returns and
    are precise.
    """

    plate: Plate = field(default_factory=Plate)

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Poses of the plate in scans with ranges (S, B); see `Locator`.

        Without expected poses, every cluster that could be a plate is tried, and the solution with
        the highest score is kept. If a cluster may contain returns from other objects, or lack
        returns from the plate, its returns are selected again with the fitted pose.
        """
        near = None if predicted is None else scan.from_world(predicted)
        found = PlateSolution.none(len(scan.ranges))
        for rows in np.array_split(
            np.arange(len(scan.ranges)), -(-len(scan.ranges) // _AT_ONCE) or 1
        ):
            part = replace(scan, ranges=scan.ranges[rows])
            found.put(rows, self._located(part, None if near is None else near[rows]))
        valid = self._believed(found)
        covariance = scan.covariance_to_world(found.covariance)
        covariance[~valid] = np.nan
        return PoseEstimate(scan.to_world(found.pose), covariance, valid)

    def _located(self, scan: Scan, near: Array | None) -> PlateSolution:
        """Solutions for all scans, starting from expected poses `near` (S, 3) in the LRF's frame if
        these are known.
        """
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

    def _sort_out(
        self, scan: Scan, found: PlateSolution, rows: np.ndarray, near: Array | None
    ) -> None:
        """Improve the solutions for the scans `rows` by selecting the returns anew with the fitted
        poses.
        """
        part = replace(scan, ranges=scan.ranges[rows])
        for _ in range(_ROUNDS):
            pose = found.pose[rows]
            if near is not None:
                pose = np.where((found.misfit[rows] < _MAX_MISFIT)[:, None], pose, near[rows])
            found.improve(rows, self._solve(part, returns_at(part, self.plate, pose), pose))

    def _best(self, scan: Scan, gap: float) -> PlateSolution:
        """The solution from the best cluster of each scan, where gaps above `gap` [m] separate
        clusters.
        """
        cluster, row = candidates(scan, self.plate, gap)
        tried = self._solve(scan, cluster, None)
        best = np.flatnonzero(best_of_each(row, tried.score))
        found = PlateSolution.none(len(scan.ranges))
        found.put(row[best], tried.take(best))
        return found

    def _believed(self, found: PlateSolution) -> np.ndarray:
        """Mask (S,) of the valid solutions in `found`."""
        variance = np.einsum("sii->si", found.covariance)
        return (
            (found.misfit < _MAX_MISFIT)
            & (variance[:, :2].max(axis=1) < _MAX_POSITION_ERROR**2)
            & (variance[:, 2] < _MAX_HEADING_ERROR**2)
            & (viewing_angle(found.pose) > EDGE_ON)
        )

    def _solve(self, scan: Scan, cluster: Cluster, near: Array | None) -> PlateSolution:
        """The best solution for each cluster of MIN_RETURNS or more returns."""
        found, rows = (
            PlateSolution.none(len(cluster.count)),
            np.flatnonzero(cluster.count >= MIN_RETURNS),
        )
        if not rows.size:
            return found
        cluster, near = cluster.take(rows), None if near is None else near[rows]
        beams = PlateBeams.of(scan, cluster)
        fit, misfit = self._fit(beams, cluster, scan.beam_step, near)
        axes = in_axes(fit.pose[:, 2])
        short = self.plate.thickness / scan.beam_step
        covariance = (
            axes.swapaxes(1, 2)
            @ _widened(fit.covariances(), fit.pose, beams.edges.weight, short)
            @ axes
        )
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
        """The best fits and their misfits (S,). Where the fit from `near` (S, 3) succeeds, no other
        pose is tried.
        """
        if near is None:
            fit = self._screened(beams, starts(cluster, self.plate, beam_step, None))
            return fit, _misfit(fit, cluster)
        fit = PlateLikelihood(self.plate, _HUBER).climb(beams, near, _ITERATIONS)
        unexplained = _strained(_misfit(fit, cluster), cluster.count) | (
            cluster.count < _MIN_PLATE_RETURNS
        )
        rows = np.flatnonzero(unexplained)
        if rows.size:
            first = starts(cluster.take(rows), self.plate, beam_step, near[rows])
            fit.put(rows, self._screened(beams.take(rows), first))
        return fit, _misfit(fit, cluster)

    def _screened(self, beams: PlateBeams, first: Array) -> Evaluation:
        """The best fits for S scans from K initial poses each, `first` (S, K, 3)."""
        scans, k, _ = first.shape
        likelihood = PlateLikelihood(self.plate, _HUBER)
        thinned = beams.thinned(_SCREENED).take(np.repeat(np.arange(scans), k))
        screened = likelihood.climb(thinned, first.reshape(-1, 3), _SCREENING)
        cost = screened.cost.reshape(scans, k)
        best = np.argmax(cost < cost.min(axis=1, keepdims=True) + _ALIKE, axis=1) + k * np.arange(
            scans
        )
        return likelihood.climb(beams, screened.pose[best], _ITERATIONS)


def _widened(covariance: Array, pose: Array, weight: Array, short: float) -> Array:
    """Covariances (S, 3, 3) along and across plates at poses (S, 3), widened along the plates where
    too small.

    Covariances are too small where one or two beams hit the short face of a plate seen from the
    side. The beams seem to determine the position along the plate precisely, but do not if the
    plate slides so that they hit the long face. The variance is then that from the edges, with
    weights `weight` (S, 2) [1/rad]. `short` is the distance at which a short face turned towards
    the LRF spans one beam step [m].
    """
    angle, distance = viewing_angle(pose), np.hypot(pose[:, 0], pose[:, 1])
    information = np.sum((weight * (np.sin(angle) / distance)[:, None]) ** 2, axis=1)  # [1/m^2]
    few = (angle > _FROM_SIDE) & (short * np.cos(angle) < _FEW_BEAMS * distance) & (information > 0)
    factor = np.sqrt(
        np.where(
            few, np.maximum(1 / np.maximum(information * covariance[:, 0, 0], _TINY), 1.0), 1.0
        )
    )
    covariance[:, 0, :] *= factor[:, None]
    covariance[:, :, 0] *= factor[:, None]
    return covariance


def _misfit(fit: Evaluation, cluster: Cluster) -> Array:
    """Root mean square residuals (S,) of ranges and edges [standard deviations]."""
    return np.sqrt(2 * fit.cost / cluster.count)


def _strained(misfit: Array, count: np.ndarray) -> np.ndarray:
    """Mask (S,) of the scans whose `count` (S,) returns scatter about the plate by more than noise
    explains.
    """
    return misfit - 1 > _STRAINED / np.sqrt(2 * count)
