"""Predictions of driving: from each measured pose, by the belt speeds, to the pose some seconds or
metres later.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from trackslip.drives.drive import Drives
from trackslip.identification.comparison import LEAST_ERROR, Criterion
from trackslip.identification.path import DriveModel, Path
from trackslip.identification.windows import WindowFit
from trackslip.intervals import DEVIATION_PER_MEDIAN
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.metrics import rms
from trackslip.viewable import ShortRepr

FOLDS: Final = 5
"""Number of parts for held-out predictions; each part contains every fifth block of driving."""
HORIZONS: Final = (1.0, 2.0, 5.0, 10.0)  # prediction horizons [s]
FAR_AHEAD: Final = 10.0
"""Distance driven from which errors are told beside those after some seconds [m]."""
_DISTANCE_TOLERANCE: Final = 0.1  # of a distance driven, as in `odometry.evaluation` [-]
_FEWEST_PAIRS: Final = 5  # least number of pairs at a horizon
_LEAST_MOTION: Final = 0.1  # least distance driven by the belts between two poses [half gauges]
_TRAILING: Final = 10.0  # duration of the path that is fitted to positions for a heading [s]
_FEWEST_TRAILING: Final = 5  # least number of positions for a heading
# least spread of positions for a heading, as over 0.5 m: noise of 2 cm is a few degrees [m]
_LEAST_TRAILING_SPREAD: Final = 0.15
# share of a variance below which its growth is a difference that medians don't resolve
_RESOLVED: Final = 0.01


@dataclass(frozen=True)
class Statistics:
    """Statistics of error sizes, in the unit of the errors."""

    rms: float
    mean: float
    median: float
    p90: float  # 90th percentile
    largest: float

    @classmethod
    def of(cls, errors: Array) -> Statistics:
        """Compute the statistics of error sizes (n,), which are non-negative."""
        return cls(
            rms=rms(errors),
            mean=float(errors.mean()),
            median=float(np.median(errors)),
            p90=float(np.quantile(errors, 0.9)),
            largest=float(errors.max()),
        )


@dataclass(frozen=True)
class PredictionErrors:
    """Errors of predictions that all cover the same duration or distance."""

    count: int  # number of predictions, whose times overlap
    way: float
    """Median distance driven, without slip [m]: that of `Pairs.distance`, or of the middle of the
    tracks in `odometry.evaluation`. The name is the key in files.
    """
    position: Statistics | None  # errors of positions [m]; None without positions
    heading: Statistics | None  # absolute errors of headings [rad]; None without headings

    @classmethod
    def of(cls, distance: Array, position: Array, heading: Array) -> PredictionErrors:
        """Summarise errors (n,) of predictions over distances (n,); NaN where unknown."""
        is_known = np.isfinite(position) | np.isfinite(heading)
        return cls(
            count=int(is_known.sum()),
            way=float(np.median(distance)),
            position=_statistics(position),
            heading=_statistics(heading),
        )


def _statistics(errors: Array) -> Statistics | None:
    """Statistics of error sizes (n,) other than NaN; None if there are none."""
    known = errors[np.isfinite(errors)]
    return Statistics.of(known) if len(known) else None


@dataclass(frozen=True, repr=False)
class Pairs(ShortRepr):
    """Pairs of measured poses with motion between them; a law predicts the second pose from the
    first.
    """

    drives: Drives
    start: np.ndarray  # (n,) index of the first pose
    end: np.ndarray  # (n,) index of the second pose
    horizon: Array  # (n,) nominal time between both poses [s]
    distance: Array
    """Distances (n,) driven between both poses, without slip [m].

    For pairs some seconds apart, it is the mean of both belts' distances, as the robot may turn in
    place; for pairs from `after_distance`, that of the middle of the tracks.
    """

    @classmethod
    def of(
        cls, drives: Drives, geometry: RobotGeometry, horizons: Sequence[float] = HORIZONS
    ) -> Pairs:
        """Find all pairs of poses that are a horizon apart, to within half the interval between
        poses.

        If the interval between poses exceeds all horizons, the pairs are neighbouring poses.
        """
        shortest = min(drive.interval for drive in drives.drives)
        if shortest > max(horizons):
            horizons = (shortest,)
        starts = [np.zeros(0, int)]
        ends = [np.zeros(0, int)]
        times = [np.zeros(0)]
        for drive, first in zip(drives.drives, drives.first[:-1], strict=True):
            usable = np.flatnonzero(np.isfinite(drive.pose).any(axis=1))
            tolerance = drive.interval / 2
            for horizon in horizons:
                start, end = _apart(drive.time[usable], horizon, tolerance)
                starts.append(first + usable[start])
                ends.append(first + usable[end])
                times.append(np.full(len(start), horizon))
        start = np.concatenate(starts)
        end = np.concatenate(ends)
        horizon_of_pair = np.concatenate(times)

        # between which the robot moves, at horizons with enough of them
        distance_to_pose = drives.belt_distance(geometry.sprocket_radius)
        distance = distance_to_pose[end] - distance_to_pose[start]
        kept = distance > _LEAST_MOTION * geometry.half_gauge
        counts = {h: np.sum(kept & (horizon_of_pair == h)) for h in horizons}
        frequent = [h for h, count in counts.items() if count >= _FEWEST_PAIRS]
        kept &= np.isin(horizon_of_pair, frequent)
        return cls(drives, start[kept], end[kept], horizon_of_pair[kept], distance[kept])

    @classmethod
    def after_distance(cls, drives: Drives, geometry: RobotGeometry, distance: float) -> Pairs:
        """Find all pairs of poses between which the middle of the tracks drives a `distance` [m],
        to within a tenth, by the encoders without slip.

        Their horizon is the median time that this takes.
        """
        starts = [np.zeros(0, int)]
        ends = [np.zeros(0, int)]
        middle = drives.middle_distance(geometry.sprocket_radius)
        for drive, first in zip(drives.drives, drives.first[:-1], strict=True):
            usable = first + np.flatnonzero(np.isfinite(drive.pose).any(axis=1))
            start, end = _apart(middle[usable], distance, _DISTANCE_TOLERANCE * distance)
            starts.append(usable[start])
            ends.append(usable[end])
        start = np.concatenate(starts)
        end = np.concatenate(ends)
        if len(start) < _FEWEST_PAIRS:
            start = start[:0]
            end = end[:0]
        duration = drives.time[end] - drives.time[start]
        usual = float(np.median(duration)) if len(duration) else 0.0
        return cls(drives, start, end, np.full(len(start), usual), middle[end] - middle[start])

    def errors(self, model: DriveModel, values: Array, part: np.ndarray | None = None) -> Array:
        """Errors (n, 3) forwards, to the left and in heading [m, m, rad] of F parameter sets (F,
        p); NaN if unknown.

        `part` (n,) is the index of the parameter set that predicts each pair.
        """
        if part is None:
            part = np.zeros(len(self.start), int)
        no_slopes = np.zeros(0, int)
        errors = np.full((len(part), 3), np.nan)
        for k, parameters in enumerate(values):
            pairs = part == k
            path = model.path(parameters, self.drives, no_slopes)
            errors[pairs] = self._errors_of_path(path, self.start[pairs], self.end[pairs])
        return errors

    def _errors_of_path(self, path: Path, start: np.ndarray, end: np.ndarray) -> Array:
        """Errors (n, 3) of a predicted path between poses `start` (n,) and `end` (n,), as in
        `errors`.
        """
        drives = self.drives
        heading = _headings(drives, path)[start]

        # the predicted motion, turned so that it starts with the measured heading
        turn = heading - path.heading[start]
        predicted = (path.place[end] - path.place[start]) * np.exp(1j * turn)
        measured = drives.place[end] - drives.place[start]
        missed = (predicted - measured) * np.exp(-1j * heading)

        predicted_turn = path.heading[end] - path.heading[start]
        measured_turn = drives.heading[end] - drives.heading[start]
        missed_turn = wrap_angle(predicted_turn - measured_turn)

        is_placed, is_headed = drives.known[:, start] & drives.known[:, end]
        missed[~is_placed] = np.nan
        missed_turn[~is_headed] = np.nan
        return np.column_stack([missed.real, missed.imag, missed_turn])

    def held_out_errors(self, fit: WindowFit) -> Array:
        """Prediction errors (n, 3) by fits that leave out a fifth of all blocks, including the
        block of each pair.
        """
        fold_of_block = np.arange(len(fit.score)) % FOLDS
        folds = np.arange(min(FOLDS, len(fit.score)))
        values = fit.without(fold_of_block == folds[:, None])
        return self.errors(fit.model, values, fold_of_block[fit.block[self.start]])

    def summaries(self, error: Array) -> dict[float, PredictionErrors]:
        """Summarise errors (n, 3) by horizon [s]."""
        found = dict[float, PredictionErrors]()
        for horizon in np.unique(self.horizon).tolist():
            rows = self.horizon == horizon
            position, heading = sizes(error)[rows].T
            found[horizon] = PredictionErrors.of(self.distance[rows], position, heading)
        return found

    def criteria(self, errors: Mapping[str, Array]) -> list[Criterion]:
        """Make a criterion for each horizon from errors (n, 3) by law.

        A pair's error is the sum of its position and heading errors, each relative to the smallest
        mean of any law. Absolute errors are averaged, not squares: a wrong pose then matters no
        more than the laws' predictions differ there, whereas its square could decide the
        comparison.
        """
        criteria = list[Criterion]()
        of_laws = np.stack([sizes(error) for error in errors.values()])  # (laws, n, 2)
        for horizon in np.unique(self.horizon):
            rows = self.horizon == horizon
            size = of_laws[:, rows]
            is_known = np.isfinite(size).all(axis=0)  # for every law
            if not is_known.any():
                continue
            size = np.where(is_known, size, 0.0)
            mean = size.sum(axis=1) / np.maximum(is_known.sum(axis=0), 1)  # (laws, 2)
            relative = size / np.maximum(mean.min(axis=0), LEAST_ERROR)
            both = relative.sum(axis=2)
            block = self.drives.blocks(horizon)[self.start[rows]]
            criteria.append(Criterion(dict(zip(errors, both, strict=True)), block, 2 * LEAST_ERROR))
        return criteria


def _apart(axis: Array, length: float, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends (n,) of all stretches of about `length` on an ascending axis (K,), to within
    the tolerance.
    """
    if not len(axis):
        return np.zeros(0, int), np.zeros(0, int)
    end = np.searchsorted(axis, axis + length - tolerance)
    end = np.minimum(end, len(axis) - 1)
    start = np.flatnonzero(np.abs(axis[end] - axis - length) <= tolerance + 1e-9)
    return start, end[start]


