"""Laws identified from steady runs: tables, and sentences on the best law and on laws that lack fit."""

import numpy as np
from markupsafe import Markup

from experiments.common.formats import MISSING, number, significant
from experiments.common.laws import law_cell, parameter_rows, shown, symbol, unit_of, with_error
from experiments.common.table import Cell, Table
from trackslip.errors import counted
from trackslip.identification.comparison import SteadyComparison
from trackslip.identification.fitted import SteadyFit
from trackslip.identification.result import Identification
from trackslip.identification.weighting import relative_errors
from trackslip.metrics import rms
from trackslip.slip.exponential import PUBLISHED

_LAW_HEADER = ("law", "parameter", "value ± std. error", "95 % interval", "by bootstrap")
_LAW_NOTE = (
    "The 95 % interval holds all values with which the law describes the samples nearly as well as at its best (the "
    "likelihood profile). The bootstrap interval comes from fits to resampled runs; where they differ, trust the wider."
)
_CRITERIA_HEADER = (
    *("law", "free", "rms", "AICc", "weight", "cv radius", "cv speed", "cv run"),
    *("cv v [mm/s]", "cv w [mrad/s]", "lack of fit"),
)
_CRITERIA_NOTE = (
    "free: fitted parameters. rms: residual of the fit. AICc: above the least. cv: rms error of predicting left-out "
    "radii, speeds or runs; v and w: of the robot's speed and yaw rate at left-out radii. Lack of fit: F compares the "
    "misfit with the scatter of runs with the same commanded radius, χ² with the errors of measurement; p is the "
    "probability of such a value by chance; below 0.01 the law “misses”. A dash means too few runs. The published law "
    "is not fitted."
)
_BASELINES = ("none", "constant")
_CERTAIN = 0.001  # probabilities below this are printed as an upper limit


def law_table(found: Identification) -> Table:
    """The parameters of the fitted laws, simple ones first, and of the published one."""
    comparison = found.comparison
    rows: list[tuple[str | Cell, ...]] = []
    for name, law in comparison.laws.items():
        parameters = [
            (
                symbol(name, key),
                *with_error(value, law.stderr[key], unit_of(name, key), law.interval95[key], law.bootstrap95.get(key)),
            )
            for key, value in law.values.items()
        ]
        rows += parameter_rows(law_cell(name, best=name == comparison.best), parameters)
    published = [
        (
            symbol("exponential", key),
            f"{value:g} {unit_of('exponential', key)[1]}".rstrip().replace("-", "−"),
            MISSING,
            MISSING,
        )
        for key, value in vars(PUBLISHED).items()
    ]
    rows += parameter_rows(law_cell("published"), published)
    return Table(f"Slip laws from {counted(len(found.samples), 'steady sample')}", _LAW_HEADER, rows, "llr", _LAW_NOTE)


def criteria_table(found: Identification) -> Table:
    """The fitted laws by AICc, the best one first; the published one last."""
    comparison, samples = found.comparison, found.samples
    least = min((value for value in comparison.aicc.values() if value is not None), default=0.0)
    rows: list[tuple[str | Cell, ...]] = []
    for name in comparison.ranking:
        law, aicc, errors = comparison.laws[name], comparison.aicc[name], comparison.validation[name]
        cells = (
            number(law.rms, 5),
            number(None if aicc is None else aicc - least, 1),
            number(comparison.weight[name], 2),
            *(number(error, 5) for error in (errors.radius, errors.speed, errors.run)),
            *(number(None if e is None else 1e3 * e, 2) for e in (errors.linear_speed, errors.yaw_rate)),
        )
        rows.append((law_cell(name, name == comparison.best, formula=False), str(len(law.values)), *cells, _fits(law)))
    residual = rms(relative_errors(PUBLISHED.twist(samples.omega, found.geometry), samples, found.geometry))
    rows.append((law_cell("published", formula=False), "0", number(residual, 5), *[MISSING] * 8))
    return Table("Laws compared, the best first", _CRITERIA_HEADER, rows, "l" + "r" * 9 + "l", _CRITERIA_NOTE)


def _fits(law: SteadyFit) -> Cell:
    """Verdict, statistic and probability of the test for lack of fit."""
    lack = law.lack_of_fit
    if lack is None:
        return Cell("unknown")
    name = {"chi2": "χ²"}.get(lack.test, lack.test)
    chance = f"p < {_CERTAIN}" if lack.probability < _CERTAIN else f"p = {lack.probability:.2g}"
    size = f"{lack.statistic:.0f}" if lack.statistic >= 100 else f"{lack.statistic:.3g}"
    test = f"{name}({', '.join(map(str, lack.freedom))}) = {size}, {chance}"
    verdict = "misses" if law.lacks_fit else "fits"
    return Cell(verdict, f"{verdict} {test}", [test])


def lack_of_fit_text(comparison: SteadyComparison) -> str:
    """A paragraph on the laws of the wrong shape; empty if there are none."""
    lacking = {name: law.lack_of_fit for name, law in comparison.laws.items() if law.lacks_fit}
    factors = [lack.inflation for name, lack in lacking.items() if lack is not None and name not in _BASELINES]
    if not factors:
        return ""
    titles = ", ".join(shown(name).label for name in lacking if name not in _BASELINES)
    return Markup(
        "<strong>Lack of fit</strong>: {}. The samples are farther from these laws than chance allows, so they have "
        "the wrong shape, and no parameters are true. Standard errors and intervals are multiplied by the ratio of the "
        "misfit to what chance allows, up to {:.2g}; they hold for the radii driven here."
    ).format(titles, max(1.0, np.max(factors)))


def best_text(comparison: SteadyComparison) -> str:
    """A sentence on the best law's predictions, compared with the paper's exponential."""
    parts = []
    for name in dict.fromkeys([comparison.best, "exponential"]):
        if name in comparison.laws:
            errors = comparison.validation[name]
            sizes = map(size_text, (comparison.laws[name].rms, errors.radius, errors.speed))
            parts.append("{}: {} | {} | {}".format(shown(name).label, *sizes))
    return Markup(
        "The best law here is <strong>{}</strong>, chosen by {}. Errors of track speeds relative to the faster "
        "sprocket's, rms, in the fit | at left-out radii | at left-out speeds: {}."
    ).format(shown(comparison.best).label, comparison.criterion, "; ".join(parts))


def size_text(value: float | None) -> str:
    """A positive number with two significant digits; MISSING for anything else."""
    return significant(value) if value is not None and value > 0 else MISSING
