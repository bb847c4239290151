"""Tables on an identification: parameters, comparison of the laws, and prediction errors."""

from math import degrees
from typing import Final

from experiments.common.laws import law_cell
from experiments.common.table import MISSING, Cell, Table, number, pair
from trackslip.errors import counted
from trackslip.identification.comparison import Comparison
from trackslip.identification.drive_comparison import TODAY, DriveComparison
from trackslip.identification.path import EXTRAS
from trackslip.identification.prediction import PredictionErrors
from trackslip.identification.steady import CrossValidation, SteadyComparison
from trackslip.kinematics import RobotGeometry
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.families import GAINS
from trackslip.metrics import rms
from trackslip.views.symbols import symbol
from trackslip.views.values import value_text

_STEADY_NOTE: Final = (
    "Intervals: Student's, of errors of measurement and of one scatter between the runs."
)
_DRIVE_NOTE: Final = (
    "Intervals are Student's t intervals, from fits that each leave out one block of driving."
)
_CRITERIA_NOTE: Final = (
    "free: number of fitted parameters. rms: residual of the fit. cv: rms error at left-out "
    "radii, for slip, speed v and yaw rate w. The published law is not fitted."
)
_PREDICTION_NOTE: Final = (
    "Errors over all pairs of poses between which the robot moves. today: dead reckoning without "
    "slip, with only the given delay and sensor place. two_gains: gains by regression. Score: "
    "mean ratio of the error to the best law's."
)
_NOT_VALIDATED: Final = (MISSING, MISSING, MISSING)


def parameters_table(comparison: Comparison) -> Table:
    """The laws' parameters, best law first; for drives, also sensor and clock offset as fitted with
    the best law.
    """
    rows: list[tuple[str | Cell, ...]] = []
    for fit in comparison.laws.values():
        law: str | Cell = law_cell(fit.name, fit.name == comparison.best)
        for key in fit.values:
            rows.append((law, symbol(fit.name, key), value_text(fit, key)))
            law = ""
    header = ("law", "parameter", "value (95 % interval)")
    if isinstance(comparison, SteadyComparison):
        title = f"Slip laws from {counted(len(comparison.samples), 'steady sample')}"
        return Table(title, header, rows, "llr", _STEADY_NOTE)
    assert isinstance(comparison, DriveComparison)
    fit = comparison.laws[comparison.best]
    rows += [(EXTRAS[key].title, symbol(fit.name, key), value_text(fit, key)) for key in fit.extras]
    drives = counted(len(comparison.look.drives), "whole drive")
    title = f"Slip laws from {drives}, sensor and clock by {comparison.best}"
    return Table(title, header, rows, "llr", _DRIVE_NOTE)


def criteria_table(comparison: SteadyComparison, geometry: RobotGeometry) -> Table:
    """A comparison of the fitted laws, the best predictor first, and of the published law, last."""
    rows: list[tuple[str | Cell, ...]] = []
    for name, fit in comparison.laws.items():
        law = law_cell(name, name == comparison.best, formula=False)
        errors = comparison.validation[name]
        validation = _NOT_VALIDATED if errors is None else _validation_cells(errors)
        rows.append((law, str(len(fit.values)), number(fit.rms, 5), *validation))
    samples = comparison.samples
    predicted = PUBLISHED.twist(samples.omega, geometry)
    residual = rms(samples.relative_errors(predicted, geometry))
    law = law_cell("published", formula=False)
    rows.append((law, "0", number(residual, 5), *_NOT_VALIDATED))
    header = ("law", "free", "rms", "cv slip", "cv v [mm/s]", "cv w [mrad/s]")
    return Table("Laws compared", header, rows, note=_CRITERIA_NOTE)


def _validation_cells(errors: CrossValidation) -> list[str]:
    """Cross-validation errors in slip, speed and yaw rate."""
    return [
        number(errors.slip, 5),
        number(1e3 * errors.linear_speed, 2),
        number(1e3 * errors.yaw_rate, 2),
    ]


def prediction_table(drive: DriveComparison) -> Table:
    """Median errors in predicting held-out data: without identification first, then for each law,
    best law first.
    """
    ahead = tuple(drive.errors[drive.best])
    today = [name for name in (TODAY, GAINS) if name in drive.errors and name != drive.best]
    rows: list[tuple[str | Cell, ...]] = []
    for name in [*today, *drive.laws]:
        law = law_cell(name, name == drive.best, formula=False)
        errors = drive.errors[name]
        cells = [_median_errors(errors.get(seconds)) for seconds in ahead]
        rows.append((law, *cells, number(drive.score.get(name), 2)))
    title = "Held-out prediction, median error of position [m] | heading [deg]"
    header = ("law", *(f"{seconds:g} s" for seconds in ahead), "score")
    return Table(title, header, rows, note=_PREDICTION_NOTE)


def _median_errors(errors: PredictionErrors | None) -> str:
    """Median errors in position [m] and heading [deg], as far as they are known."""
    if errors is None:
        return MISSING
    known = []
    if errors.position is not None:
        known.append(number(errors.position.median, 3))
    if errors.heading is not None:
        known.append(number(degrees(1.0) * errors.heading.median, 1))
    return pair(known) if known else MISSING
