"""What a report says about an identification: tables of the laws and of their comparison, and facts for the text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.measuring.inner_outer import TRACKS, InnerOuterSamples
from experiments.measuring.value_groups import is_narrow, repeated, value_groups
from experiments.report.colours import LABELS
from experiments.report.figures.axes import bar_factor
from experiments.report.figures.laws import residual_band
from experiments.report.formats import MISSING, number, significant
from experiments.report.law_symbols import FORMULAS, SYMBOLS, digits_for, unit_of
from trackslip.identification.comparison import Comparison
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.replicates import LackOfFit
from trackslip.identification.result import Identification
from trackslip.identification.samples import Refused
from trackslip.kinematics import Array
from trackslip.metrics import rms
from trackslip.slip.exponential import PUBLISHED

BASELINES = ("none", "constant")
"""Laws that serve as baselines."""
LAW_HEADER = ("law", "parameter", "value ± std. error", "95 % interval", "by bootstrap")
CRITERIA_HEADER = ("law", "free", "rms", "AICc", "weight", "cv radius", "cv speed", "cv yaw [mrad/s]", "lack of fit")
_CERTAIN = 0.001  # probabilities below this are printed as an upper limit


@dataclass(frozen=True)
class ParameterRow:
    """A parameter of a law, as printed."""

    symbol: str
    value: str
    """With standard error and unit."""
    interval: str
    """95 % interval from the likelihood profile."""
    bootstrap: str
    """95 % interval from resampled runs."""


@dataclass(frozen=True)
class LawRow:
    """A law and its parameters, as printed."""

    law: str
    """Name of the law in files and options."""
    title: str
    formula: Sequence[str]
    parameters: Sequence[ParameterRow]
    best: bool = False


@dataclass(frozen=True)
class CriteriaRow:
    """A law in the comparison, as printed."""

    law: str
    """Name of the law in files and options."""
    title: str
    free: str
    rms: str
    aicc: str
    """Above the smallest."""
    weight: str
    radius: str
    speed: str
    yaw_rate: str
    """[mrad/s]"""
    verdict: str
    """Of the lack-of-fit test."""
    test: str
    """Statistic and probability of the test."""
    best: bool

    @property
    def numbers(self) -> tuple[str, ...]:
        """The columns between title and verdict."""
        return self.free, self.rms, self.aicc, self.weight, self.radius, self.speed, self.yaw_rate


@dataclass(frozen=True)
class Prediction:
    """Prediction errors of a law, as printed."""

    title: str
    rms: str
    radius: str
    speed: str
    yaw_rate: str


@dataclass(frozen=True)
class IdentificationText:
    """Facts for the template; None where something is not known."""

    runs: int
    turns: int
    """Runs that are not straight: those in the figures."""
    radii: str | None
    speeds: str | None
    spread: Mapping[str, str]
    """Track -> largest difference of slip between runs of one radius; empty where no radius is repeated."""
    scattered: bool
    """Whether runs of different radii share a colour."""
    errors: Mapping[str, str] | None
    """Typical standard errors of a run: slip, radius, and the factor by which bars are enlarged."""
    band: tuple[str, str] | None
    """Half width of the residuals' band and its meaning; None without turns."""
    half_gauge: str
    best: str
    best_law: FittedLaw
    by_criterion: bool
    """Whether AICc chose the best law; with too few samples for it, the least scatter did."""
    predictions: Sequence[Prediction]
    """Of the best law and the paper's exponential, or of the one if they are the same."""
    laws: Sequence[LawRow]
    criteria: Sequence[CriteriaRow]
    lacking: str | None
    """Laws that lack fit, without the baselines."""
    inflation: str | None
    """Factor or range of factors by which their standard errors are multiplied."""
    tests: frozenset[str]
    """Lack-of-fit tests that were made: F, chi2."""
    outliers: Sequence[Refused]

    @classmethod
    def of(cls, found: Identification) -> IdentificationText:
        """All facts about an identification."""
        comparison = found.comparison
        turns = InnerOuterSamples.of(found.samples, found.geometry)
        lacks = {name: law.lack_of_fit for name, law in comparison.laws.items() if law.lack_of_fit is not None}
        lacking = [name for name in lacks if comparison.laws[name].lacks_fit and name not in BASELINES]
        factors = [lacks[name].inflation for name in lacking if lacks[name].inflation > 1]
        band, meaning = residual_band(turns, comparison) if len(turns) else (0.0, "")
        return cls(
            runs=len(found.samples),
            turns=len(turns),
            radii=f"{_range(turns.radius, '.2f')} m" if len(turns) else None,
            speeds=f"{_range(turns.speed, '.2f')} m/s" if len(turns) else None,
            spread=_spread(turns),
            scattered=not all(is_narrow(turns.radius[group]) for group in value_groups(turns.radius)),
            errors=_errors(turns),
            band=(f"{band:.1g}", meaning) if len(turns) else None,
            half_gauge=f"{found.geometry.half_gauge:g} m",
            best=LABELS.get(comparison.best, comparison.best),
            best_law=comparison.laws[comparison.best],
            by_criterion=comparison.aicc[comparison.best] is not None,
            predictions=_predictions(comparison),
            laws=law_rows(comparison),
            criteria=criteria_rows(found),
            lacking=_listed(LABELS.get(name, name) for name in lacking) if lacking else None,
            inflation=_range(np.array(factors), ".2g") if factors else None,
            tests=frozenset(lack.test for lack in lacks.values()),
            outliers=found.outliers,
        )


