"""What a page says of an identification in words and numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.measuring.inner_outer import ROLES, RoleSamples
from experiments.measuring.value_groups import alike, narrow, repeated
from experiments.report.figures.error_bars import bar_factor
from experiments.report.figures.laws import residual_band
from experiments.report.figures.style import LABELS
from experiments.report.law_symbols import fixed
from experiments.report.law_tables import CriteriaRow, LawRow, criteria_rows, law_rows
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.result import Identification
from trackslip.identification.samples import Refused
from trackslip.kinematics import Array

BASELINES = ("none", "constant")
"""Laws that are there to be beaten."""


@dataclass(frozen=True)
class Prediction:
    """How far a law is off, as printed."""

    name: str
    rms: str
    radius: str
    speed: str
    yaw_rate: str


@dataclass(frozen=True)
class IdentificationText:
    """Texts for the template; what is None isn't known."""

    runs: int
    turns: int
    """Runs that aren't straight: those in the figures."""
    radii: str | None
    speeds: str | None
    spread: Mapping[str, str]
    """Role -> largest difference of slip between runs of one radius; empty where none are repeated."""
    scattered: bool
    """Whether runs of different radii have to share a colour."""
    errors: Mapping[str, str] | None
    """Typical standard errors of a run: slip, radius, and the factor they are drawn with; None if unknown."""
    band: tuple[str, str] | None
    """Half width of the residuals' band and what it is; None without turns."""
    half_gauge: str
    best: str
    best_law: FittedLaw
    by_criterion: bool
    """Whether the best was chosen by AICc; else the samples were too few for it, and the least scatter decided."""
    predictions: Sequence[Prediction]
    """Of the best law and the paper's exponential, one of them if they are the same."""
    laws: Sequence[LawRow]
    criteria: Sequence[CriteriaRow]
    lacking: str | None
    """Laws that are known to miss the samples, but for those that nobody expects to fit."""
    inflation: str | None
    """By what their standard errors are multiplied."""
    tests: frozenset[str]
    """Tests for lack of fit that were made: F, chi2."""
    outliers: Sequence[Refused]

    @classmethod
    def of(cls, found: Identification) -> IdentificationText:
        """Everything there is to say."""
        comparison = found.comparison
        turns = RoleSamples.of(found.samples, found.geometry)
        lacks = {name: law.lack_of_fit for name, law in comparison.laws.items() if law.lack_of_fit is not None}
        lacking = [name for name, lack in lacks.items() if lack.significant and name not in BASELINES]
        factors = [lacks[name].inflation for name in lacking if lacks[name].inflation > 1]
        return cls(
            runs=len(found.samples),
            turns=len(turns),
            radii=f"{_from_to(turns.radius)} m" if len(turns) else None,
            speeds=f"{_from_to(turns.speed)} m/s" if len(turns) else None,
            spread=_spread(turns),
            scattered=not all(narrow(turns.radius[group]) for group in alike(turns.radius)),
            errors=_errors(turns),
            band=_band(turns, found),
            half_gauge=f"{found.geometry.half_gauge:g} m",
            best=LABELS.get(comparison.best, comparison.best),
            best_law=comparison.laws[comparison.best],
            by_criterion=comparison.aicc[comparison.best] is not None,
            predictions=_predictions(found),
            laws=law_rows(comparison),
            criteria=criteria_rows(found),
            lacking=_listed(LABELS.get(name, name) for name in lacking) if lacking else None,
            inflation=_range(factors) if factors else None,
            tests=frozenset(lack.test for lack in lacks.values()),
            outliers=found.outliers,
        )


def _from_to(values: Array) -> str:
    low, high = f"{values.min():.2f}", f"{values.max():.2f}"
    return low if low == high else f"{low} to {high}"


def _spread(turns: RoleSamples) -> dict[str, str]:
    groups = repeated(turns.radius)
    if not groups:
        return {}
    return {name: f"{max(float(np.ptp(turns.slip[g, role])) for g in groups):.4f}" for role, name in enumerate(ROLES)}


def _errors(turns: RoleSamples) -> dict[str, str] | None:
    if turns.errors is None or not len(turns):
        return None
    return {
        "slip": _figures(float(np.median(turns.errors.slip))),
        "radius": f"{_figures(1e3 * float(np.median(turns.errors.radius)))} mm",
        "factor": str(bar_factor(turns)),
    }


def _band(turns: RoleSamples, found: Identification) -> tuple[str, str] | None:
    if not len(turns):
        return None
    width, meaning = residual_band(turns, found.comparison)
    return f"{width:.1g}", meaning


def _predictions(found: Identification) -> list[Prediction]:
    comparison = found.comparison
    rows = []
    for name in dict.fromkeys([comparison.best, "exponential"]):
        if name in comparison.laws:
            validation = comparison.validation[name]
            rate = validation.yaw_rate
            rows.append(
                Prediction(
                    LABELS.get(name, name),
                    _figures(comparison.laws[name].rms),
                    _figures(validation.radius),
                    _figures(validation.speed),
                    _figures(None if rate is None else 1e3 * rate),
                )
            )
    return rows


def _figures(value: float | None) -> str:
    """Two significant figures; a dash for none."""
    if value is None or not value > 0:
        return "–"
    return fixed(value, max(0, 1 - int(np.floor(np.log10(value)))))


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.2g}", f"{max(values):.2g}"
    return low if low == high else f"{low} to {high}"


def _listed(names: Iterable[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
