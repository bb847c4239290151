"""Predictions of motion that laws were not fitted to: left-out steady runs, and driving some seconds ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackslip.identification.drive_fit import TrajectoryFit, fit_trajectory
from trackslip.identification.drive_residuals import Nodes
from trackslip.identification.fitted import SteadyFit
from trackslip.identification.lack_of_fit import by_command, by_speed, folds
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_fit import fit
from trackslip.identification.weighting import WeightedRuns, relative_errors
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.metrics import rms
from trackslip.se2 import rotate
from trackslip.slip.families import FAMILIES

_MIN_RADII = 3  # minimum number of folds of radii to judge laws by
_MIN_RUNS = 6  # minimum number of runs to judge laws by
_PARTS = 10  # number of folds of runs
_CHANCE = 1.0  # difference of squared errors that may be chance [standard errors]
_ROUGHLY = 1e-8  # tolerance of the fits: errors of predictions depend on them but weakly
_NEGLIGIBLE = 1e-3  # relative error of the track speeds that no ground and no encoder repeats, and no law need predict
HORIZONS = (1.0, 2.0, 5.0, 10.0)
"""Horizons of the predictions [s]."""
_MAX_FOLDS = 5
_TRAIL = 10.0  # time over which positions give the heading at the start, without headings [s]
_MIN_TRAIL = 5  # number of those positions
_MIN_WAY = 0.3  # that the positions span [m]


@dataclass(frozen=True)
class CrossValidation:
    """Prediction errors of a law for runs it was not fitted to; None if the runs do not form two groups.

    The first three are root mean squares of the errors of the track speeds, relative to the faster sprocket's.
    """

    radius: float | None
    """Leaving out one radius at a time [-]."""
    speed: float | None
    """Leaving out one speed at a time [-]."""
    run: float | None
    """Leaving out every tenth run [-]."""
    yaw_rate: float | None
    """Rms error of the yaw rate predicted from sprocket speeds, leaving out one radius at a time [rad/s]."""
    linear_speed: float | None
    """Rms error of the speed predicted from sprocket speeds, leaving out one radius at a time [m/s]."""


@dataclass(frozen=True)
class RunPredictions:
    """Twists (n, 2) of runs as predicted by fits to the others; None where the others are too few."""

    radius: Array | None
    """Leaving out one radius at a time."""
    speed: Array | None
    """Leaving out one speed at a time."""
    run: Array | None
    """Leaving out every tenth run."""

    @classmethod
    def of(cls, law: SteadyFit, samples: SlipSamples, geometry: RobotGeometry) -> RunPredictions:
        """The predictions of the law's family, refitted without the runs that are predicted."""
        of_runs = np.arange(len(samples)) % _PARTS
        groupings = folds(by_command(samples.omega, geometry)), folds(by_speed(samples.omega)), of_runs
        return cls(*_predicted_runs(law, WeightedRuns.of(samples, geometry), groupings))

    def errors(self, samples: SlipSamples, geometry: RobotGeometry) -> CrossValidation:
        """Their root mean square errors."""
        radius, speed, run = (
            None if twist is None else rms(relative_errors(twist, samples, geometry))
            for twist in (self.radius, self.speed, self.run)
        )
        missed = None if self.radius is None else self.radius - samples.twist
        linear_speed, yaw_rate = (None, None) if missed is None else (rms(missed[:, 0]), rms(missed[:, 1]))
        return CrossValidation(radius, speed, run, yaw_rate, linear_speed)


def best_predictors(
    predictions: Mapping[str, RunPredictions], samples: SlipSamples, geometry: RobotGeometry, scatter: float
) -> tuple[dict[str, float], str] | None:
    """The laws that predict radii, then runs, that they were not fitted to as well as any other; and which of these.

    Laws are judged by the squared errors of the track speeds, relative to the faster sprocket's. Runs are weighted by
    their errors of measurement and the `scatter` [-]. Returns the mean of each good law; None for too few runs.
    """
    if len(samples) < _MIN_RUNS:
        return None
    noise = WeightedRuns.of(samples, geometry).eigenvalues.mean(axis=1) + max(scatter, _NEGLIGIBLE) ** 2
    weight = np.mean(1 / noise) ** -1 / noise  # (n,), 1 in the mean

    def squares(twists: Mapping[str, Array | None]) -> dict[str, Array]:
        return {
            name: weight * np.mean(relative_errors(twist, samples, geometry) ** 2, axis=1)
            for name, twist in twists.items()
            if twist is not None
        }

    radii = squares({name: one.radius for name, one in predictions.items()})
    runs = squares({name: one.run for name, one in predictions.items()})
    many = folds(by_command(samples.omega, geometry)).max() + 1 >= _MIN_RADII
    errors, criterion = (radii, "left-out radii") if radii and many else (runs, "left-out runs")
    near = _as_good({name: value for name, value in runs.items() if name in _as_good(errors)}) or _as_good(errors)
    return ({name: float(errors[name].mean()) for name in near}, criterion) if near else None