def law_rows(comparison: Comparison) -> list[LawRow]:
    """The fitted laws with their parameters, simple ones first, and the published one."""
    rows = [
        LawRow(
            name,
            LABELS.get(name, name),
            FORMULAS.get(name, (MISSING,)),
            [_parameter(law, key) for key in law.values],
            best=name == comparison.best,
        )
        for name, law in comparison.laws.items()
    ]
    published = [
        ParameterRow(
            SYMBOLS[key],
            f"{value:g} {unit_of('exponential', key)[1]}".rstrip().replace("-", "−"),
            MISSING,
            MISSING,
        )
        for key, value in vars(PUBLISHED).items()
    ]
    return [*rows, LawRow("published", LABELS["published"], FORMULAS["exponential"], published)]


def law_table(rows: Sequence[LawRow]) -> list[tuple[str, ...]]:
    """One line per parameter, under LAW_HEADER."""
    return [
        (row.law if k == 0 else "", *vars(parameter).values())
        for row in rows
        for k, parameter in enumerate(row.parameters)
    ]


def criteria_rows(found: Identification) -> list[CriteriaRow]:
    """The fitted laws by AICc, the best one first; the published one last."""
    comparison, samples = found.comparison, found.samples
    least = min((value for value in comparison.aicc.values() if value is not None), default=0.0)
    rows = []
    for name in comparison.ranking:
        law, aicc, validation = comparison.laws[name], comparison.aicc[name], comparison.validation[name]
        rows.append(
            CriteriaRow(
                law=name,
                title=LABELS.get(name, name),
                free=str(len(law.values)),
                rms=number(law.rms, 5),
                aicc=number(None if aicc is None else aicc - least, 1),
                weight=number(comparison.weight[name], 2),
                radius=number(validation.radius, 5),
                speed=number(validation.speed, 5),
                yaw_rate=number(None if validation.yaw_rate is None else 1e3 * validation.yaw_rate, 2),
                verdict="unknown" if law.lack_of_fit is None else "misses" if law.lacks_fit else "fits",
                test=_test(law.lack_of_fit),
                best=name == comparison.best,
            )
        )
    residual = rms(PUBLISHED.slip(samples.twist) - samples.slip)
    unknown = dict.fromkeys(("aicc", "weight", "radius", "speed", "yaw_rate", "verdict"), MISSING)
    title = LABELS["published"]
    return [*rows, CriteriaRow("published", title, "0", number(residual, 5), test="", best=False, **unknown)]


def criteria_table(rows: Sequence[CriteriaRow]) -> list[tuple[str, ...]]:
    """One line per law, under CRITERIA_HEADER."""
    return [(row.law, *row.numbers, f"{row.verdict} {row.test}".rstrip()) for row in rows]


def _parameter(law: FittedLaw, key: str) -> ParameterRow:
    """Value and intervals with as many decimals as show two digits of the standard error."""
    factor, unit = unit_of(law.name, key)
    error = factor * law.stderr[key]
    digits = digits_for(error)
    ends = law.interval95[key], law.bootstrap95.get(key)
    intervals = (MISSING if e is None else " to ".join(number(factor * x, digits) for x in e) for e in ends)
    value = f"{number(factor * law.values[key], digits)} ± {number(error, digits)} {unit}".rstrip()
    return ParameterRow(SYMBOLS.get(key, key), value, *intervals)


def _test(lack: LackOfFit | None) -> str:
    if lack is None:
        return ""
    name = {"chi2": "χ²"}.get(lack.test, lack.test)
    freedom = ", ".join(map(str, lack.freedom))
    chance = f"p < {_CERTAIN}" if lack.probability < _CERTAIN else f"p = {lack.probability:.2g}"
    size = f"{lack.statistic:.0f}" if lack.statistic >= 100 else f"{lack.statistic:.3g}"
    return f"{name}({freedom}) = {size}, {chance}"


def _spread(turns: InnerOuterSamples) -> dict[str, str]:
    groups = repeated(turns.radius)
    if not groups:
        return {}
    return {name: f"{max(float(np.ptp(turns.slip[g, k])) for g in groups):.4f}" for k, name in enumerate(TRACKS)}


def _errors(turns: InnerOuterSamples) -> dict[str, str] | None:
    if turns.errors is None or not len(turns):
        return None
    return {
        "slip": _size(float(np.median(turns.errors.slip))),
        "radius": f"{_size(1e3 * float(np.median(turns.errors.radius)))} mm",
        "factor": str(bar_factor(turns)),
    }


def _predictions(comparison: Comparison) -> list[Prediction]:
    rows = []
    for name in dict.fromkeys([comparison.best, "exponential"]):
        if name in comparison.laws:
            validation = comparison.validation[name]
            yaw_rate = None if validation.yaw_rate is None else 1e3 * validation.yaw_rate
            sizes = comparison.laws[name].rms, validation.radius, validation.speed, yaw_rate
            rows.append(Prediction(LABELS.get(name, name), *map(_size, sizes)))
    return rows


def _size(value: float | None) -> str:
    """A positive number with two significant digits; MISSING for anything else."""
    return significant(value) if value is not None and value > 0 else MISSING


def _range(values: Array, form: str) -> str:
    low, high = format(values.min(), form), format(values.max(), form)
    return low if low == high else f"{low} to {high}"


def _listed(names: Iterable[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
