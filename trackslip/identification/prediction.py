"""Predictions of driving: from each measured pose, by the belts, to the pose some seconds later."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import counted
from trackslip.identification.path import DriveModel, Path
from trackslip.identification.windows import Data, WindowFit
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.metrics import rms

FOLDS = 5
"""Parts of the driving, of every fifth block each, that are predicted by what the others tell."""
HORIZONS = (1.0, 2.0, 5.0, 10.0)
"""Times ahead [s]."""
LEAST_ERROR = 1e-3
"""Mean error, or difference of errors, that nobody notices [m, rad]."""
_SLIP = ("slip_forward", "slip_sideways", "slip_turn")


@dataclass(frozen=True)
class PredictionErrors:
    """Errors of predictions for one horizon."""

    count: int  # number of predictions, which overlap
    position_rms: float | None  # root mean square error of the position [m]; None without positions
    position_median: float | None  # median error of the position [m]; None without positions
    position_p90: float | None  # error of the position that 90 % of the predictions stay below [m]
    heading_rms: float | None  # root mean square error of the heading [rad]; None without headings
    heading_median: float | None  # median absolute error of the heading [rad]; None without headings
    heading_p90: float | None  # absolute error of the heading that 90 % of the predictions stay below [rad]
    way: float  # median way of the belts [m]


@dataclass(frozen=True)
class Pairs:
    """Pairs of measured poses between which the robot moves: every law predicts the second one from the first."""

    data: Data
    start: np.ndarray  # (n,) index of the pose
    end: np.ndarray  # (n,)
    horizon: Array  # (n,) [s]
    way: Array  # (n,) mean way of the belts in between [m]

    @classmethod
    def of(cls, data: Data, geometry: RobotGeometry, horizons: Sequence[float] = HORIZONS) -> Pairs:
        """All pairs that are a horizon apart, within half the interval between poses.

        Where poses are rarer than all horizons, pairs are neighbours.
        """
        shortest = min(drive.interval for drive in data.drives)
        if shortest > max(horizons):
            horizons = (shortest,)
        line = data.line
        turned = np.concatenate([[0.0], np.cumsum(np.abs(line.omega).mean(axis=1) * np.diff(line.edges))])
        way = geometry.sprocket_radius * np.interp(line.time, line.edges, turned)
        found = [np.zeros((3, 0))]
        for drive, begin in zip(data.drives, data.first, strict=False):
            usable = np.flatnonzero(np.isfinite(drive.pose).any(axis=1))
            time, half = drive.time[usable], drive.interval / 2
            for horizon in horizons:
                end = np.clip(np.searchsorted(time, time + horizon - half), 0, len(time) - 1)
                hit = np.flatnonzero(np.abs(time[end] - time - horizon) <= half + 1e-9)
                found.append(np.stack([begin + usable[hit], begin + usable[end[hit]], np.full(len(hit), horizon)]))
        *rows, ahead = np.concatenate(found, axis=1)
        start, end = np.array(rows, int)
        kept = way[end] - way[start] > 0.1 * geometry.half_gauge  # it moves
        kept &= np.isin(ahead, [h for h in horizons if (ahead[kept] == h).sum() >= 5])
        return cls(data, start[kept], end[kept], ahead[kept], (way[end] - way[start])[kept])

    def errors(self, model: DriveModel, values: Array, part: np.ndarray | None = None) -> Array:
        """Errors (n, 3) forwards, to the left and of the heading by parameters (F, p) [m, m, rad]; NaN if unknown.

        `part` (n,) says which of the F predicts each pair.
        """
        part = np.zeros(len(self.start), int) if part is None else part
        data, error = self.data, np.full((len(part), 3), np.nan)
        for k, parameters in enumerate(values):
            start, end = self.start[part == k], self.end[part == k]
            path = model.path(parameters, data.line, np.zeros(0, int))
            heading = _headings(data, path)
            turn = heading[start] - path.heading[start]
            moved = (path.place[end] - path.place[start]) * np.exp(1j * turn)
            missed = (moved - (data.place[end] - data.place[start])) * np.exp(-1j * heading[start])
            off = wrap_angle(path.heading[end] - path.heading[start] - (data.heading[end] - data.heading[start]))
            placed, headed = data.known[:, start] & data.known[:, end]
            missed[~placed] = off[~headed] = np.nan
            error[part == k] = np.column_stack([missed.real, missed.imag, off])
        return error

    def summaries(self, error: Array) -> dict[float, PredictionErrors]:
        """PredictionErrors by horizon [s] of errors (n, 3)."""
        size, summaries = sizes(error), {}
        for horizon in np.unique(self.horizon).tolist():
            rows = self.horizon == horizon
            position, heading = (part[np.isfinite(part)] for part in size[rows].T)
            count = max(len(position), len(heading))
            way = float(np.median(self.way[rows]))
            summaries[horizon] = PredictionErrors(count, *_summary(position), *_summary(heading), way)
        return summaries


def folds(fit: WindowFit, pairs: Pairs) -> tuple[Array, np.ndarray]:
    """Parameters (F, p) without every fifth block, one step from the fit, and which of them predict the pairs (n,)."""
    count = len(fit.score)
    number, fold = np.unique(np.arange(count) % FOLDS, return_inverse=True)
    return fit.without(fold == np.arange(len(number))[:, None]), fold[np.minimum(fit.block[pairs.start], count - 1)]


def held_out(fit: WindowFit, pairs: Pairs) -> Array:
    """Errors (n, 3) of pairs that are predicted by what the other blocks tell."""
    values, part = folds(fit, pairs)
    return pairs.errors(fit.model, values, part)


def sizes(error: Array) -> Array:
    """Sizes (n, 2) of errors (n, 3) of position [m] and heading [rad]."""
    return np.column_stack([np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])])


def _summary(size: Array) -> tuple[float | None, float | None, float | None]:
    """Root mean square, median and 90 % quantile of errors (n,); None without any."""
    if not len(size):
        return None, None, None
    return rms(size), float(np.median(size)), float(np.quantile(size, 0.9))


def _headings(data: Data, path: Path) -> Array:
    """Headings (K,) of the sensor as measured, else those at which its path fits the positions so far."""
    heading = np.where(data.known[1], data.heading, np.nan)
    for drive, begin, end in zip(data.drives, data.first[:-1], data.first[1:], strict=True):
        if not drive.has_heading:
            rows = begin + np.flatnonzero(data.known[0][begin:end])
            here = path.place[rows], path.heading[rows]
            heading[rows] = _trailing_heading(drive.time[rows - begin], data.place[rows], *here)
    return heading


def trailing_heading(time: Array, position: Array, path: Array) -> Array:
    """Headings (n,) at which dead reckoning fits the positions measured in the last seconds; NaN where these are few.

    `position` (n, 2) is measured at `time` (n,), where dead reckoning from anywhere gives `path` (n, 3).
    """
    return _trailing_heading(time, position @ [1, 1j], path[:, :2] @ [1, 1j], path[:, 2])


def _trailing_heading(time: Array, z: np.ndarray, c: np.ndarray, heading: Array) -> Array:
    """Headings (n,) from 10 s of positions z and places c of the path (n,), complex, and headings on the path."""
    c = c - c[:1]
    sums = np.cumsum([np.ones(len(z)), z, c, z * c.conj(), np.abs(c) ** 2], axis=1)
    sums = np.concatenate([np.zeros((5, 1)), sums], axis=1)
    begin = np.searchsorted(time, time - 10.0)
    number, a, b, product, square = sums[:, 1:] - sums[:, begin]
    size = (square / number).real - np.abs(b / number) ** 2
    told = (number.real >= 5) & (size > 0.15**2)  # positions on 0.5 m, which noise of 2 cm turns by few degrees
    return np.where(told, np.angle(product - a * b.conj() / number) + heading, np.nan)


@dataclass(frozen=True)
class Ranking:
    """Laws compared by their errors, pair by pair."""

    best: str  # the simplest of those that predict as well as any other
    reason: str  # why, in a sentence
    score: dict[str, float]  # mean over the horizons of each law's mean error, relative to the smallest [-]


def ranked(errors: Mapping[str, Array], terms: Mapping[str, float], pairs: Pairs) -> Ranking | None:
    """The best of laws with errors (n, 3) of the same pairs, the simpler the fewer their `terms`; None without pairs.

    The leader has the smallest errors at most horizons. Laws that predict as well at most of them, within a standard
    error of the mean difference over blocks, count as equal, and of these the simplest is best. An error is the
    distance of the predicted position plus that of the heading, in units of the smallest means of any law: a mean of
    distances, because a pose that is wrong adds no more to it than laws differ, where squares would let it decide.
    """
    names, means, equal = list(errors), [], []
    every = np.stack([sizes(error) for error in errors.values()])  # (laws, n, 2)
    for horizon in np.unique(pairs.horizon):
        rows = pairs.horizon == horizon
        size = every[:, rows]
        known = np.isfinite(size).all(axis=0)  # by every law
        if not known.any():
            continue
        size = np.where(known, size, 0.0)
        least = (size.sum(axis=1) / np.maximum(known.sum(axis=0), 1)).min(axis=0)
        error = (size / np.maximum(least, LEAST_ERROR)).sum(axis=2)
        block = pairs.data.blocks(horizon)[pairs.start[rows]]
        means.append(error.mean(axis=1))
        equal.append([as_good_as(error, leader, block, 2 * LEAST_ERROR) for leader in range(len(names))])
    if not means:
        return None
    score = np.mean([(mean + 1e-9) / (mean.min() + 1e-9) for mean in means], axis=0)
    wins = np.bincount([int(mean.argmin()) for mean in means], minlength=len(names))
    leader = min(range(len(names)), key=lambda k: (-wins[k], score[k]))
    as_good = np.sum(equal, axis=0)[leader]
    good = np.flatnonzero(2 * as_good > len(means)).tolist()
    best = min(good, key=lambda k: (terms[names[k]], k != leader, score[k]))
    why = f"{names[leader]} has the smallest errors at {wins[leader]} of {counted(len(means), 'time')} ahead"
    if best != leader:
        why += f"; {names[best]} is as good at {as_good[best]}, within one standard error, and simpler to use"
    return Ranking(names[best], why, dict(zip(names, score.tolist(), strict=True)))


def as_good_as(errors: Array, leader: int, block: np.ndarray, unnoticed: float) -> np.ndarray:
    """Laws (L,) bool whose mean errors, of (L, n), exceed the leader's by no more than chance or than matters.

    Chance is a standard error, from the scatter of the sums over the independent blocks (n,). Of fewer than five, which
    tell no scatter, it is a quarter of the leader's errors.
    """
    worse = errors - errors[leader]
    mean, (number, block) = worse.mean(axis=1), np.unique(block, return_inverse=True)
    count = len(number)
    if count < 5:
        return np.asarray(mean <= 0.25 * errors[leader].mean())
    sums = np.array([np.bincount(block, each) for each in worse - mean[:, None]])
    chance = np.sqrt(np.sum(sums**2, axis=1) * count / (count - 1)) / len(block)
    return np.asarray(mean <= np.maximum(chance, unnoticed))


def slip_noise(error: Array, pairs: Pairs, spread: Array, ahead: Sequence[float] = HORIZONS) -> dict[str, float]:
    """Slip that varies, a random walk of the pose [m/√m, m/√m, rad/√m], from errors (n, 3) of predictions.

    Their variance, by medians, is that of two poses and one that grows with the way from the shortest horizon `ahead`
    [s] to the longest. With one horizon, poses have the `spread` (3,). Errors of the first heading and of turns add to
    the sides.
    """
    horizons = np.intersect1d(pairs.horizon, ahead)
    if not len(horizons):
        return dict.fromkeys(_SLIP, 0.0)
    rows = [pairs.horizon == horizon for horizon in horizons[[0, -1]]]
    moved = np.abs(pairs.data.place[pairs.end] - pairs.data.place[pairs.start]) ** 2
    way, reach = (np.array([np.median(values[row]) for row in rows]) for values in (pairs.way, moved))
    variance = np.array([[_robust_variance(part) for part in error[row].T] for row in rows])  # (2, 3)
    if way[1] - way[0] < 1e-6:
        way, reach = np.array([0.0, way[0]]), np.array([0.0, reach[0]])
        variance = np.stack([2 * spread[[0, 0, 1]] ** 2, variance[0]])
    per_way = np.maximum((variance[1] - variance[0]) / (way[1] - way[0]), 0.0)
    heading = max(variance[0, 2] - per_way[2] * way[0], 0.0) / 2  # variance of one
    aside = variance[:, 1] - (heading + per_way[2] * way / 3) * reach
    per_way[1] = max((aside[1] - aside[0]) / (way[1] - way[0]), 0.0)
    # growth is a difference of large numbers: medians don't tell less than a hundredth
    per_way = np.maximum(per_way, 0.01 * variance[1] / max(way[1], 1e-9))
    return dict(zip(_SLIP, np.sqrt(per_way).tolist(), strict=True))


def _robust_variance(values: Array) -> float:
    """Variance of normal numbers with the median size of these (n,), NaN left out; 0 of none."""
    size = np.abs(values[np.isfinite(values)])
    return float((1.4826 * np.median(size)) ** 2) if len(size) else 0.0