def _as_good(errors: Mapping[str, Array]) -> list[str]:
    """Names of the laws whose mean squared errors (n,) exceed the smallest mean by no more than chance.

    Chance is one standard error of the mean difference, run by run. A difference that no robot would notice does not
    count, either.
    """
    least = min(errors.values(), key=np.mean, default=np.zeros(0))

    def worse(squares: Array) -> bool:
        excess = squares - least
        chance = _CHANCE * excess.std(ddof=1) / len(excess) ** 0.5
        return bool(excess.mean() > max(chance, _NEGLIGIBLE**2))

    return [name for name, squares in errors.items() if not worse(squares)]


def _predicted_runs(law: SteadyFit, runs: WeightedRuns, groupings: Sequence[np.ndarray]) -> list[Array | None]:
    """Twists (n, 2) of the runs, each predicted by a fit to the other groups, for each way to label them (n,) by group.

    None for a way that leaves too few.
    """
    family = FAMILIES[law.name].under(runs.load)
    kept, chosen, count = [], [], 0  # weights (groups, n) of the fits, and which fit (n,) predicts each run
    for labels in groupings:
        weight = (labels != np.arange(labels.max() + 1)[:, None]).astype(float)
        enough = len(weight) > 1 and 2 * weight.sum(axis=1).min() > len(family.names)
        chosen.append(count + labels if enough else None)
        if enough:
            kept.append(weight)
            count += len(weight)
    if not kept:
        return [None] * len(groupings)
    start = np.tile([law.values[name] for name in family.names], (count, 1)).reshape(count, -1)
    weighted = runs.weighted(np.concatenate(kept))
    fits = fit(family, weighted, start, np.full(count, law.scatter), tolerance=_ROUGHLY)
    values = fits.values[[rows for rows in chosen if rows is not None]]  # (ways, n, p): a law for each run
    twists = family.law(values, runs.geometry).twist(runs.omega, runs.geometry)
    each = iter(np.broadcast_to(twists, (*values.shape[:2], 2)))
    return [None if rows is None else next(each) for rows in chosen]


@dataclass(frozen=True)
class PredictionErrors:
    """PredictionErrors of predictions for one horizon."""

    count: int
    """Number of predictions, which overlap."""
    position_rms: float
    """Root mean square error of the position [m]."""
    position_median: float
    """Median error of the position [m]."""
    heading_rms: float | None
    """Root mean square error of the heading [rad]; None without headings."""
    heading_median: float | None
    """Median absolute error of the heading [rad]; None without headings."""


@dataclass(frozen=True)
class DrivePredictions:
    """DrivePredictions of held-out driving by a law."""

    start: np.ndarray  # (n,) nodes to predict from
    heading: Array  # (n,) of the robot there [rad]
    horizon: Array  # (n,) [s]
    error: Array  # (n, 3) predicted minus measured, in the frame of the start [m, m, rad]
    """NaN headings where none were measured."""
    part: np.ndarray  # (n,) index of the fit that predicts
    values: Array  # (F, p) parameter values of those fits

    def errors(self) -> dict[float, PredictionErrors]:
        """PredictionErrors by horizon [s], of those that the drives are long enough for."""
        found = {}
        for horizon in HORIZONS:
            error = self.error[self.horizon == horizon]
            if not len(error):
                continue
            position, heading = np.hypot(error[:, 0], error[:, 1]), error[np.isfinite(error[:, 2]), 2]
            found[horizon] = PredictionErrors(
                len(error),
                rms(position),
                float(np.median(position)),
                rms(heading) if len(heading) else None,
                float(np.median(np.abs(heading))) if len(heading) else None,
            )
        return found


def held_out(found: TrajectoryFit) -> DrivePredictions:
    """DrivePredictions of driving that the law was not fitted to.

    With several drives, each is predicted by a fit to the others (in at most five groups); of a single one, the second
    half by a fit to the first. The fits start from `found`, whose outlying poses are left out everywhere.
    """
    folds = _folds(found)
    parts = [_predicted_drives(refitted, found, rows) for refitted, rows in folds]
    start, heading, horizon, error = (np.concatenate(column) for column in zip(*parts, strict=True))
    part = np.repeat(np.arange(len(parts)), [len(found[0]) for found in parts])
    return DrivePredictions(start, heading, horizon, error, part, np.array([refitted.values for refitted, _ in folds]))


