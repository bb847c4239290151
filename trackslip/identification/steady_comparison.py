"""Laws compared on steady samples, by how they predict runs that they were not fitted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.comparison import Choice, Comparison, Criterion, choose, ranked, turns_fast
from trackslip.identification.fitted import FEWEST_BLOCKS
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_fit import SteadyFit, fit_law
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.metrics import rms

BASELINES = ("none", "exponential", "icr")
"""Laws that are always reported, for others to be compared with."""
_NEGLIGIBLE = 1e-3  # relative error of the track speeds that no ground and no encoder repeats, and no law need predict


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
    """Laws identified from steady samples, in order of AICc."""

    samples: SlipSamples  # the samples that the laws were fitted to
    laws: Mapping[str, SteadyFit]  # fits by name of the law
    validation: Mapping[str, CrossValidation | None]  # cross-validation by name of the law


def compare_laws(samples: SlipSamples, geometry: RobotGeometry) -> SteadyComparison:
    """Fit all families that the samples determine, and the baselines in any case, and compare them.

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
            laws[name] = fit_law(name, samples, geometry, vague=name in BASELINES)
            warnings += laws[name].notes
        except LogError as error:
            warnings.append(str(error))
    known = {name: law for name, law in laws.items() if not law.notes}
    if not known.keys() - {"none"}:
        raise LogError(next(why for why in warnings if why.startswith("law icr:")))
    predicted = {name: law.fit.left_out() for name, law in laws.items()}
    choice = choose(known, lambda some: _ranked(some, predicted))
    assert choice is not None
    order = sorted(laws, key=lambda name: (laws[name].aicc or np.inf, laws[name].scatter))
    return SteadyComparison(
        **vars(choice),
        samples=samples,
        laws={name: laws[name] for name in order},
        validation={name: CrossValidation.of(twist, samples, geometry) for name, twist in predicted.items()},
        warnings=tuple(warnings),
    )


def _ranked(laws: Mapping[str, SteadyFit], predicted: Mapping[str, Array | None]) -> Choice:
    """The simplest of the laws whose predictions of left-out radii are as good as any other's.

    Errors are mean squares of the relative errors of the track speeds, weighted by the runs' variances. Where the
    samples are too few for predictions, it is the simplest of the laws whose AICc is within 2 of the smallest
    (Burnham and Anderson, 2002).
    """
    fit = next(iter(laws.values())).fit
    samples, scatter = fit.samples, max(_NEGLIGIBLE, min(law.scatter for law in laws.values()))
    weight = 1 / (fit.measurement.mean(axis=1) + scatter**2)
    errors = {
        name: weight / weight.mean() * np.mean(samples.relative_errors(twist, fit.geometry) ** 2, axis=1)
        for name in laws
        if (twist := predicted[name]) is not None
    }
    if errors and len(samples) >= FEWEST_BLOCKS:
        criterion = Criterion(errors, np.arange(len(samples)), _NEGLIGIBLE**2)
        choice = ranked({name: laws[name] for name in errors}, [criterion])
        assert choice is not None
        why = "it is the simplest of those that predict left-out radii as well as any, within a standard error"
        return replace(choice, reason=why)
    aicc = {name: law.aicc or np.inf for name, law in laws.items()}
    least = min(laws, key=lambda name: (aicc[name], laws[name].scatter))
    near = [name for name in laws if aicc[name] <= aicc[least] + 2 and np.isfinite(aicc[name])] or [least]
    best = min(near, key=lambda name: (len(laws[name].values), aicc[name]))
    why = "it is the simplest of those whose AICc is within 2 of the smallest; the runs are too few for predictions"
    return Choice(best=best, reason=why, score={})
