"""Comparison of laws on the same samples: by the motion they predict, by an information criterion, by lack of fit."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.fitted import FittedLaw, fit_law
from trackslip.identification.samples import SlipSamples
from trackslip.identification.sensor import offset_between_sides
from trackslip.identification.validation import CrossValidation, Predictions, best_predictors
from trackslip.kinematics import RobotGeometry
from trackslip.slip.families import FAMILIES, TWO_SIDED

BASELINES = ("none", "exponential", "icr")
"""Laws that are always reported, for others to be compared with."""
_WITHOUT_RADIUS = ("none", "constant")  # laws that tell nothing of turns
_INDISTINCT = 2.0  # difference of AICc within which the simpler law is preferred
_CERTAIN = 3.0  # difference of ICRs that is no chance [standard errors]
_MIN_LOADS = 1e-3  # range of the tractions per unit load from which their effect may show [-]
_LARGE_RADIUS_ERROR = 0.1  # radius error above which a wrong gear or sprocket radius is more likely [-]


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
    """The simplest of the laws that predict motion as well as any other, see `criterion`."""
    criterion: str
    """What the best law was chosen by: `left-out radii`, `left-out runs`, `AICc` or `scatter`, as the samples allow."""
    warnings: tuple[str, ...]
    """What a reader should know of the fits, one line each."""

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of the laws in order of AICc, smallest first; those without one follow in order of scatter."""
        aicc = {name: np.inf if value is None else value for name, value in self.aicc.items()}
        return tuple(sorted(self.laws, key=lambda name: (aicc[name], self.laws[name].scatter)))


def fit_laws(names: Iterable[str], samples: SlipSamples, geometry: RobotGeometry) -> dict[str, FittedLaw]:
    """Those of some laws that the samples determine, and baselines among them in any case, for `compare_laws`."""
    laws = {}
    for name in names:
        with contextlib.suppress(LogError):
            laws[name] = fit_law(name, samples, geometry, vague=name in BASELINES)
    return laws


def compare_laws(
    samples: SlipSamples, geometry: RobotGeometry, fitted: Mapping[str, FittedLaw] = MappingProxyType({})
) -> Comparison:
    """Fit all families that the samples determine, and the baselines in any case, and compare them.

    Some may have been `fitted` to these samples already. Raises LogError if the samples determine no law that tells of
    turns.
    """
    laws: dict[str, FittedLaw] = {}
    warnings: list[str] = []
    sides = np.sign(samples.omega[:, 1] - samples.omega[:, 0]) * np.sign(samples.omega.sum(axis=1))
    for name, family in FAMILIES.items():
        if name in TWO_SIDED and min((sides > 0).sum(), (sides < 0).sum()) < 2:
            continue
        if family.loaded and (samples.load is None or np.ptp(samples.load) < _MIN_LOADS):
            continue
        try:
            laws[name] = fitted.get(name) or fit_law(name, samples, geometry, vague=name in BASELINES)
            warnings += laws[name].notes
        except LogError as error:
            warnings.append(str(error))
    if not any(not law.notes for name, law in laws.items() if name not in _WITHOUT_RADIUS):
        raise LogError(next(why for why in warnings if why.startswith("law icr:")))
    predictions = {name: Predictions.of(law, samples, geometry) for name, law in laws.items()}
    validation = {name: one.errors(samples, geometry) for name, one in predictions.items()}
    aicc = {name: law.aicc(len(samples)) for name, law in laws.items()}
    known = {name: law for name, law in laws.items() if not law.notes}
    scatter = min(law.scatter for law in known.values())
    predictors = best_predictors({name: predictions[name] for name in known}, samples, geometry, scatter)
    best, criterion = _best(known, predictors, aicc)
    doubts = _doubts(laws, best)
    return Comparison(laws, aicc, _weights(aicc), validation, best, criterion, (*warnings, *doubts))


def _weights(aicc: Mapping[str, float | None]) -> dict[str, float | None]:
    """Akaike weights; None where the criterion is not known."""
    known = {name: value for name, value in aicc.items() if value is not None}
    least = min(known.values(), default=0.0)
    likelihood = {name: float(np.exp((least - value) / 2)) for name, value in known.items()}
    total = sum(likelihood.values())
    return {name: likelihood[name] / total if name in likelihood else None for name in aicc}


def _best(
    laws: Mapping[str, FittedLaw],
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


def _doubts(laws: Mapping[str, FittedLaw], best: str) -> list[str]:
    """Warnings about the laws."""
    doubts = []
    for name, law in laws.items():
        lack = law.lack_of_fit
        if lack is not None and law.lacks_fit and name not in _WITHOUT_RADIUS and not law.notes:
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
    doubts += _odd_centres(laws)
    if best in TWO_SIDED:
        doubts.append(f"left and right turns differ: {best} describes both, the other laws assume symmetry")
    return doubts


def _odd_centres(laws: Mapping[str, FittedLaw]) -> list[str]:
    """Questions about ICRs inside their tracks, and about ICRs that differ."""
    doubts = []
    for name in ("icr", "icr_radius"):
        if name not in laws or laws[name].notes or laws[name].interval95["offset"][1] >= 0:
            continue
        size = f"{1e3 * laws[name].values['offset']:.1f} ± {1e3 * laws[name].stderr['offset']:.2g} mm"
        doubts.append(
            f"law {name}: D = {size} is negative, but tracks that skid have their ICRs outside: is half_gauge right, "
            "or does the sensor sit off the middle (--sensor X Y YAW, or --estimate-sensor)?"
        )
    if "icr_sides" in laws:
        offset, error = offset_between_sides(laws["icr_sides"])
        if abs(offset) > _CERTAIN * error:
            differ, sits = (f"{1e3 * k * abs(offset):.1f} ± {1e3 * k * error:.2g} mm" for k in (2, 1))
            doubts.append(
                f"law icr_sides: D_left and D_right differ by {differ}: the sensor may sit {sits} to the "
                f"{'left' if offset > 0 else 'right'} of the middle (--sensor X Y YAW, or --estimate-sensor); an "
                "offset and unequal ICRs can't be told apart"
            )
    return doubts
