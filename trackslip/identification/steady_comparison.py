"""Laws compared on steady samples, by how they predict runs that they were not fitted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.comparison import (
    LEAST_ERROR,
    REFERENCE,
    Choice,
    Comparison,
    Criterion,
    choose,
    is_expressible,
    ranked,
    turns_fast,
)
from trackslip.identification.fitted import FEWEST_BLOCKS
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_fit import SteadyFit, fit_law
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.metrics import rms


@dataclass(frozen=True)
class CrossValidation:
    """Rms errors of a law for runs at radii that it was not fitted to."""

    slip: float  # of the track speeds, relative to the faster sprocket's [-]
    linear_speed: float  # [m/s]
    yaw_rate: float  # [rad/s]

    @classmethod
    def of(cls, twist: Array | None, samples: SlipSamples, geometry: RobotGeometry) -> CrossValidation | None:
        """Errors of the twists (n, 2) that fits without each radius predict."""
        if twist is None:
            return None
        v, w = (rms(column) for column in (twist - samples.twist).T)
        return cls(rms(samples.relative_errors(twist, geometry)), v, w)


@dataclass(frozen=True, kw_only=True)
class SteadyComparison(Comparison):
    """Laws identified from steady samples."""

    samples: SlipSamples  # the samples that the laws were fitted to
    laws: Mapping[str, SteadyFit]  # fits by name of the law
    validation: Mapping[str, CrossValidation | None]  # cross-validation by name of the law


def compare_laws(samples: SlipSamples, geometry: RobotGeometry) -> SteadyComparison:
    """Fit all families that the samples determine, and compare them.

    Raises LogError if the samples determine no law of turning.
    """
    laws, warnings = dict[str, SteadyFit](), list[str]()
    sides = np.sign(np.diff(samples.omega, axis=1)[:, 0] * samples.omega.sum(axis=1))
    one_sided = min((sides > 0).sum(), (sides < 0).sum()) < 2
    unloaded = samples.load is None or np.ptp(samples.load) < 1e-3
    slow = not turns_fast(samples.omega, geometry)
    for name, family in FAMILIES.items():
        impossible = (family.two_sided and one_sided) or (family.loaded and unloaded) or (family.fast and slow)
        if impossible or not family.of_runs:
            continue
        try:
            laws[name] = fit_law(name, samples, geometry)
        except LogError as error:
            warnings.append(str(error))
    if not laws.keys() - {"none"}:
        raise LogError(next(why for why in warnings if why.startswith("law icr:")))
    predicted = {name: law.fit.left_out() for name, law in laws.items()}
    choice = choose(laws, lambda some: _ranked(some, predicted))
    if choice is None:
        best = min(laws.keys() - {"none"}, key=lambda name: (name != REFERENCE, len(laws[name].values), name))
        why = "the runs are too few for predictions"
        choice = Choice(best=best, reason=why, score={}, expressible=best if is_expressible(best) else None)
    order = sorted(laws, key=lambda name: (name != choice.best, choice.score.get(name, np.inf), laws[name].rms))
    return SteadyComparison(
        **vars(choice),
        samples=samples,
        laws={name: laws[name] for name in order},
        validation={name: CrossValidation.of(twist, samples, geometry) for name, twist in predicted.items()},
        warnings=tuple(warnings),
    )


def _ranked(laws: Mapping[str, SteadyFit], predicted: Mapping[str, Array | None]) -> Choice | None:
    """The simplest of the laws whose predictions of left-out radii are as good as any other's; None for few runs.

    Errors are mean squares of the relative errors of the track speeds, weighted by the runs' variances.
    """
    fit = next(iter(laws.values())).fit
    samples, scatter = fit.samples, max(LEAST_ERROR, min(law.scatter for law in laws.values()))
    weight = 1 / (fit.measurement.mean(axis=1) + scatter**2)
    errors = {
        name: weight / weight.mean() * np.mean(samples.relative_errors(twist, fit.geometry) ** 2, axis=1)
        for name in laws
        if (twist := predicted[name]) is not None
    }
    if len(samples) < FEWEST_BLOCKS:
        return None
    criteria = [Criterion(errors, np.arange(len(samples)), LEAST_ERROR**2)] if errors else []
    choice = ranked({name: laws[name] for name in errors}, criteria)
    why = "it is the simplest of those that predict left-out radii as well as any, within a standard error"
    return choice and replace(choice, reason=why)
