"""Laws identified from steady runs: tables, and sentences on the best law and on those of the wrong shape."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from markupsafe import Markup

from experiments.report.formats import MISSING, number, significant
from experiments.report.laws import SYMBOLS, digits_for, law_cell, shown, unit_of
from experiments.report.table import Cell, Table
from trackslip.identification.comparison import Comparison
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.replicates import LackOfFit
from trackslip.identification.result import Identification
from trackslip.identification.weighting import relative_errors
from trackslip.kinematics import Array
from trackslip.metrics import rms
from trackslip.slip.exponential import PUBLISHED

_LAW_HEADER = ("law", "parameter", "value ± std. error", "95 % interval", "by bootstrap")
_LAW_NOTE = (
    "The standard error is the scatter of the value over repeated measurements. The 95 % interval holds all values "
    "with which the law describes the samples nearly as well as at its best (the likelihood profile) and need not be "
    "symmetric. The bootstrap interval comes from fits to resampled runs; where the two differ, trust the wider one."
)
_CRITERIA_HEADER = (
    *("law", "free", "rms", "AICc", "weight", "cv radius", "cv speed", "cv run"),
    *("cv v [mm/s]", "cv w [mrad/s]", "lack of fit"),
)
_CRITERIA_NOTE = (
    "free: fitted parameters. rms: residual of the fit. AICc: above the least. cv: cross-validation, the rms error of "
    "predicting left-out radii, speeds or runs; v and w: of the robot's speed and yaw rate at left-out radii. A dash "
    "means too few runs, radii or speeds. The published law is not fitted; its residual is its distance from these "
    "samples."
)
_TESTS = {
    "F": "Lack of fit, F: misfit of the law relative to the scatter of runs with the same commanded radius, about 1 "
    "if the law is true. ",
    "chi2": "Lack of fit, χ²: squared residuals in units of the errors of measurement, about the number in brackets "
    "if the law is true. ",
}
_BASELINES = ("none", "constant")
_CERTAIN = 0.001  # probabilities below this are printed as an upper limit


def law_table(found: Identification) -> Table:
    """The parameters of the fitted laws, simple ones first, and of the published one."""
    comparison = found.comparison
    rows: list[tuple[str | Cell, ...]] = []
    for name, law in comparison.laws.items():
        parameters = [_parameter(law, key) for key in law.values]
        rows += _of_law(law_cell(name, best=name == comparison.best), parameters)
    published = [
        (SYMBOLS[key], f"{value:g} {unit_of('exponential', key)[1]}".rstrip().replace("-", "−"), MISSING, MISSING)
        for key, value in vars(PUBLISHED).items()
    ]
    rows += _of_law(law_cell("published"), published)
    return Table(f"Slip laws from {len(found.samples)} steady samples", _LAW_HEADER, rows, "llr", _LAW_NOTE)


def _of_law(law: Cell, parameters: Sequence[tuple[str, ...]]) -> Iterator[tuple[str | Cell, ...]]:
    for k, cells in enumerate(parameters):
        yield (law if k == 0 else "", *cells)


def criteria_table(found: Identification) -> Table:
    """The fitted laws by AICc, the best one first; the published one last."""
    comparison, samples = found.comparison, found.samples
    least = min((value for value in comparison.aicc.values() if value is not None), default=0.0)
    rows: list[tuple[str | Cell, ...]] = []
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
        best = name == comparison.best
        rows.append((law_cell(name, best, formula=False), *numbers, _verdict(law.lack_of_fit, law.lacks_fit)))
    residual = rms(relative_errors(PUBLISHED.twist(samples.omega, found.geometry), samples, found.geometry))
    rows.append((law_cell("published", formula=False), "0", number(residual, 5), *[MISSING] * 8))
    tests = {law.lack_of_fit.test for law in comparison.laws.values() if law.lack_of_fit is not None}
    note = "".join(_TESTS[test] for test in _TESTS if test in tests)
    note += "p is the probability of such a value by chance; below 0.01 the law “misses”. " if tests else (
        "Lack of fit cannot be tested here: no runs repeat each other, and errors of measurement are not known. "
    )  # fmt: skip
    align = "l" + "r" * 9 + "l"
    return Table("Laws compared, the best first", _CRITERIA_HEADER, rows, align, note + _CRITERIA_NOTE)


def _parameter(law: FittedLaw, key: str) -> tuple[str, ...]:
    """Value and intervals with as many decimals as show two digits of the standard error."""
    factor, unit = unit_of(law.name, key)
    error = factor * law.stderr[key]
    digits = digits_for(error)
    ends = law.interval95[key], law.bootstrap95.get(key)
    intervals = (MISSING if e is None else " to ".join(number(factor * x, digits) for x in e) for e in ends)
    value = f"{number(factor * law.values[key], digits)} ± {number(error, digits)} {unit}".rstrip()
    return (SYMBOLS.get(key, key), value, *intervals)


def _verdict(lack: LackOfFit | None, misses: bool) -> Cell:
    """Whether a law fits, and the test's statistic and probability."""
    if lack is None:
        return Cell("unknown")
    name = {"chi2": "χ²"}.get(lack.test, lack.test)
    freedom = ", ".join(map(str, lack.freedom))
    chance = f"p < {_CERTAIN}" if lack.probability < _CERTAIN else f"p = {lack.probability:.2g}"
    size = f"{lack.statistic:.0f}" if lack.statistic >= 100 else f"{lack.statistic:.3g}"
    verdict, test = "misses" if misses else "fits", f"{name}({freedom}) = {size}, {chance}"
    return Cell(verdict, f"{verdict} {test}", [test])


