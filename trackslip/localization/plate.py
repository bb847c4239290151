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

from trackslip.arguments import checks_arguments
from trackslip.kinematics import Array
from trackslip.localization.likelihood import (
    EDGE_ON,
    UNKNOWN,
    Evaluation,
    PlateBeams,
    PlateLikelihood,
    in_lrf_axes,
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

_MAX_AT_ONCE: Final = 2000  # maximum number of scans fitted at once, to limit memory
_HUBER: Final = 3.0  # residual above which the loss of a range is linear [standard deviations]
_SCREENING_BEAMS: Final = 24  # number of beams per cluster with which initial poses are screened
_SCREENING_STEPS: Final = 4  # iterations from every initial pose before the best fit is selected
_MAX_STEPS: Final = 8  # maximum number of iterations from the best screened fit
# cost difference below which the first fit is used, so that rounding does not decide
_EQUAL_COST: Final = 1e-3
_MAX_MISFIT: Final = 3.0  # maximum rms residual of a valid pose [standard deviations]
_MAX_HEADING_ERROR: Final = np.radians(3.0)  # maximum standard error of a valid heading [rad]
_MAX_POSITION_ERROR: Final = 0.05  # maximum standard error of a valid position [m]
# excess of a misfit over 1 that indicates returns from other objects, in its standard deviations
_MAX_EXCESS: Final = 4.0
# log likelihood gain if a return is from the plate instead of anything within a few metres
_GAIN_PER_RETURN: Final = 7.0
# lowest assumed probability that a beam that hits the plate gives no return
_MIN_DROPOUT: Final = 0.02
# number of returns below which a cluster may look like a plate by chance
_MIN_PLATE_RETURNS: Final = 8
_MAX_SELECTIONS: Final = 2  # number of times that returns are selected by the fitted pose
# beam steps on a short face below which it holds one or two beams, which may miss it
_MIN_SHORT_STEPS: Final = 1.5
# viewing angle above which a plate counts as seen from the side [rad]
_FROM_SIDE: Final = np.radians(45.0)
_MIN_DIVISOR: Final = 1e-12  # avoids division by zero for edges without information


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
        return cls(
            pose=np.zeros((scans, 3)),
            covariance=np.full((scans, 3, 3), UNKNOWN),
            misfit=np.full(scans, np.inf),
            score=np.full(scans, -np.inf),
            doubtful=np.zeros(scans, bool),
        )

    def improve(self, rows: np.ndarray, other: PlateSolution) -> None:
        """Overwrite the solutions for the scans `rows` (R,) where the R solutions in `other` have
        higher scores.
        """
        better = other.score > self.score[rows]
        self.put(rows[better], other.take(better))


@checks_arguments
@dataclass(frozen=True)
class PlateLocator:
    """Locator that fits the rectangle to each scan; poses are valid if they explain the returns and
    are precise.

    Each scan passes through these steps: clusters of returns that may be the plate; for each a
    likelihood, maximised from the expected pose or from several (`_solve`); the cluster with the
    highest score; where that is doubtful, clusters with finer gaps, and returns selected anew by
    the fitted pose (`_located`); at last the checks that make a pose valid (`_is_valid`).
    """

    plate: Plate = field(default_factory=Plate)

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Poses of the plate in scans with ranges (S, B), near the `predicted` poses (S, 3) in the
        world, if given; see `Locator`.

        Without expected poses, every cluster that could be a plate is tried, and the solution with
        the highest score is kept. If a cluster may contain returns from other objects, or lack
        returns from the plate, its returns are selected again with the fitted pose.
        """
        # all fits are in the frame of the LRF
        expected = None if predicted is None else scan.from_world(predicted)
        scans = len(scan.ranges)
        found = PlateSolution.none(scans)
        for begin in range(0, scans, _MAX_AT_ONCE):
            rows = np.arange(begin, min(begin + _MAX_AT_ONCE, scans))
            part = replace(scan, ranges=scan.ranges[rows])
            found.put(rows, self._located(part, None if expected is None else expected[rows]))

        # back to the world, with NaN for the covariance of a pose that isn't valid
        valid = self._is_valid(found)
        covariance = scan.covariance_to_world(found.covariance)
        covariance[~valid] = np.nan
        return PoseEstimate(scan.to_world(found.pose), covariance, valid)

    def _located(self, scan: Scan, expected: Array | None) -> PlateSolution:
        """Solutions for all scans, starting from `expected` poses (S, 3) in the LRF's frame if
        these are known.
        """
        if expected is None:
            # whatever is doubtful may be another object altogether, as good as a failed fit
            found = self._best(scan, MAX_GAP)
            is_doubtful = found.doubtful | ~np.isfinite(found.misfit)
            is_failed = is_doubtful
        else:
            # the returns near the expected plate; a fit to them may be doubtful, but not failed
            found = self._solve(scan, extract_plate(scan, self.plate, expected), expected)
            is_failed = found.misfit > _MAX_MISFIT
            is_doubtful = found.doubtful | is_failed

        # a close object may be in the same cluster: smaller gaps may separate it from the plate
        failed = np.flatnonzero(is_failed)
        if failed.size:
            part = replace(scan, ranges=scan.ranges[failed])
            for gap in FINER_GAPS:
                found.improve(failed, self._best(part, gap))

        doubtful = np.flatnonzero(is_doubtful)
        if doubtful.size:
            self._select_again(scan, found, doubtful, expected)
        return found

    def _select_again(
        self, scan: Scan, found: PlateSolution, rows: np.ndarray, expected: Array | None
    ) -> None:
        """Improve the solutions for the scans `rows` by selecting the returns anew with the fitted
        poses, or with the `expected` poses (S, 3) where a fit failed.
        """
        part = replace(scan, ranges=scan.ranges[rows])
        for _ in range(_MAX_SELECTIONS):
            pose = found.pose[rows]
            if expected is not None:
                is_fitted = found.misfit[rows] < _MAX_MISFIT
                pose = np.where(is_fitted[:, None], pose, expected[rows])
            cluster = returns_at(part, self.plate, pose)
            found.improve(rows, self._solve(part, cluster, pose))

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

    def _is_valid(self, found: PlateSolution) -> np.ndarray:
        """Mask (S,) of the valid solutions in `found`."""
        variance = np.einsum("sii->si", found.covariance)
        is_explained = found.misfit < _MAX_MISFIT
        has_position = variance[:, :2].max(axis=1) < _MAX_POSITION_ERROR**2
        has_heading = variance[:, 2] < _MAX_HEADING_ERROR**2
        is_not_edge_on = viewing_angle(found.pose) > EDGE_ON
        return is_explained & has_position & has_heading & is_not_edge_on

    def _solve(self, scan: Scan, cluster: Cluster, expected: Array | None) -> PlateSolution:
        """The best solution for each cluster of MIN_RETURNS or more returns."""
        found = PlateSolution.none(len(cluster.count))
        rows = np.flatnonzero(cluster.count >= MIN_RETURNS)
        if not rows.size:
            return found
        cluster = cluster.take(rows)
        if expected is not None:
            expected = expected[rows]
        beams = PlateBeams.of(scan, cluster)
        fit, misfit = self._fit(beams, cluster, scan.beam_step, expected)

        # scattered returns and chance clusters determine less than the likelihood's curvature says
        short_distance = self.plate.thickness / scan.beam_step
        on_axes = _widened(fit.covariances(), fit.pose, beams.edges.weight, short_distance)
        covariance = in_lrf_axes(on_axes, fit.pose[:, 2])
        is_scattered = _scatters(misfit, cluster.count)
        covariance[is_scattered] *= (misfit[is_scattered] ** 2)[:, None, None]
        is_cut = cluster.hidden.max(axis=1) > 0
        covariance[is_cut & (cluster.count < _MIN_PLATE_RETURNS)] = UNKNOWN

        # log likelihood relative to a scan without a plate: each return of the cluster gains, and
        # each beam inside the cluster that gave no return loses
        score = _GAIN_PER_RETURN * cluster.count - fit.cost
        score += np.log(max(scan.dropout, _MIN_DROPOUT)) * cluster.lost
        solution = PlateSolution(
            pose=fit.pose,
            covariance=covariance,
            misfit=misfit,
            score=score,
            doubtful=is_scattered | is_cut,
        )
        found.put(rows, solution)
        return found

    def _fit(
        self, beams: PlateBeams, cluster: Cluster, beam_step: float, expected: Array | None
    ) -> tuple[Evaluation, Array]:
        """The best fits and their misfits (S,). Where the fit from `expected` (S, 3) succeeds, no
        other pose is tried.
        """
        if expected is None:
            fit = self._screened(beams, starts(cluster, self.plate, beam_step, None))
            return fit, _misfit(fit, cluster)

        fit = PlateLikelihood(self.plate, _HUBER).climb(beams, expected, _MAX_STEPS)
        is_unsure = cluster.count < _MIN_PLATE_RETURNS
        is_unsure |= _scatters(_misfit(fit, cluster), cluster.count)
        rows = np.flatnonzero(is_unsure)
        if rows.size:
            first = starts(cluster.take(rows), self.plate, beam_step, expected[rows])
            fit.put(rows, self._screened(beams.take(rows), first))
        return fit, _misfit(fit, cluster)

    def _screened(self, beams: PlateBeams, first: Array) -> Evaluation:
        """The best fits for S scans from K initial poses each, `first` (S, K, 3).

        A few iterations with some of the beams show which initial pose is the best.
        """
        scans, starts_per_scan, _ = first.shape
        likelihood = PlateLikelihood(self.plate, _HUBER)
        repeated = np.repeat(np.arange(scans), starts_per_scan)
        thinned = beams.thinned(_SCREENING_BEAMS).take(repeated)
        screened = likelihood.climb(thinned, first.reshape(-1, 3), _SCREENING_STEPS)

        cost = screened.cost.reshape(scans, starts_per_scan)
        pose = screened.pose.reshape(scans, starts_per_scan, 3)
        is_best = cost < cost.min(axis=1, keepdims=True) + _EQUAL_COST
        best = np.argmax(is_best, axis=1)  # the first of them
        return likelihood.climb(beams, pose[np.arange(scans), best], _MAX_STEPS)


def _widened(covariance: Array, pose: Array, weight: Array, short_distance: float) -> Array:
    """Covariances (S, 3, 3) along and across plates at poses (S, 3), widened along the plates where
    too small.

    Covariances are too small where one or two beams hit the short face of a plate seen from the
    side. The beams seem to determine the position along the plate precisely, but do not if the
    plate slides so that they hit the long face. The variance is then that from the edges, whose
    bearings have the `weight` (S, 2) [1/rad]: a plate at the distance d, seen at the angle theta,
    that slides by dx turns them by dx sin(theta) / d.

    `short_distance` is the distance at which a short face turned towards the LRF spans one beam
    step [m].
    """
    angle = viewing_angle(pose)
    distance = np.hypot(pose[:, 0], pose[:, 1])
    edge_slope = np.sin(angle) / distance  # [rad/m]
    information = np.sum((weight * edge_slope[:, None]) ** 2, axis=1)  # from both edges [1/m^2]

    is_from_side = angle > _FROM_SIDE
    is_short_face_missed = short_distance * np.cos(angle) < _MIN_SHORT_STEPS * distance
    is_widened = is_from_side & is_short_face_missed & (information > 0)

    # the variance by the edges, relative to that of the likelihood
    ratio = 1 / np.maximum(information * covariance[:, 0, 0], _MIN_DIVISOR)
    scale = np.ones((len(pose), 3))
    scale[:, 0] = np.sqrt(np.where(is_widened, np.maximum(ratio, 1.0), 1.0))
    return np.asarray(covariance * scale[:, :, None] * scale[:, None, :])


def _misfit(fit: Evaluation, cluster: Cluster) -> Array:
    """Root mean square residuals (S,) of ranges and edges [standard deviations]."""
    return np.sqrt(2 * fit.cost / cluster.count)


def _scatters(misfit: Array, count: np.ndarray) -> np.ndarray:
    """Mask (S,) of the scans whose `count` (S,) returns scatter about the plate by more than noise
    explains.

    The rms of n normal residuals has the mean 1 and nearly the standard deviation 1 / sqrt(2 n).
    """
    return misfit - 1 > _MAX_EXCESS / np.sqrt(2 * count)
