"""Predictions of driving: from each measured pose, by the belt speeds, to the pose some seconds
later.
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
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.metrics import rms

FOLDS: Final = 5
"""Number of parts for held-out predictions; each part contains every fifth block of driving."""
HORIZONS: Final = (1.0, 2.0, 5.0, 10.0)  # prediction horizons [s]


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
        mean, p90 = float(errors.mean()), float(np.quantile(errors, 0.9))
        return cls(rms(errors), mean, float(np.median(errors)), p90, float(errors.max()))


@dataclass(frozen=True)
class PredictionErrors:
    """Errors of predictions that all cover the same duration or distance."""

    count: int  # number of predictions, whose times overlap
    way: float  # median distance driven by the belts [m]
    position: Statistics | None  # errors of positions [m]; None without positions
    heading: Statistics | None  # absolute errors of headings [rad]; None without headings

    @classmethod
    def of(cls, way: Array, position: Array, heading: Array) -> PredictionErrors:
        """Summarise errors (n,) of predictions over distances (n,); NaN where unknown."""
        known = (errors[np.isfinite(errors)] for errors in (position, heading))
        statistics = [Statistics.of(errors) if errors.size else None for errors in known]
        count = int((np.isfinite(position) | np.isfinite(heading)).sum())
        return cls(count, float(np.median(way)), *statistics)


@dataclass(frozen=True)
class Pairs:
    """Pairs of measured poses with motion between them; a law predicts the second pose from the
    first.
    """

    drives: Drives
    start: np.ndarray  # (n,) index of the first pose
    end: np.ndarray  # (n,) index of the second pose
    horizon: Array  # (n,) nominal time between both poses [s]
    way: Array  # (n,) mean distance driven by the belts between both poses [m]

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
        way, pairs = drives.way(geometry.sprocket_radius), [np.zeros((3, 0))]
        for drive, begin in zip(drives.drives, drives.first, strict=False):
            usable = np.flatnonzero(np.isfinite(drive.pose).any(axis=1))
            time, half = drive.time[usable], drive.interval / 2
            for horizon in horizons:
                end = np.clip(np.searchsorted(time, time + horizon - half), 0, len(time) - 1)
                hit = np.flatnonzero(np.abs(time[end] - time - horizon) <= half + 1e-9)
                pairs.append(
                    np.stack(
                        [begin + usable[hit], begin + usable[end[hit]], np.full(len(hit), horizon)]
                    )
                )
        *rows, ahead = np.concatenate(pairs, axis=1)
        start, end = np.array(rows, int)
        moving = way[end] - way[start] > 0.1 * geometry.half_gauge
        moving &= np.isin(ahead, [h for h in horizons if (ahead[moving] == h).sum() >= 5])
        return cls(
            drives, start[moving], end[moving], ahead[moving], (way[end] - way[start])[moving]
        )

    def errors(self, model: DriveModel, values: Array, part: np.ndarray | None = None) -> Array:
        """Errors (n, 3) forwards, to the left and in heading [m, m, rad] of F parameter sets (F,
        p); NaN if unknown.

        `part` (n,) is the index of the parameter set that predicts each pair.
        """
        part = np.zeros(len(self.start), int) if part is None else part
        drives, error = self.drives, np.full((len(part), 3), np.nan)
        for k, parameters in enumerate(values):
            start, end = self.start[part == k], self.end[part == k]
            path = model.path(parameters, drives, np.zeros(0, int))
            heading = _headings(drives, path)
            turn = heading[start] - path.heading[start]
            moved = (path.place[end] - path.place[start]) * np.exp(1j * turn)
            missed = (moved - (drives.place[end] - drives.place[start])) * np.exp(
                -1j * heading[start]
            )
            off = wrap_angle(
                path.heading[end]
                - path.heading[start]
                - (drives.heading[end] - drives.heading[start])
            )
            placed, headed = drives.known[:, start] & drives.known[:, end]
            missed[~placed] = off[~headed] = np.nan
            error[part == k] = np.column_stack([missed.real, missed.imag, off])
        return error

    def held_out_errors(self, fit: WindowFit) -> Array:
        """Prediction errors (n, 3) by fits that leave out a fifth of all blocks, including the
        block of each pair.
        """
        count = len(fit.score)
        number, fold = np.unique(np.arange(count) % FOLDS, return_inverse=True)
        values = fit.without(fold == np.arange(len(number))[:, None])
        return self.errors(fit.model, values, fold[np.minimum(fit.block[self.start], count - 1)])

    def summaries(self, error: Array) -> dict[float, PredictionErrors]:
        """Summarise errors (n, 3) by horizon [s]."""
        every = {horizon: self.horizon == horizon for horizon in np.unique(self.horizon).tolist()}
        return {
            h: PredictionErrors.of(self.way[rows], *sizes(error)[rows].T)
            for h, rows in every.items()
        }

    def criteria(self, errors: Mapping[str, Array]) -> list[Criterion]:
        """Make a criterion for each horizon from errors (n, 3) by law.

        A pair's error is the sum of its position and heading errors, each relative to the smallest
        mean of any law. Absolute errors are averaged, not squares: a wrong pose then matters no
        more than the laws' predictions differ there, whereas its square could decide the
        comparison.
        """
        criteria, every = [], np.stack([sizes(error) for error in errors.values()])  # (laws, n, 2)
        for horizon in np.unique(self.horizon):
            rows = self.horizon == horizon
            size = every[:, rows]
            known = np.isfinite(size).all(axis=0)  # for every law
            if not known.any():
                continue
            size = np.where(known, size, 0.0)
            least = (size.sum(axis=1) / np.maximum(known.sum(axis=0), 1)).min(axis=0)
            relative = (size / np.maximum(least, LEAST_ERROR)).sum(axis=2)
            block = self.drives.blocks(horizon)[self.start[rows]]
            criteria.append(
                Criterion(dict(zip(errors, relative, strict=True)), block, 2 * LEAST_ERROR)
            )
        return criteria


def sizes(error: Array) -> Array:
    """Sizes (n, 2) of errors (n, 3) in position [m] and heading [rad]."""
    return np.column_stack([np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])])


def _headings(drives: Drives, path: Path) -> Array:
    """Sensor headings (K,) [rad]: measured or, in drives without headings, from fits of the path to
    past positions.
    """
    heading = np.where(drives.known[1], drives.heading, np.nan)
    for drive, begin, end in zip(drives.drives, drives.first[:-1], drives.first[1:], strict=True):
        if not drive.has_heading:
            rows = begin + np.flatnonzero(drives.known[0][begin:end])
            here = path.place[rows], path.heading[rows]
            heading[rows] = trailing_heading(drive.time[rows - begin], drives.place[rows], *here)
    return heading


def trailing_heading(time: Array, measured: np.ndarray, place: np.ndarray, heading: Array) -> Array:
    """Headings (n,) at which dead reckoning fits the positions of the last 10 s; NaN if positions
    are too few.

    The positions `measured` (n,) at `time` (n,) and the positions `place` (n,) are complex, x + i
    y. `place` and `heading` (n,) are from dead reckoning with any start pose.
    """
    place = place - place[:1]
    values = [np.ones(len(place)), measured, place, measured * place.conj(), np.abs(place) ** 2]
    sums = np.concatenate([np.zeros((5, 1)), np.cumsum(values, axis=1)], axis=1)
    begin = np.searchsorted(time, time - 10.0)
    number, there, here, product, square = sums[:, 1:] - sums[:, begin]
    size = (square / number).real - np.abs(here / number) ** 2
    # positions over 0.5 m: noise of 2 cm is a few degrees
    known = (number.real >= 5) & (size > 0.15**2)
    return np.where(known, np.angle(product - there * here.conj() / number) + heading, np.nan)


def slip_noise(
    error: Array, pairs: Pairs, spread: Array, ahead: Sequence[float] = HORIZONS
) -> dict[str, float]:
    """Varying slip as a random walk of the pose [m/√m, m/√m, rad/√m], estimated from prediction
    errors (n, 3).

    The variance of errors, from medians, is the variance of two poses plus a part that grows with
    the distance driven, between the shortest and the longest horizon in `ahead` [s]. With a single
    horizon, `spread` (3,) has the standard deviations of poses. Errors in the first heading and in
    turns add to the sideways variance.
    """
    names, horizons = (
        ("slip_forward", "slip_sideways", "slip_turn"),
        np.intersect1d(pairs.horizon, ahead),
    )
    if not len(horizons):
        return dict.fromkeys(names, 0.0)
    rows = [pairs.horizon == horizon for horizon in horizons[[0, -1]]]
    moved = np.abs(pairs.drives.place[pairs.end] - pairs.drives.place[pairs.start]) ** 2
    way, reach = (
        np.array([np.median(values[row]) for row in rows]) for values in (pairs.way, moved)
    )
    # (2, 3)
    variance = np.array([[_robust_variance(part) for part in error[row].T] for row in rows])
    if way[1] - way[0] < 1e-6:
        way, reach = np.array([0.0, way[0]]), np.array([0.0, reach[0]])
        variance = np.stack([2 * spread[[0, 0, 1]] ** 2, variance[0]])
    per_way = np.maximum((variance[1] - variance[0]) / (way[1] - way[0]), 0.0)
    heading = max(variance[0, 2] - per_way[2] * way[0], 0.0) / 2  # variance of one heading
    aside = variance[:, 1] - (heading + per_way[2] * way / 3) * reach
    per_way[1] = max((aside[1] - aside[0]) / (way[1] - way[0]), 0.0)
    # the growth is a difference between large numbers: medians don't resolve less than 1 % of these
    per_way = np.maximum(per_way, 0.01 * variance[1] / max(way[1], 1e-9))
    return dict(zip(names, np.sqrt(per_way).tolist(), strict=True))


def _robust_variance(values: Array) -> float:
    """Variance of values (n,) from their median size, as for a normal distribution; 0 without
    values other than NaN.
    """
    size = np.abs(values[np.isfinite(values)])
    return float((1.4826 * np.median(size)) ** 2) if len(size) else 0.0
