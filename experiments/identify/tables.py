"""Tables and sentences of an identification: parameters, comparison of the laws, errors of prediction."""

from collections.abc import Iterable, Iterator
from math import degrees

from experiments.common.laws import law_cell, symbol, unit_of, with_error
from experiments.common.table import MISSING, Cell, Table, number, pair, significant
from trackslip.errors import counted
from trackslip.identification.comparison import Comparison, DriveComparison, SteadyComparison
from trackslip.identification.drive_model import EXTRAS
from trackslip.identification.drive_prediction import GAINS, TODAY
from trackslip.identification.fitted import FittedLaw, SteadyFit
from trackslip.identification.result import Identification
from trackslip.identification.weighting import relative_errors
from trackslip.kinematics import RobotGeometry
from trackslip.metrics import rms
from trackslip.slip.exponential import PUBLISHED

_STEADY_NOTE = (
    "The 95 % interval holds all values with which the law describes the samples nearly as well as at its best (the "
    "likelihood profile). The bootstrap interval comes from fits to resampled runs; where they differ, trust the wider."
)
_DRIVE_NOTE = (
    "The standard error holds if slip varies from moment to moment; the 95 % interval also allows for slip that lasts "
    "for seconds. A parameter that the driving does not show is held."
)
_CRITERIA_NOTE = (
    "free: fitted parameters. rms: residual of the fit. AICc: above the least. cv: rms error of predicting left-out "
    "radii, speeds or runs; v and w: of the robot's speed and yaw rate at left-out radii. Lack of fit: F compares the "
    "misfit with the scatter of runs with the same commanded radius, χ² with the errors of measurement; p is the "
    "probability of such a value by chance. Below 0.01 the law “misses”: it has the wrong shape, and its intervals, "
    "widened by the misfit, hold for the radii driven here alone. The published law is not fitted."
)
_PREDICTION_NOTE = (
    "Of all pairs of measured poses between which the robot moves, outlying poses included. today: dead reckoning "
    "without slip, delay, or a place of the sensor that wasn't given. two_gains: factors on speed and yaw rate by "
    "least squares, likewise without delay. The score is the mean error relative to the smallest of any law, averaged "
    "over the times ahead. Of the laws that predict as well as the one with the smallest errors at most times ahead, "
    "within one standard error, the best is the simplest."
)
_CERTAIN = 0.001  # probabilities below this are printed as an upper limit
_AHEAD = 2.0  # horizon of the gain in the text [s]
_HELD = "held"
_UNITS = {"position": (1.0, 3), "heading": (degrees(1.0), 1)}  # m and degrees from SI, and decimals


def parameters_table(comparison: Comparison, names: Iterable[str]) -> Table:
    """The parameters of some laws; of drives, also sensor and clock by the best one."""
    rows = [row for name in names for row in _law_rows(comparison, name)]
    header = ("law", "parameter", "value ± std. error", "95 % interval")
    if isinstance(comparison, SteadyComparison):
        title = f"Slip laws from {counted(len(comparison.samples), 'steady sample')}"
        return Table(title, (*header, "by bootstrap"), rows, "llr", _STEADY_NOTE)
    assert isinstance(comparison, DriveComparison)
    fit = comparison.laws[comparison.best]
    rows += [(EXTRAS[key].title, symbol(fit.name, key), *value_texts(fit, key)) for key in fit.extras]
    title = f"Slip laws from {counted(len(comparison.drives), 'whole drive')}, sensor and clock by {comparison.best}"
    return Table(title, header, rows, "llr", _DRIVE_NOTE)


def _law_rows(comparison: Comparison, name: str) -> Iterator[tuple[str | Cell, ...]]:
    fit = comparison.laws[name]
    for k, key in enumerate(fit.values):
        yield (law_cell(name, name == comparison.best) if k == 0 else "", symbol(name, key), *value_texts(fit, key))


def value_texts(fit: FittedLaw, name: str) -> tuple[str, ...]:
    """A parameter ± its standard error, its 95 % interval and, of steady samples, the one by bootstrap."""
    value, unit = (fit.values | getattr(fit, "extras", {}))[name], unit_of(fit.name, name)
    if name not in fit.stderr:
        return f"{unit[0] * value:.4g} {unit[1]}".rstrip().replace("-", "−"), _HELD
    ends: list[tuple[float, float] | None] = [fit.interval95[name]]
    if isinstance(fit, SteadyFit):
        ends.append(fit.bootstrap95.get(name))
    return with_error(value, fit.stderr[name], unit, *ends)


def held_lines(comparison: DriveComparison) -> list[str]:
    """A line for each parameter that was held, with the reason."""
    fit = comparison.laws[comparison.best]
    return [f"held: {symbol(fit.name, name)} ({name}), {reason}" for name, reason in fit.held.items()]