def held_out_deviance(found: TrajectoryFit) -> float:
    """-2 log likelihood of poses by parameters fitted to the others, but for a constant.

    The parts are the drives, in at most five groups, or the halves of a single one.
    """
    none, folds = found.free[:0], _folds(found)
    if len(folds) == 1:
        folds.append((_refitted(found, folds[0][1]), ~folds[0][1]))
    return sum(_refitted(replace(found, values=other.values, free=none), rows).deviance for other, rows in folds)


def _folds(found: TrajectoryFit) -> list[tuple[TrajectoryFit, np.ndarray]]:
    """Fits to a part of the drives, and bool (K,) of the nodes that they were not fitted to."""
    nodes, first = found.nodes, found.nodes.first
    count = len(nodes.drives)
    if count == 1:
        fitted = np.arange(len(nodes.pose)) < len(nodes.pose) // 2
        return [(_refitted(found, fitted), ~fitted)]
    label = np.repeat(np.arange(count) * min(count, _MAX_FOLDS) // count, np.diff(first))
    return [(_refitted(found, label != one), label == one) for one in np.unique(label)]


def _refitted(found: TrajectoryFit, rows: np.ndarray) -> TrajectoryFit:
    """The fit to the nodes `rows` (K,) bool alone."""
    nodes, drives = found.nodes, []
    for drive, begin in zip(nodes.drives, nodes.first, strict=False):
        kept = rows[begin : begin + len(drive.time)]
        if kept.sum() > 1:
            drives.append(drive.kept(kept))
    whole = Nodes.of(drives)
    link = np.append(nodes.link, 0.0)[rows][:-1] * whole.link
    part = replace(whole, weight=nodes.weight[rows], link=link)
    return fit_trajectory(
        found.model,
        part,
        found.states[rows],
        found.values,
        found.noise,
        found.free,
        found.mean,
        gated=False,
        quiet=True,
    )


def _predicted_drives(
    law: TrajectoryFit, whole: TrajectoryFit, rows: np.ndarray
) -> tuple[np.ndarray, Array, Array, Array]:
    """Start, heading, horizon and error of predictions from and to nodes `rows` (K,) bool by the law of a fit."""
    nodes = whole.nodes
    found = []
    for drive, begin in zip(nodes.drives, nodes.first, strict=False):
        inside = slice(begin, begin + len(drive.time))
        usable = np.flatnonzero(rows[inside] & (nodes.weight[inside, 0] > 0))
        if len(usable) < 2:
            continue
        breaks = np.concatenate([[0.0], np.cumsum(nodes.link[begin : begin + len(drive.time) - 1] == 0)])
        path = law.model.sensor_path(law.values, drive)
        pose = drive.pose.copy()
        pose[nodes.weight[inside, 1] == 0, 2] = np.nan
        yaw = law.values[law.model.index("sensor_yaw")]
        heading = pose[:, 2] - yaw
        if not drive.has_heading:
            heading[usable] = trailing_heading(drive.time[usable], pose[usable, :2], path[usable])
        for horizon in HORIZONS:
            start, end = _pairs(drive.time, usable, horizon, drive.interval)
            whole_way = (breaks[start] == breaks[end]) & np.isfinite(heading[start])
            start, end = start[whole_way], end[whole_way]
            turned = heading[start] - path[start, 2]
            moved = rotate(turned, path[end, :2] - path[start, :2])
            missed = rotate(-heading[start], pose[start, :2] + moved - pose[end, :2])
            turn = (
                wrap_angle(turned + path[end, 2] + yaw - pose[end, 2])
                if drive.has_heading
                else np.full(len(end), np.nan)
            )
            found.append((begin + start, heading[start], np.full(len(start), horizon), np.column_stack([missed, turn])))
    if not found:
        return np.zeros(0, int), np.zeros(0), np.zeros(0), np.zeros((0, 3))
    start, headings, horizons, errors = (np.concatenate(column) for column in zip(*found, strict=True))
    return start, headings, horizons, errors


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


def score(errors: Mapping[str, Mapping[float, PredictionErrors]], names: Sequence[str]) -> dict[str, float]:
    """Mean over horizons, positions and headings of each law's rms error, relative to the smallest of any law [-]."""
    ratios: dict[str, list[float]] = {name: [] for name in names}
    for horizon in HORIZONS:
        for key in ("position_rms", "heading_rms"):
            values = {name: float(getattr(errors[name].get(horizon), key, None) or np.nan) for name in names}
            if not np.isfinite(list(values.values())).all():
                continue
            least = min(values.values())
            for name in names:
                ratios[name].append(values[name] / least)
    return {name: float(np.mean(ratio)) if ratio else np.nan for name, ratio in ratios.items()}