def lack_of_fit_text(comparison: Comparison) -> str:
    """Which laws have the wrong shape, and what that means for their parameters; empty if none has."""
    lacking = {
        name: law.lack_of_fit
        for name, law in comparison.laws.items()
        if law.lack_of_fit is not None and law.lacks_fit and name not in _BASELINES
    }
    if not lacking:
        return ""
    repeats = any(one.test == "F" for one in lacking.values())
    than = "runs at one radius are from each other" if repeats else "their errors of measurement allow"
    factors = np.array([one.inflation for one in lacking.values() if one.inflation > 1])
    inflated = (
        f" Their standard errors and 95 % intervals are therefore multiplied by {range_text(factors, '.2g')}, the "
        "ratio of the misfit to what chance allows. They describe the best compromise over the radii driven here, not "
        "at other radii."
        if len(factors)
        else ""
    )
    return Markup(
        "<strong>Lack of fit</strong> of the {}: the samples are farther from the law than {}. This cannot be chance: "
        "the law has the wrong shape. No parameters are then true, and errors computed from the scatter alone would be "
        "far too small.{}"
    ).format(_listed(shown(name).title for name in lacking), than, inflated)


def best_text(comparison: Comparison) -> str:
    """The best law and how well it predicts, and the paper's exponential where it differs."""
    best, count = shown(comparison.best).title, len(comparison.laws[comparison.best].values)
    chosen = f" (there are too few samples for the criterion of prediction, so it was chosen by {comparison.criterion})"
    errors = [_errors(comparison, name) for name in dict.fromkeys([comparison.best, "exponential"])]
    return Markup("The best law here is <strong>{}</strong>, with {} parameter{}{}. {}.").format(
        best,
        count,
        "" if count == 1 else "s",
        chosen if comparison.criterion in ("AICc", "scatter") else "",
        "; ".join(filter(None, errors)),
    )


def _errors(comparison: Comparison, name: str) -> str:
    """Errors of a law in the fit and at left-out radii and speeds."""
    if name not in comparison.laws:
        return ""
    errors = comparison.validation[name]
    who = "It" if name == comparison.best else f"the {shown(name).title}"
    told = f"{who} leaves a residual of {size_text(comparison.laws[name].rms)} of the speed (rms)"
    if size_text(errors.radius) == MISSING:
        return told
    yaw_rate = None if errors.yaw_rate is None else 1e3 * errors.yaw_rate
    return (
        f"{told} and mispredicts left-out radii by {size_text(errors.radius)} and left-out speeds by "
        f"{size_text(errors.speed)}, and by {size_text(yaw_rate)} mrad/s in yaw rate"
    )


def size_text(value: float | None) -> str:
    """A positive number with two significant digits; MISSING for anything else."""
    return significant(value) if value is not None and value > 0 else MISSING


def range_text(values: Array, form: str) -> str:
    """The smallest and the largest value, or the one that they all have."""
    low, high = format(values.min(), form), format(values.max(), form)
    return low if low == high else f"{low} to {high}"


def _listed(names: Iterable[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
