"""Predictions of steady runs that laws were not fitted to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.identification.fitted import SteadyFit
from trackslip.identification.groups import by_command, by_speed, folds
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_fit import fit
from trackslip.identification.weighting import WeightedRuns, relative_errors
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.metrics import rms

_MIN_RADII = 3  # minimum number of folds of radii to judge laws by
_MIN_RUNS = 6  # minimum number of runs to judge laws by
_PARTS = 10  # number of folds of runs
_CHANCE = 1.0  # difference of squared errors that may be chance [standard errors]
_ROUGHLY = 1e-8  # tolerance of the fits: errors of predictions depend on them but weakly
_NEGLIGIBLE = 1e-3  # relative error of the track speeds that no ground and no encoder repeats, and no law need predict


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