def criteria_table(comparison: SteadyComparison, geometry: RobotGeometry) -> Table:
    """The fitted laws by AICc, the smallest first; the published one last."""
    least = min((value for value in comparison.aicc.values() if value is not None), default=0.0)
    rows: list[tuple[str | Cell, ...]] = []
    for name in comparison.ranking:
        fit, aicc, errors = comparison.laws[name], comparison.aicc[name], comparison.validation[name]
        cells = (
            str(len(fit.values)),
            number(fit.rms, 5),
            number(None if aicc is None else aicc - least, 1),
            *(number(error, 5) for error in (errors.radius, errors.speed, errors.run)),
            *(number(None if error is None else 1e3 * error, 2) for error in (errors.linear_speed, errors.yaw_rate)),
        )
        rows.append((law_cell(name, name == comparison.best, formula=False), *cells, _lack_of_fit(fit)))
    samples = comparison.samples
    residual = rms(relative_errors(PUBLISHED.twist(samples.omega, geometry), samples, geometry))
    rows.append((law_cell("published", formula=False), "0", number(residual, 5), *[MISSING] * 7))
    header = ("law", "free", "rms", "AICc", "cv radius", "cv speed", "cv run", "cv v [mm/s]", "cv w [mrad/s]")
    return Table("Laws compared, by AICc", (*header, "lack of fit"), rows, "l" + "r" * 8 + "l", _CRITERIA_NOTE)


def _lack_of_fit(fit: SteadyFit) -> Cell:
    """Verdict, statistic and probability of the test for lack of fit."""
    lack = fit.lack_of_fit
    if lack is None:
        return Cell("unknown")
    name = {"chi2": "χ²"}.get(lack.test, lack.test)
    chance = f"p < {_CERTAIN}" if lack.probability < _CERTAIN else f"p = {lack.probability:.2g}"
    size = f"{lack.statistic:.0f}" if lack.statistic >= 100 else f"{lack.statistic:.3g}"
    test = f"{name}({', '.join(map(str, lack.freedom))}) = {size}, {chance}"
    verdict = "misses" if fit.lacks_fit else "fits"
    return Cell(verdict, f"{verdict} {test}", [test])


def prediction_table(drive: DriveComparison) -> Table:
    """Median errors of held-out prediction: without identification, then the best law first."""
    ahead, rows = tuple(drive.errors[drive.best]), list[tuple[str | Cell, ...]]()
    for name in [*(name for name in (TODAY, GAINS) if name in drive.errors), *drive.ranking]:
        cells = []
        for errors in map(drive.errors[name].get, ahead):
            sizes = [(getattr(errors, f"{key}_median", None), *unit) for key, unit in _UNITS.items()]
            known = [number(factor * value, digits) for value, factor, digits in sizes if value is not None]
            cells.append(pair(known) if known else MISSING)
        rows.append((law_cell(name, name == drive.best, formula=False), *cells, number(drive.score.get(name), 2)))
    title = "Held-out prediction, median error of position [m] | heading [deg]"
    return Table(title, ("law", *(f"{seconds:g} s" for seconds in ahead), "score"), rows, note=_PREDICTION_NOTE)


def gain(found: Identification) -> str:
    """A sentence on the gain of the best law over what the robot has today; empty if it isn't known."""
    if found.method == "drive" and found.drive is not None:
        by_law, by_today = (found.drive.errors.get(name, {}) for name in (found.best, TODAY))
        ahead = _AHEAD if _AHEAD in by_law else min(by_law, default=_AHEAD)
        if ahead not in by_law or ahead not in by_today:
            return ""
        us, them = by_law[ahead], by_today[ahead]
        parts = [f"position {them.position_median / us.position_median:.2g} times"]
        if us.heading_median and them.heading_median:
            parts.append(f"heading {them.heading_median / us.heading_median:.2g} times")
        return f"{ahead:g} s ahead, it predicts {' and '.join(parts)} better than the robot does today (median)."
    validation = found.comparison.validation
    rates = [validation[name].yaw_rate for name in (found.best, "none") if name in validation]
    if len(rates) < 2 or None in rates:
        return ""
    ours, theirs = (significant(None if rate is None else 1e3 * rate, "mrad/s") for rate in rates)
    return (
        f"At radii that it was not fitted to, it predicts the yaw rate within {ours} (rms), and today's odometry, "
        f"without slip, within {theirs}."
    )


def reason(found: Identification) -> str:
    """Why the best law is the best, where that isn't obvious; empty if it is."""
    if found.method == "drive" and found.drive is not None:
        return found.drive.reason
    comparison = found.comparison
    first, best = comparison.ranking[0], comparison.best
    if first == best:
        return ""
    if comparison.criterion.startswith("left-out"):
        return f"{first} has a smaller AICc than {best}, but does not predict {comparison.criterion} better"
    return f"{first} has a smaller AICc than {best}, but by so little that the simpler law is preferred"
