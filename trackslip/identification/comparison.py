"""Laws compared on the same data, by the motion that they predict, and what a reader should doubt."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.doubts import doubts_of_drives, doubts_of_samples
from trackslip.identification.drive_law import REFERENCE, ClockProfile, DriveFit, clock_profile, fit_drives
from trackslip.identification.drive_prediction import (
    DrivePredictions,
    PredictionErrors,
    ScoredPairs,
    baselines,
    best_of_drives,
    held_out,
)
from trackslip.identification.drives import PreparedDrive
from trackslip.identification.fitted import FittedLaw, SteadyFit, fit_law
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_prediction import CrossValidation, RunPredictions, best_predictors
from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.se2 import Mounting
from trackslip.slip.families import FAMILIES, drive_laws

BASELINES = ("none", "exponential", "icr")
"""Laws that are always reported, for others to be compared with."""
_WITHOUT_RADIUS = ("none", "constant")  # laws that do not describe turning
_INDISTINCT = 2.0  # difference of AICc within which the simpler law is preferred
_MIN_LOADS = 1e-3  # range of the tractions per unit load from which their effect may show [-]
_FAST, _OFTEN = 0.5, 0.05  # lateral acceleration from which slip by it may show [m/s^2], and share of the driving


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Laws identified from the same data."""

    laws: Mapping[str, FittedLaw]
    """Fits by name of the law."""
    best: str
    """The law that predicts motion best; of laws that predict it equally well, the simplest."""
    warnings: tuple[str, ...]
    """Doubts and remarks on the fits, one line each."""

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of the laws, the best first."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class SteadyComparison(Comparison):
    """Laws identified from steady samples."""

    samples: SlipSamples
    """The samples that the laws were fitted to."""
    laws: Mapping[str, SteadyFit]
    """Fits by name of the law."""
    aicc: Mapping[str, float | None]
    """Corrected Akaike information criterion; None for too few samples."""
    weight: Mapping[str, float | None]
    """Akaike weights: the probability of each law to predict best among these [-]."""
    validation: Mapping[str, CrossValidation]
    """Cross-validation by name of the law."""
    criterion: str
    """Criterion of the best law: `left-out radii`, `left-out runs`, `AICc` or `scatter`, as the samples allow."""

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of the laws in order of AICc, smallest first; those without one follow in order of scatter."""
        aicc = {name: np.inf if value is None else value for name, value in self.aicc.items()}
        return tuple(sorted(self.laws, key=lambda name: (aicc[name], self.laws[name].scatter)))


@dataclass(frozen=True, kw_only=True)
class DriveComparison(Comparison):
    """Laws identified from drives, and compared by predictions (see `best_of_drives`)."""

    drives: tuple[PreparedDrive, ...]
    """The drives, as used."""
    laws: Mapping[str, DriveFit]
    """Fits by name of the law."""
    predictions: Mapping[str, DrivePredictions]
    """Held-out predictions by name of the law."""
    errors: Mapping[str, Mapping[float, PredictionErrors]]
    """Errors by horizon [s] of those, and before them of what needs no identification, TODAY and GAINS."""
    score: Mapping[str, float]
    """Mean over the horizons of a law's mean error relative to the smallest; empty without predictions [-]."""
    reason: str
    """Why `best` is the best, in one sentence."""
    clock: ClockProfile | None
    """Likelihood of clock offsets under the best law."""

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of the laws, the best predictions first."""
        return tuple(sorted(self.laws, key=lambda name: (name != self.best, self.score.get(name, 0.0))))


def compare_laws(samples: SlipSamples, geometry: RobotGeometry) -> SteadyComparison:
    """Fit all families that the samples determine, and the baselines in any case, and compare them.

    Raises LogError if the samples determine no law of turning.
    """
    laws: dict[str, SteadyFit] = {}
    warnings: list[str] = []
    sides = np.sign(samples.omega[:, 1] - samples.omega[:, 0]) * np.sign(samples.omega.sum(axis=1))
    fast = _turns_fast(samples.omega, geometry)
    for name, family in FAMILIES.items():
        if family.fast and not fast:
            continue
        if family.two_sided and min((sides > 0).sum(), (sides < 0).sum()) < 2:
            continue
        if family.loaded and (samples.load is None or np.ptp(samples.load) < _MIN_LOADS):
            continue
        try:
            laws[name] = fit_law(name, samples, geometry, vague=name in BASELINES)
            warnings += laws[name].notes
        except LogError as error:
            warnings.append(str(error))
    if not any(law.determined for name, law in laws.items() if name not in _WITHOUT_RADIUS):
        raise LogError(next(why for why in warnings if why.startswith("law icr:")))
    predictions = {name: RunPredictions.of(law, samples, geometry) for name, law in laws.items()}
    validation = {name: one.errors(samples, geometry) for name, one in predictions.items()}
    aicc = {name: law.aicc(len(samples)) for name, law in laws.items()}
    known = {name: law for name, law in laws.items() if law.determined}
    scatter = min(law.scatter for law in known.values())
    predictors = best_predictors({name: predictions[name] for name in known}, samples, geometry, scatter)
    best, criterion = _best_of_samples(known, predictors, aicc)
    return SteadyComparison(
        samples=samples,
        laws=laws,
        aicc=aicc,
        weight=_weights(aicc),
        validation=validation,
        best=best,
        criterion=criterion,
        warnings=(*warnings, *doubts_of_samples(laws, best)),
    )


def compare_drives(
    drives: Sequence[PreparedDrive],
    geometry: RobotGeometry,
    sensor: Mounting | None = None,
    names: Sequence[str] | None = None,
    step: Callable[[float], None] = lambda _: None,
) -> DriveComparison:
    """Fit laws to drives and predict held-out driving; `step(1.0)` is called after each law.

    By default, all families that are made for drives. Raises LogError if the drives determine no law with parameters.
    """
    fast = names is not None or _turns_fast(np.concatenate([drive.omega for drive in drives]), geometry)
    reference = fit_drives(REFERENCE, drives, geometry, sensor)
    pairs = ScoredPairs.of(reference.fit)
    laws: dict[str, DriveFit] = {}
    predictions: dict[str, DrivePredictions] = {}
    warnings: list[str] = []
    for name in names or drive_laws():
        if fast or not FAMILIES[name].fast:
            try:
                found = fit_drives(name, drives, geometry, sensor, reference=reference)
                if FAMILIES[name].fast and found.at_limit:
                    raise LogError("no slip by lateral acceleration shows")
                predictions[name] = held_out(found.fit, pairs)
                laws[name] = found
            except LogError as error:
                warnings.append(f"law {name}: {error}")
        step(1.0)
    if not any(law.values for law in laws.values()):
        raise LogError(warnings[-1] if warnings else "no law can be identified")
    plain = baselines(pairs, geometry, sensor) | predictions
    errors = {name: one.errors() for name, one in plain.items()}
    free = {name: len(law.values) for name, law in laws.items()}
    best, reason, scores = best_of_drives(predictions, free, pairs) or (
        REFERENCE if REFERENCE in laws else max(free, key=lambda name: free[name] > 0),
        "no motion could be predicted: the drives are too short or hardly move",
        {},
    )
    return DriveComparison(
        drives=tuple(drives),
        laws=laws,
        predictions=predictions,
        errors=errors,
        score=scores,
        best=best,
        reason=reason,
        clock=clock_profile(laws[best].fit) if "clock_offset" in laws[best].free else None,
        warnings=(*warnings, *doubts_of_drives(drives, laws, best)),
    )


def _turns_fast(omega: Array, geometry: RobotGeometry) -> bool:
    """True if sprocket speeds (n, 2) [rad/s] often demand a lateral acceleration that makes robots skid."""
    v, w = body_twist(omega, 0.0, geometry).T
    return bool(np.mean(np.abs(v * w) > _FAST) > _OFTEN)


def _weights(aicc: Mapping[str, float | None]) -> dict[str, float | None]:
    """Akaike weights; None where the criterion is not known."""
    known = {name: value for name, value in aicc.items() if value is not None}
    least = min(known.values(), default=0.0)
    likelihood = {name: float(np.exp((least - value) / 2)) for name, value in known.items()}
    total = sum(likelihood.values())
    return {name: likelihood[name] / total if name in likelihood else None for name in aicc}


def _best_of_samples(
    laws: Mapping[str, SteadyFit],
    predictors: tuple[Mapping[str, float], str] | None,
    aicc: Mapping[str, float | None],
) -> tuple[str, str]:
    """The best law, and what it was chosen by.

    It is the simplest of the laws that predict as well as any other and, of equally simple ones, the one that predicts
    best. Where the samples are too few for predictions, the criterion, or else the scatter, stands in.
    """
    if predictors is not None:
        errors, criterion = predictors
        return min(errors, key=lambda name: (len(laws[name].values), errors[name])), criterion
    known = {name: value for name in laws if (value := aicc[name]) is not None}
    if known:
        near = [name for name, value in known.items() if value <= min(known.values()) + _INDISTINCT]
        return min(near, key=lambda name: (len(laws[name].values), known[name])), "AICc"
    return min(laws, key=lambda name: laws[name].scatter), "scatter"
