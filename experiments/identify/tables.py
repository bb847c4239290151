"""Tables on an identification: parameters, comparison of the laws, and prediction errors."""

from collections.abc import Sequence
from math import degrees
from typing import Final

from experiments.common.laws import law_cell
from experiments.common.table import MISSING, Cell, Table, number
from trackslip.errors import counted
from trackslip.identification.comparison import Comparison
from trackslip.identification.drive_comparison import TODAY, DriveComparison
from trackslip.identification.path import EXTRAS
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
    "Medians over all pairs of poses between which the robot moves, by the time between them. "
    "today: dead reckoning without slip, with only the given delay and sensor place. two_gains: "
    "gains by regression. Score: mean ratio of the errors of position and heading to the best "
    "law's."
)
_NOT_VALIDATED: Final = (MISSING, MISSING, MISSING)


def parameters_table(comparison: Comparison, names: Sequence[str] | None = None) -> Table:
    """The laws' parameters, by default of all laws, the best first; for drives, also sensor and
    clock offset as fitted with the best law, if it is among them.
    """
    rows: list[tuple[str | Cell, ...]] = []
    names = [*comparison.laws] if names is None else names
    for fit in (comparison.laws[name] for name in names):
        law: str | Cell = law_cell(fit.name, fit.name == comparison.best)
        for key in fit.values:
            rows.append((law, symbol(fit.name, key), value_text(fit, key)))
            law = ""
    header = ("law", "parameter", "value (95 % interval)")
    if isinstance(comparison, SteadyComparison):
        title = f"Slip laws from {counted(len(comparison.samples), 'steady sample')}"
        return Table(title, header, rows, "llr", _STEADY_NOTE)
    assert isinstance(comparison, DriveComparison)
    drives = counted(len(comparison.look.drives), "whole drive")
    title = f"Slip laws from {drives}"
    if comparison.best not in names:
        return Table(title, header, rows, "llr", _DRIVE_NOTE)
    fit = comparison.laws[comparison.best]
    rows += [(EXTRAS[key].title, symbol(fit.name, key), value_text(fit, key)) for key in fit.extras]
    title += f", sensor and clock by {comparison.best}"
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


def prediction_tables(drive: DriveComparison) -> list[Table]:
    """Median errors in predicting held-out data, a table for positions and one for headings, as far
    as they are known: without identification first, then for each law, best law first.
    """
    position = _prediction_table(drive, "position", "m", 1.0, 3)
    heading = _prediction_table(drive, "heading", "deg", degrees(1.0), 1)
    return [table for table in (position, heading) if table is not None]


def _prediction_table(
    drive: DriveComparison, what: str, unit: str, factor: float, digits: int
) -> Table | None:
    """Median errors of positions or headings, times `factor`, by law and time ahead; None if none
    is known.
    """
    ahead = tuple(drive.errors[drive.best])
    today = [name for name in (TODAY, GAINS) if name in drive.errors and name != drive.best]
    rows: list[tuple[str | Cell, ...]] = []
    medians: list[float | None] = []
    for name in [*today, *drive.laws]:
        errors = [drive.errors[name].get(seconds) for seconds in ahead]
        known = [None if error is None else getattr(error, what) for error in errors]
        of_law = [None if part is None else factor * part.median for part in known]
        cells = [number(median, digits) for median in of_law]
        law = law_cell(name, name == drive.best, formula=False)
        rows.append((law, *cells, number(drive.score.get(name), 2)))
        medians += of_law
    if all(median is None for median in medians):
        return None
    header = ("law", *(f"{seconds:g} s" for seconds in ahead), "score")
    title = f"Held-out prediction, median error of {what} [{unit}]"
    return Table(title, header, rows, note=_PREDICTION_NOTE)
