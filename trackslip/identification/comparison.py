"""Comparison of laws on the same samples: information criterion, cross-validation, lack of fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.fit import fit
from trackslip.identification.fitted import FittedLaw, fit_law
from trackslip.identification.replicates import by_command, folds
from trackslip.identification.samples import SlipSamples
from trackslip.identification.weighting import WeightedRuns
from trackslip.kinematics import RobotGeometry, body_twist
from trackslip.metrics import rms
from trackslip.slip.families import FAMILIES, TWO_SIDED

_INDISTINCT = 2.0  # difference of AICc within which the simpler law is preferred
_BASELINES = ("none", "constant")
_LARGE_RADIUS_ERROR = 0.1  # radius error above which a wrong gear or sprocket radius is more likely [-]


@dataclass(frozen=True)
class CrossValidation:
    """Prediction errors of a law for runs it was not fitted to; None if the runs do not form two groups."""

    radius: float | None
    """Rms error of the slip, leaving out one radius at a time [-]."""
    speed: float | None
    """Rms error of the slip, leaving out one speed at a time [-]."""
    yaw_rate: float | None
    """Rms error of the yaw rate predicted from sprocket speeds, leaving out one radius at a time [rad/s]."""


@dataclass(frozen=True)
class Comparison:
    """The laws that the same samples determine."""

    laws: Mapping[str, FittedLaw]
    """Fits by name of the law."""
    aicc: Mapping[str, float | None]
    """Corrected Akaike information criterion; None for too few samples."""
    weight: Mapping[str, float | None]
    """Akaike weights: the probability of each law to predict best among these [-]."""
    validation: Mapping[str, CrossValidation]
    """Cross-validation by name of the law."""
    best: str
    """The law with the fewest parameters whose AICc is within 2 of the smallest."""
    warnings: tuple[str, ...]
    """What a reader should know of the fits, one line each."""

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of the laws in order of AICc, smallest first; those without one follow in order of scatter."""
        aicc = {name: np.inf if value is None else value for name, value in self.aicc.items()}
        return tuple(sorted(self.laws, key=lambda name: (aicc[name], self.laws[name].scatter)))


def compare_laws(samples: SlipSamples, geometry: RobotGeometry) -> Comparison:
    """Fit all families that the samples determine, and compare them; LogError if none of these has parameters."""
    laws: dict[str, FittedLaw] = {}
    warnings: list[str] = []
    sides = np.sign(samples.omega[:, 1] - samples.omega[:, 0]) * np.sign(samples.omega.sum(axis=1))
    for name in FAMILIES:
        if name in TWO_SIDED and min((sides > 0).sum(), (sides < 0).sum()) < 2:
            continue
        try:
            laws[name] = fit_law(name, samples, geometry)
        except LogError as error:
            warnings.append(str(error))
    if not set(laws) - set(_BASELINES):
        raise LogError(warnings[-1])
    aicc = {name: law.aicc(len(samples)) for name, law in laws.items()}
    known = {name: value for name, value in aicc.items() if value is not None}
    least = min(known.values(), default=0.0)
    likelihood = {name: float(np.exp((least - value) / 2)) for name, value in known.items()}
    total = sum(likelihood.values())
    weight = {name: likelihood[name] / total if name in likelihood else None for name in laws}
    near = [name for name, value in known.items() if value <= least + _INDISTINCT]
    if near:
        best = min(near, key=lambda name: (len(laws[name].values), known[name]))
    else:  # too few samples for the criterion
        best = min(laws, key=lambda name: laws[name].scatter)
    validation = {name: cross_validate(law, samples, geometry) for name, law in laws.items()}
    return Comparison(laws, aicc, weight, validation, best, (*warnings, *_doubts(laws, best)))


def cross_validate(law: FittedLaw, samples: SlipSamples, geometry: RobotGeometry) -> CrossValidation:
    """Leave out each radius, then each speed, in turn, and predict it from the rest."""
    ideal = body_twist(samples.omega, 0.0, geometry)
    radii = folds(by_command(samples.omega, geometry).astype(float))
    speeds = folds(np.abs(ideal[:, 0]) + geometry.half_gauge * np.abs(ideal[:, 1]))
    radius, yaw_rate = _left_out(law, samples, geometry, radii)
    return CrossValidation(radius, _left_out(law, samples, geometry, speeds)[0], yaw_rate)


def _left_out(
    law: FittedLaw, samples: SlipSamples, geometry: RobotGeometry, labels: np.ndarray
) -> tuple[float, float] | tuple[None, None]:
    """Rms errors of slip [-] and yaw rate [rad/s] of the groups, each predicted by a fit to the others."""
    groups = int(labels.max()) + 1
    family = FAMILIES[law.name]
    kept = (labels != np.arange(groups)[:, None]).astype(float)  # (groups, n)
    if groups < 2 or 2 * kept.sum(axis=1).min() <= len(family.names):
        return None, None
    runs = WeightedRuns.of(samples, geometry).weighted(kept)
    start = np.tile([law.values[name] for name in family.names], (groups, 1))
    fits = fit(family, runs, start.reshape(groups, -1), np.full(groups, law.scatter))
    laws = family.law(fits.values[labels], geometry)  # a law for each sample
    slip = laws.slip(samples.twist) - samples.slip
    yaw_rate = laws.twist(samples.omega, geometry)[:, 1] - samples.twist[:, 1]
    return rms(slip), rms(yaw_rate)


def _doubts(laws: Mapping[str, FittedLaw], best: str) -> list[str]:
    """Warnings about the laws."""
    doubts = []
    for name, law in laws.items():
        lack = law.lack_of_fit
        if lack is not None and law.lacks_fit and name not in _BASELINES:
            freedom = ", ".join(map(str, lack.freedom))
            doubts.append(
                f"law {name}: lacks fit ({lack.test}({freedom}) = {lack.statistic:.3g}, p = {lack.probability:.2g}): "
                f"it misses the samples by {law.rms:.2g} rms, more than they scatter; its intervals are widened"
            )
    for key, value in laws[best].values.items():
        if key.startswith("radius_error") and abs(value) > _LARGE_RADIUS_ERROR:
            doubts.append(
                f"law {best}: {key} = {value:+.0%} is implausible for a track: are gear and sprocket radius right?"
            )
    if best in TWO_SIDED:
        doubts.append(f"left and right turns differ: {best} describes both, the other laws assume symmetry")
    return doubts