def sizes(error: Array) -> Array:
    """Sizes (n, 2) of errors (n, 3) in position [m] and heading [rad]."""
    return np.column_stack([np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])])


def _headings(drives: Drives, path: Path) -> Array:
    """Sensor headings (K,) [rad]: measured or, in drives without headings, from fits of the path to
    past positions.
    """
    heading = np.where(drives.known[1], drives.heading, np.nan)
    for drive, begin, end in zip(drives.drives, drives.first[:-1], drives.first[1:], strict=True):
        if drive.has_heading:
            continue
        placed = np.flatnonzero(drives.known[0][begin:end])
        rows = begin + placed
        heading[rows] = trailing_heading(
            drive.time[placed], drives.place[rows], path.place[rows], path.heading[rows]
        )
    return heading


def trailing_heading(time: Array, measured: np.ndarray, place: np.ndarray, heading: Array) -> Array:
    """Headings (n,) at which dead reckoning fits the positions of the last 10 s; NaN if positions
    are too few.

    The positions `measured` (n,) at `time` (n,) and the positions `place` (n,) are complex, x + i
    y. `place` and `heading` (n,) are from dead reckoning with any start pose.

    With N positions z_k measured and c_k dead-reckoned, the turn that fits best is the angle of
    sum z_k conj(c_k) - (sum z_k) (sum conj(c_k)) / N, as in `windows.residuals`. All sums over the
    last 10 s are differences of cumulative sums.
    """
    place = place - place[:1]
    begin = np.searchsorted(time, time - _TRAILING)
    rows = np.arange(1, len(time) + 1)

    def trailing_sums(values: np.ndarray) -> np.ndarray:
        """Sums (n,) of values (n,) over the last 10 s before each row."""
        total = np.append(0.0, np.cumsum(values))
        return np.asarray(total[rows] - total[begin])

    count = (rows - begin).astype(float)
    measured_sum = trailing_sums(measured)
    place_sum = trailing_sums(place)
    product = trailing_sums(measured * place.conj())
    square = trailing_sums(np.abs(place) ** 2)

    turn = np.angle(product - measured_sum * place_sum.conj() / count)
    variance = square / count - np.abs(place_sum / count) ** 2
    is_known = (count >= _FEWEST_TRAILING) & (variance > _LEAST_TRAILING_SPREAD**2)
    return np.where(is_known, turn + heading, np.nan)


