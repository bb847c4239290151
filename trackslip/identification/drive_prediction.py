"""Predictions of driving that laws were not fitted to, some seconds ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackslip.errors import counted
from trackslip.identification.drive_fit import TrajectoryFit, far_off, fit_trajectory
from trackslip.identification.drive_model import DriveModel
from trackslip.identification.drive_residuals import Nodes
from trackslip.identification.drives import PreparedDrive
from trackslip.identification.plausibility import least_squares_gains
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.metrics import rms
from trackslip.se2 import Mounting, rotate
from trackslip.slip.families import FAMILIES

_CHANCE = 1.0  # difference of errors that may be chance [standard errors]
HORIZONS = (1.0, 2.0, 5.0, 10.0)
"""Horizons of the predictions [s]."""
_MAX_FOLDS = 5
_TRAIL = 10.0  # time over which positions give the heading at the start, without headings [s]
_MIN_TRAIL = 5  # number of those positions
_MIN_WAY = 0.3  # that the positions span [m]
TODAY, GAINS = "today", "two_gains"
"""Names of the predictions without identification."""
_MIN_DRIVEN = 0.1  # way of the belts during which a robot moves [half gauges]
_MIN_PAIRS = 10  # at a horizon
_STRETCH = 5.0  # duration of stretches whose errors are independent [s]
_LEAST_ERROR = 1e-3  # mean error below which no law is better [m, rad]
_UNNOTICED = 0.002  # difference of errors that doesn't matter [smallest mean error]


@dataclass(frozen=True)
class PredictionErrors:
    """Errors of predictions for one horizon."""

    count: int
    """Number of predictions, which overlap."""
    position_rms: float
    """Root mean square error of the position [m]."""
    position_median: float
    """Median error of the position [m]."""
    position_p90: float
    """Error of the position that 90 % of the predictions stay below [m]."""
    heading_rms: float | None
    """Root mean square error of the heading [rad]; None without headings."""
    heading_median: float | None
    """Median absolute error of the heading [rad]; None without headings."""
    heading_p90: float | None
    """Absolute error of the heading that 90 % of the predictions stay below [rad]; None without headings."""


@dataclass(frozen=True)
class ScoredPairs:
    """Pairs of measured poses that every law predicts the second of: the robot moves in between.

    Outlying poses are among them; only a lasting jump of the poses breaks a pair. Of a single drive, pairs are of the
    second half.
    """

    nodes: Nodes  # all measured poses
    start: np.ndarray  # (n,) nodes
    end: np.ndarray  # (n,) nodes
    horizon: Array  # (n,) [s]
    folds: np.ndarray | None = None  # (D,) of the drives: those of a fold are predicted by fits to the other folds

    @classmethod
    def of(
        cls, reference: TrajectoryFit, horizons: Sequence[float] = HORIZONS, folds: np.ndarray | None = None
    ) -> ScoredPairs:
        """The pairs of the drives of a fit, whose trajectory tells where poses jump.

        By default, a single drive has halves as folds, and several drives are in at most five.
        """
        model, nodes = reference.model, Nodes.of(reference.nodes.drives)
        _, jumped = far_off(model, nodes, reference.states, reference.values, reference.residuals.path)
        jumps = np.concatenate([[0], np.cumsum(jumped)])
        line = nodes.timeline
        turned = np.concatenate([[0.0], np.cumsum(np.abs(line.omega).mean(axis=1) * np.diff(line.edges))])
        at = line.within(line.time + reference.values[model.index("clock_offset")])
        way = model.geometry.sprocket_radius * np.interp(at, line.edges, turned)
        inside = np.any(_held(nodes, folds), axis=0) & np.isfinite(nodes.pose[:, 0])
        found = [np.zeros((3, 0))]
        for drive, begin in zip(nodes.drives, nodes.first, strict=False):
            usable = np.flatnonzero(inside[begin : begin + len(drive.time)])
            for horizon in horizons if len(usable) else ():
                pairs = begin + np.stack(_pairs(drive.time, usable, horizon, drive.interval)).astype(float)
                found.append(np.insert(pairs, 2, horizon, axis=0))
        *rows, ahead = np.concatenate(found, axis=1)
        start, end = np.array(rows, int)
        kept = (way[end] - way[start] > _MIN_DRIVEN * model.geometry.half_gauge) & (jumps[start] == jumps[end])
        kept &= np.isin(ahead, [h for h in horizons if (ahead[kept] == h).sum() >= _MIN_PAIRS])
        return cls(nodes, start[kept], end[kept], ahead[kept], folds)

    @property
    def held(self) -> list[np.ndarray]:
        """Bool (K,) of the nodes of each fold."""
        return _held(self.nodes, self.folds)

    @property
    def part(self) -> np.ndarray:
        """(n,) index of the fold that each pair is in."""
        return np.argmax([rows[self.start] for rows in self.held], axis=0)

    @property
    def drive(self) -> np.ndarray:
        """(n,) index of the drive that each pair is of."""
        return np.searchsorted(self.nodes.first, self.start, side="right") - 1


@dataclass(frozen=True)
class DrivePredictions:
    """Predictions of held-out driving by a law, one for each of the pairs."""

    start: np.ndarray  # (n,) nodes to predict from
    heading: Array  # (n,) of the robot there [rad]; NaN where unknown, and so is then the error
    horizon: Array  # (n,) [s]
    error: Array  # (n, 3) predicted minus measured, in the frame of the start [m, m, rad]
    """NaN headings where none were measured."""
    part: np.ndarray  # (n,) index of the fit that predicts
    values: Array  # (F, p) parameter values of those fits

    @property
    def sizes(self) -> Array:
        """Errors (n, 2) of position [m] and heading [rad]."""
        return np.column_stack([np.hypot(self.error[:, 0], self.error[:, 1]), np.abs(self.error[:, 2])])

    def errors(self) -> dict[float, PredictionErrors]:
        """PredictionErrors by horizon [s], of those that the drives are long enough for."""
        found = {}
        for horizon in np.unique(self.horizon).tolist():
            position, heading = (size[np.isfinite(size)] for size in self.sizes[self.horizon == horizon].T)
            if len(position):
                headings = _summary(heading) if len(heading) else (None, None, None)
                found[horizon] = PredictionErrors(len(position), *_summary(position), *headings)
        return found


def _summary(size: Array) -> tuple[float, float, float]:
    """Root mean square, median and 90 % quantile of errors (n,)."""
    return rms(size), float(np.median(size)), float(np.quantile(size, 0.9))


def held_out(found: TrajectoryFit, pairs: ScoredPairs | None = None) -> DrivePredictions:
    """Predictions of driving that the law was not fitted to, by default of the pairs that `found` itself tells.

    Each fold is predicted by a fit to the others; of a single drive, the second half by a fit to the first. The fits
    start from `found`, and leave out the poses that it leaves out.
    """
    pairs = pairs or ScoredPairs.of(found)
    values = np.array([refitted(found, ~rows).values for rows in pairs.held])
    return predicted(found.model, values, pairs.part, pairs)


def held_out_deviance(found: TrajectoryFit) -> float:
    """-2 log likelihood of poses by parameters fitted to the others, but for a constant.

    The parts are the drives, in at most five groups, or the halves of a single one.
    """
    held, none = _held(found.nodes), found.free[:0]
    if len(held) == 1:
        held.append(~held[0])
    others = [refitted(found, ~rows).values for rows in held]
    return sum(
        refitted(replace(found, values=values, free=none), rows).deviance
        for values, rows in zip(others, held, strict=True)
    )


def baselines(pairs: ScoredPairs, geometry: RobotGeometry, sensor: Mounting | None) -> dict[str, DrivePredictions]:
    """Predictions by what needs no identification: TODAY, dead reckoning without slip, and GAINS.

    GAINS are factors on speed and yaw rate from a plain least-squares fit of ways and turns to those of the sprockets
    in the driving that isn't predicted. Neither knows delays, nor the sensor's place but for the one given.
    """
    plain = DriveModel(FAMILIES["none"], geometry)
    extras = np.zeros(len(plain.names))
    if sensor is not None:
        extras[[plain.index(f"sensor_{name}") for name in ("x", "y", "yaw")]] = sensor.x, sensor.y, sensor.yaw
    found = {TODAY: predicted(plain, extras[None], np.zeros(len(pairs.start), int), pairs)}
    gains = np.array([least_squares_gains(_part(pairs.nodes, ~rows), geometry) for rows in pairs.held])
    if np.isfinite(gains).all():
        speed, turn = gains.T  # as (1 + epsilon) and (1 + epsilon) b / (b + D)
        law = np.column_stack([geometry.half_gauge * (speed / np.maximum(turn, 0.01) - 1), speed - 1])
        values = np.column_stack([law, np.broadcast_to(extras, (len(law), len(extras)))])
        found[GAINS] = predicted(DriveModel(FAMILIES["icr_radius"], geometry), values, pairs.part, pairs)
    return found


def _held(nodes: Nodes, folds: np.ndarray | None = None) -> list[np.ndarray]:
    """Bool (K,) of the nodes that are predicted by fits to the others: a fold (D,) of drives, or half of a single one.

    By default, there are at most five folds.
    """
    count = len(nodes.drives)
    if count == 1:
        return [np.arange(len(nodes.pose)) >= len(nodes.pose) // 2]
    default = np.arange(count) * min(count, _MAX_FOLDS) // count
    label = np.repeat(default if folds is None else folds, np.diff(nodes.first))
    return [label == one for one in np.unique(label)]


def _part(nodes: Nodes, rows: np.ndarray) -> list[PreparedDrive]:
    """The drives with the nodes `rows` (K,) bool alone; those with less than two are left out."""
    parts = zip(nodes.drives, np.split(rows, nodes.first[1:-1]), strict=True)
    return [drive.kept(kept) for drive, kept in parts if kept.sum() > 1]


def refitted(found: TrajectoryFit, rows: np.ndarray) -> TrajectoryFit:
    """The fit to the nodes `rows` (K,) bool alone, with the noise of `found` and what that left out."""
    whole = Nodes.of(_part(found.nodes, rows))
    link = np.append(found.nodes.link, 0.0)[rows][:-1] * whole.link
    part = replace(whole, weight=found.nodes.weight[rows], link=link)
    states, mean = found.states[rows], found.mean
    return fit_trajectory(
        found.model, part, states, found.values, found.noise, found.free, mean, gated=False, quiet=True
    )


def predicted(model: DriveModel, values: Array, part: np.ndarray, pairs: ScoredPairs) -> DrivePredictions:
    """Predictions of pairs by the laws with `values` (F, p), of which `part` (n,) is that of each pair."""
    nodes, error, heading = pairs.nodes, np.full((len(part), 3), np.nan), np.full(len(part), np.nan)
    for k, one in enumerate(values):
        start, end = pairs.start[part == k], pairs.end[part == k]
        yaw = one[model.index("sensor_yaw")]
        path = model.of_sensor(one, model.steps(one, nodes.timeline, np.zeros(0, int)).path)
        headings = _headings(nodes, path, yaw)[start]
        turned = headings - path[start, 2]
        moved = rotate(turned, path[end, :2] - path[start, :2])
        missed = rotate(-headings, nodes.pose[start, :2] + moved - nodes.pose[end, :2])
        turn = wrap_angle(turned + path[end, 2] + yaw - nodes.pose[end, 2])
        heading[part == k], error[part == k] = headings, np.column_stack([missed, turn])
    return DrivePredictions(pairs.start, heading, pairs.horizon, error, part, values)


def _headings(nodes: Nodes, path: Array, yaw: float) -> Array:
    """Headings (K,) of the robot as measured by a sensor turned by `yaw`, else those that fit the way so far."""
    heading = nodes.pose[:, 2] - yaw
    for drive, begin, end in zip(nodes.drives, nodes.first[:-1], nodes.first[1:], strict=True):
        if not drive.has_heading:
            rows = begin + np.flatnonzero(np.isfinite(nodes.pose[begin:end, 0]))
            heading[rows] = trailing_heading(nodes.time[rows], nodes.pose[rows, :2], path[rows])
    return heading


def _pairs(time: Array, usable: np.ndarray, horizon: float, interval: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes out of `usable`, and those that follow them after the horizon [s], within half an interval."""
    times = time[usable]
    near = np.clip(np.searchsorted(times, times + horizon - interval / 2), 0, len(times) - 1)
    hit = np.abs(times[near] - times - horizon) <= interval / 2 + 1e-9
    return usable[hit], usable[near[hit]]


