"""The tables of a page on identified slip laws, as printed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from experiments.report.figures.style import LABELS
from experiments.report.law_symbols import FORMULAS, SYMBOLS, digits_for, fixed, unit_of
from trackslip.identification.comparison import Comparison
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.replicates import LackOfFit
from trackslip.identification.result import Identification
from trackslip.metrics import rms
from trackslip.slip.exponential import PUBLISHED

MISSING = "–"
_CERTAIN = 0.001  # probability below which its size doesn't matter


@dataclass(frozen=True)
class ParameterRow:
    """A parameter of a law."""

    symbol: str
    value: str
    """With standard error and unit."""
    interval: str
    """The 95 % interval from the profile of the likelihood."""
    bootstrap: str
    """The same from resampled runs."""


@dataclass(frozen=True)
class LawRow:
    """A law and its parameters."""

    name: str
    formula: Sequence[str]
    parameters: Sequence[ParameterRow]
    best: bool = False


@dataclass(frozen=True)
class CriteriaRow:
    """A law in the comparison."""

    name: str
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
    """Of the test for lack of fit."""
    test: str
    """Its numbers."""
    best: bool


def law_rows(comparison: Comparison) -> list[LawRow]:
    """The fitted laws with their parameters, simple ones first, and the published one."""
    rows = [
        LawRow(
            LABELS.get(name, name),
            FORMULAS.get(name, (MISSING,)),
            [_parameter(fit, key) for key in fit.values],
            best=name == comparison.best,
        )
        for name, fit in comparison.laws.items()
    ]
    published = [
        ParameterRow(
            SYMBOLS[key], f"{_minus(f'{value:g}')} {unit_of('exponential', key)[1]}".rstrip(), MISSING, MISSING
        )
        for key, value in vars(PUBLISHED).items()
    ]
    return [*rows, LawRow(LABELS["published"], FORMULAS["exponential"], published)]


def criteria_rows(found: Identification) -> list[CriteriaRow]:
    """The fitted laws by AICc, the best fits first; the published one last."""
    comparison, samples = found.comparison, found.samples
    least = min((value for value in comparison.aicc.values() if value is not None), default=0.0)
    rows = []
    for name in comparison.ranking:
        fit, aicc, validation = comparison.laws[name], comparison.aicc[name], comparison.validation[name]
        rows.append(
            CriteriaRow(
                name=LABELS.get(name, name),
                free=str(len(fit.values)),
                rms=_number(fit.rms, 5),
                aicc=MISSING if aicc is None else _number(aicc - least, 1),
                weight=_number(comparison.weight[name], 2),
                radius=_number(validation.radius, 5),
                speed=_number(validation.speed, 5),
                yaw_rate=MISSING if validation.yaw_rate is None else _number(1e3 * validation.yaw_rate, 2),
                verdict=_verdict(fit),
                test=_test(fit.lack_of_fit),
                best=name == comparison.best,
            )
        )
    residual = rms(PUBLISHED.slip(samples.twist) - samples.slip)
    unknown = dict.fromkeys(("aicc", "weight", "radius", "speed", "yaw_rate", "verdict"), MISSING)
    return [*rows, CriteriaRow(LABELS["published"], "0", _number(residual, 5), test="", best=False, **unknown)]


def _parameter(fit: FittedLaw, key: str) -> ParameterRow:
    """Value and interval with as many decimals as the standard error has to two digits."""
    factor, unit = unit_of(fit.name, key)
    error = factor * fit.stderr[key]
    digits = digits_for(error)
    value = f"{fixed(factor * fit.values[key], digits)} ± {fixed(error, digits)}"
    ends = fit.interval95[key], fit.bootstrap95.get(key)
    profile, bootstrap = (MISSING if e is None else " to ".join(fixed(factor * x, digits) for x in e) for e in ends)
    return ParameterRow(SYMBOLS.get(key, key), f"{value} {unit}".rstrip(), profile, bootstrap)


def _verdict(fit: FittedLaw) -> str:
    if fit.lack_of_fit is None:
        return "can't be told"
    return "misses" if fit.lacks_fit else "fits"


def _test(lack: LackOfFit | None) -> str:
    if lack is None:
        return ""
    name = {"chi2": "χ²"}.get(lack.test, lack.test)
    freedom = ", ".join(map(str, lack.freedom))
    chance = f"p < {_CERTAIN}" if lack.probability < _CERTAIN else f"p = {lack.probability:.2g}"
    size = fixed(lack.statistic, 0) if lack.statistic >= 100 else f"{lack.statistic:.3g}"
    return f"{name}({freedom}) = {size}, {chance}"


def _number(value: float | None, digits: int) -> str:
    return MISSING if value is None or not math.isfinite(value) else fixed(value, digits)


def _minus(text: str) -> str:
    return text.replace("-", "−")
