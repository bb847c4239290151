"""What a report says about an identification: tables of the laws and of their comparison, and facts for the text."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from experiments.measuring.grid import OuterInner
from experiments.measuring.inner_outer import InnerOuterSamples
from experiments.measuring.value_groups import is_narrow, repeated, value_groups
from experiments.report.figures.laws import residual_band
from experiments.report.figures.steady_runs import bar_factor
from experiments.report.formats import MISSING, number, significant
from experiments.report.laws import SYMBOLS, LawRow, digits_for, shown, unit_of
from trackslip.identification.comparison import Comparison
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.replicates import LackOfFit
from trackslip.identification.result import Identification
from trackslip.identification.weighting import relative_errors
from trackslip.kinematics import Array
from trackslip.metrics import rms
from trackslip.slip.exponential import PUBLISHED

_BASELINES = ("none", "constant")
LAW_HEADER = ("law", "parameter", "value ± std. error", "95 % interval", "by bootstrap")
CRITERIA_HEADER = (
    *("law", "free", "rms", "AICc", "weight", "cv radius", "cv speed", "cv run"),
    *("cv v [mm/s]", "cv w [mrad/s]", "lack of fit"),
)
_CERTAIN = 0.001  # probabilities below this are printed as an upper limit


@dataclass(frozen=True)
class CriteriaRow:
    """A law in the comparison, as printed."""

    law: str  # its name in files and options
    title: str
    numbers: Sequence[str]  # the columns of CRITERIA_HEADER between name and lack of fit; AICc above the smallest
    verdict: str  # of the lack-of-fit test
    test: str  # its statistic and probability
    best: bool = False


@dataclass(frozen=True)
class TypicalErrors:
    """Median standard errors of a run, as printed."""

    slip: str  # [-]
    radius: str  # with its unit
    factor: str  # by which bars are enlarged


@dataclass(frozen=True)
class Prediction:
    """How well a law predicts, rms, as printed."""

    title: str
    residual: str  # of slip in the fit [-]
    radius: str  # of slip at left-out radii [-]
    speed: str  # of slip at left-out speeds [-]
    yaw_rate: str  # at left-out radii [mrad/s]


@dataclass(frozen=True)
class Facts:
    """What the template says about an identification; None or empty where something is not known."""

    runs: int
    turns: int
    radii: str | None  # with unit, as are speeds
    speeds: str | None
    spread: OuterInner[str] | None  # the largest difference of slip between runs of one radius [-]
    scattered: bool  # runs of different radii share a colour
    errors: TypicalErrors | None
    band: tuple[str, str] | None  # half width of the residuals that need no better law [-], and its meaning
    best: str  # title of the best law
    best_law: FittedLaw
    criterion: str  # what the best law was chosen by
    predictions: Sequence[Prediction]  # of the best law, and of the paper's exponential where it differs
    laws: Sequence[LawRow]
    criteria: Sequence[CriteriaRow]
    lacking: str | None  # titles of the laws of the wrong shape, other than baselines
    inflation: str | None  # factor on their standard errors
    tests: Collection[str]  # kinds of tests of lack of fit

    @classmethod
    def of(cls, found: Identification) -> Self:
        """The facts about an identification from steady stretches."""
        comparison = found.comparison
        turns = InnerOuterSamples.of(found.samples, found.geometry)
        same = repeated(turns.radius)
        lacks = {name: law.lack_of_fit for name, law in comparison.laws.items() if law.lack_of_fit is not None}
        lacking = [name for name in lacks if comparison.laws[name].lacks_fit and name not in _BASELINES]
        factors = [lacks[name].inflation for name in lacking if lacks[name].inflation > 1]
        band, meaning = residual_band(turns, comparison) if len(turns) else (0.0, "")
        return cls(
            runs=len(found.samples),
            turns=len(turns),
            radii=f"{_range(turns.radius, '.2f')} m" if len(turns) else None,
            speeds=f"{_range(turns.speed, '.2f')} m/s" if len(turns) else None,
            spread=OuterInner(outer=_spread(turns.slip[:, 1], same), inner=_spread(turns.slip[:, 0], same))
            if same
            else None,
            scattered=not all(is_narrow(turns.radius[group]) for group in value_groups(turns.radius)),
            errors=_errors(turns),
            band=(f"{band:.1g}", meaning) if len(turns) else None,
            best=shown(comparison.best).title,
            best_law=comparison.laws[comparison.best],
            criterion=comparison.criterion,
            predictions=_predictions(comparison),
            laws=law_rows(comparison),
            criteria=criteria_rows(found),
            lacking=_listed(shown(name).title for name in lacking) if lacking else None,
            inflation=_range(np.array(factors), ".2g") if factors else None,
            tests={lack.test for lack in lacks.values()},
        )


def law_rows(comparison: Comparison) -> list[LawRow]:
    """The fitted laws with their parameters, simple ones first, and the published one."""
    rows = []
    for name, law in comparison.laws.items():
        formula, parameters = shown(name).formula, [_parameter(law, key) for key in law.values]
        rows.append(LawRow(name, shown(name).title, formula, parameters, best=name == comparison.best))
    published = [
        (SYMBOLS[key], f"{value:g} {unit_of('exponential', key)[1]}".rstrip().replace("-", "−"), MISSING, MISSING)
        for key, value in vars(PUBLISHED).items()
    ]
    return [*rows, LawRow("published", shown("published").title, shown("published").formula, published)]


def criteria_rows(found: Identification) -> list[CriteriaRow]:
    """The fitted laws by AICc, the best one first; the published one last."""
    comparison, samples = found.comparison, found.samples
    least = min((value for value in comparison.aicc.values() if value is not None), default=0.0)
    rows = []
    for name in comparison.ranking:
        law, aicc, validation = comparison.laws[name], comparison.aicc[name], comparison.validation[name]
        numbers = (
            str(len(law.values)),
            number(law.rms, 5),
            number(None if aicc is None else aicc - least, 1),
            number(comparison.weight[name], 2),
            number(validation.radius, 5),
            number(validation.speed, 5),
            number(validation.run, 5),
            number(None if validation.linear_speed is None else 1e3 * validation.linear_speed, 2),
            number(None if validation.yaw_rate is None else 1e3 * validation.yaw_rate, 2),
        )
        verdict = "unknown" if law.lack_of_fit is None else "misses" if law.lacks_fit else "fits"
        best = name == comparison.best
        rows.append(CriteriaRow(name, shown(name).title, numbers, verdict, _test(law.lack_of_fit), best))
    predicted = PUBLISHED.twist(samples.omega, found.geometry)
    residual = number(rms(relative_errors(predicted, samples, found.geometry)), 5)
    return [*rows, CriteriaRow("published", shown("published").title, ("0", residual, *[MISSING] * 7), MISSING, "")]


def criteria_table(rows: Sequence[CriteriaRow]) -> list[tuple[str, ...]]:
    """One line per law, under CRITERIA_HEADER."""
    return [(row.law, *row.numbers, f"{row.verdict} {row.test}".rstrip()) for row in rows]


def _parameter(law: FittedLaw, key: str) -> tuple[str, ...]:
    """Value and intervals with as many decimals as show two digits of the standard error."""
    factor, unit = unit_of(law.name, key)
    error = factor * law.stderr[key]
    digits = digits_for(error)
    ends = law.interval95[key], law.bootstrap95.get(key)
    intervals = (MISSING if e is None else " to ".join(number(factor * x, digits) for x in e) for e in ends)
    value = f"{number(factor * law.values[key], digits)} ± {number(error, digits)} {unit}".rstrip()
    return (SYMBOLS.get(key, key), value, *intervals)


def _test(lack: LackOfFit | None) -> str:
    if lack is None:
        return ""
    name = {"chi2": "χ²"}.get(lack.test, lack.test)
    freedom = ", ".join(map(str, lack.freedom))
    chance = f"p < {_CERTAIN}" if lack.probability < _CERTAIN else f"p = {lack.probability:.2g}"
    size = f"{lack.statistic:.0f}" if lack.statistic >= 100 else f"{lack.statistic:.3g}"
    return f"{name}({freedom}) = {size}, {chance}"


def _spread(slip: Array, groups: Iterable[np.ndarray]) -> str:
    """The largest difference of a track's slip within a group of runs."""
    return f"{max(np.ptp(slip[group]) for group in groups):.4f}"


def _errors(turns: InnerOuterSamples) -> TypicalErrors | None:
    if turns.errors is None or not len(turns):
        return None
    slip, radius = _size(float(np.median(turns.errors.slip))), _size(1e3 * float(np.median(turns.errors.radius)))
    return TypicalErrors(slip, f"{radius} mm", str(bar_factor(turns)))


def _predictions(comparison: Comparison) -> list[Prediction]:
    rows = []
    for name in dict.fromkeys([comparison.best, "exponential"]):
        if name in comparison.laws:
            errors = comparison.validation[name]
            yaw_rate = None if errors.yaw_rate is None else 1e3 * errors.yaw_rate
            sizes = map(_size, (comparison.laws[name].rms, errors.radius, errors.speed, yaw_rate))
            rows.append(Prediction(shown(name).title, *sizes))
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