def slip_noise(
    error: Array, pairs: Pairs, spread: Array, ahead: Sequence[float] = HORIZONS
) -> dict[str, float]:
    """Varying slip as a random walk of the pose [m/√m, m/√m, rad/√m], estimated from prediction
    errors (n, 3).

    The variance of errors, from medians, is the variance of two poses plus a part that grows with
    the distance s driven. With q_f, q_l and q_t the variances per metre that slip adds forwards, to
    the left and in turn, the errors have the variances

        forwards     2 p² + q_f s
        turn         2 h² + q_t s
        to the left  2 p² + q_l s + (h² + q_t s / 3) d²

    where p and h are the standard deviations of measured positions and headings. An error of the
    first heading, and turns on the way, move the end of a straight path of length d sideways. The
    shortest and the longest horizon in `ahead` [s] yield p, h and the q. With a single horizon, p
    and h come from `spread` (3,), the standard deviations of poses.
    """
    names = ("slip_forward", "slip_sideways", "slip_turn")
    horizons = np.intersect1d(pairs.horizon, ahead)
    if not len(horizons):
        return dict.fromkeys(names, 0.0)

    # distances driven (2,), squared distances between poses (2,), and variances (2, 3) of errors at
    # the shortest and the longest horizon
    places = pairs.drives.place
    moved = np.abs(places[pairs.end] - places[pairs.start]) ** 2
    near, far = (pairs.horizon == horizon for horizon in horizons[[0, -1]])
    driven = np.array([np.median(pairs.distance[rows]) for rows in (near, far)])
    reach = np.array([np.median(moved[rows]) for rows in (near, far)])
    variance = np.array(
        [[_robust_variance(of_column) for of_column in error[rows].T] for rows in (near, far)]
    )
    if driven[1] - driven[0] < 1e-6:
        driven[0] = 0.0
        reach[0] = 0.0
        variance[0] = 2 * spread[[0, 0, 1]] ** 2

    # growth per metre
    longer = driven[1] - driven[0]
    per_metre = np.maximum((variance[1] - variance[0]) / longer, 0.0)
    of_heading = max(variance[0, 2] - per_metre[2] * driven[0], 0.0) / 2  # h²
    by_headings = (of_heading + per_metre[2] * driven / 3) * reach
    aside = variance[:, 1] - by_headings
    per_metre[1] = max((aside[1] - aside[0]) / longer, 0.0)

    # the growth is a difference between large numbers
    per_metre = np.maximum(per_metre, _RESOLVED * variance[1] / max(driven[1], 1e-9))
    return dict(zip(names, np.sqrt(per_metre).tolist(), strict=True))


def _robust_variance(values: Array) -> float:
    """Variance of values (n,) from their median size, as for a normal distribution; 0 without
    values other than NaN.
    """
    size = np.abs(values[np.isfinite(values)])
    return float((DEVIATION_PER_MEDIAN * np.median(size)) ** 2) if len(size) else 0.0