def trailing_heading(time: Array, position: Array, path: Array) -> Array:
    """Headings (n,) at which dead reckoning fits the positions measured in the last seconds; NaN where these are few.

    `position` (n, 2) is measured at `time` (n,), where dead reckoning from anywhere gives `path` (n, 3).
    """
    z, c = position[:, 0] + 1j * position[:, 1], path[:, 0] + 1j * path[:, 1]
    sums = np.concatenate([np.zeros((4, 1)), np.cumsum([np.ones(len(z)), z, c, z * c.conj()], axis=1)], axis=1)
    spread = np.concatenate([[0.0], np.cumsum(np.abs(c - c[0]) ** 2)])
    offset = np.concatenate([[0.0], np.cumsum(c - c[0])])
    low, high = np.searchsorted(time, time - _TRAIL), np.arange(1, len(time) + 1)
    number, a, b, product = sums[:, high] - sums[:, low]
    number = number.real
    size = (spread[high] - spread[low]) / number - np.abs((offset[high] - offset[low]) / number) ** 2
    turned = np.angle(product - a * b.conj() / number)
    known = (number >= _MIN_TRAIL) & (size > (_MIN_WAY / 2) ** 2)
    return np.asarray(np.where(known, turned + path[:, 2], np.nan))


def best_of_drives(
    predictions: Mapping[str, DrivePredictions], free: Mapping[str, int], pairs: ScoredPairs
) -> tuple[str, str, dict[str, float]] | None:
    """The best law, a sentence on why, and the scores of all, with `free` parameters each; None without predictions.

    The leader has the smallest errors at most horizons. Laws that predict as well at most of them, within a standard
    error of the mean difference over stretches, count as equal, and of these the simplest is best. An error is the
    distance of the predicted position plus that of the heading, in units of the smallest means of any law: a mean of
    distances, because a pose that is wrong adds no more to it than laws differ, where squares would let it decide.
    """
    names, means, equal = list(predictions), [], []
    for horizon in np.unique(pairs.horizon):
        rows = (pairs.horizon == horizon) & np.all([np.isfinite(one.error[:, 0]) for one in predictions.values()], 0)
        if rows.any():
            sizes = np.stack([one.sizes[rows] for one in predictions.values()])  # (laws, n, 2)
            known = np.isfinite(sizes[0]).any(axis=0)
            sizes = sizes[..., known] / np.maximum(np.nanmean(sizes[..., known], axis=1).min(axis=0), _LEAST_ERROR)
            errors = np.nan_to_num(sizes).sum(axis=2)
            stretch = pairs.nodes.time[pairs.start[rows]] // max(_STRETCH, 2 * horizon)
            block = np.unique(np.stack([pairs.drive[rows], stretch]), axis=1, return_inverse=True)[1].reshape(-1)
            means.append(errors.mean(axis=1))
            equal.append([_as_good_as(errors, block, leader) for leader in range(len(names))])
    if not means:
        return None
    score = np.mean([mean / mean.min() for mean in means], axis=0)
    wins = np.bincount([int(mean.argmin()) for mean in means], minlength=len(names))
    leader = min(range(len(names)), key=lambda k: (-wins[k], score[k]))
    as_good = np.sum([one[leader] for one in equal], axis=0)
    good = np.flatnonzero(2 * as_good > len(means)).tolist()
    best = min(good, key=lambda k: (free[names[k]], k != leader, score[k]))
    why = f"{names[leader]} has the smallest errors at {wins[leader]} of {counted(len(means), 'horizon')}"
    if best != leader:
        why += f"; {names[best]} is as good at {as_good[best]}, within one standard error, and is simpler"
    return names[best], why, dict(zip(names, score.tolist(), strict=True))


def _as_good_as(errors: Array, block: np.ndarray, leader: int) -> np.ndarray:
    """Laws (L,) bool whose mean errors, of (L, n), exceed the leader's by no more than chance or than matters.

    Chance is a standard error, from the scatter of the sums over the independent blocks (n,).
    """
    worse = errors - errors[leader]
    mean, count = worse.mean(axis=1), int(block.max()) + 1
    sums = np.array([np.bincount(block, one) for one in worse - mean[:, None]])
    chance = np.sqrt(np.sum(sums**2, axis=1) * count / max(count - 1, 1)) / len(block)
    return np.asarray(mean <= np.maximum(_CHANCE * chance, _UNNOTICED))
