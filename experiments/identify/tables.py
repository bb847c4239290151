"""Tables on an identification: parameters, comparison of the laws, and prediction errors."""

from math import degrees

from experiments.common.laws import law_cell, symbol, unit_of, with_interval
from experiments.common.table import MISSING, Cell, Table, number, pair
from trackslip.errors import counted
from trackslip.identification.answer import TOO_LITTLE
from trackslip.identification.comparison import Comparison, FittedLaw
from trackslip.identification.drive_comparison import TODAY, DriveComparison
from trackslip.identification.path import EXTRAS
from trackslip.identification.steady import CrossValidation, SteadyComparison
from trackslip.kinematics import RobotGeometry
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.families import GAINS
from trackslip.metrics import rms

_STEADY_NOTE = "Intervals: Student's, of errors of measurement and of one scatter between the runs."
_DRIVE_NOTE = (
    "Intervals are Student's t intervals, from fits that each leave out one block of driving."
)
_CRITERIA_NOTE = (
    "free: number of fitted parameters. rms: residual of the fit. cv: rms error at left-out "
    "radii, for slip, speed v "
    "and yaw rate w. The published law is not fitted."
)
_PREDICTION_NOTE = (
    "Errors over all pairs of poses between which the robot moves. today: dead reckoning without "
    "slip, with only the "
    "given delay and sensor place. two_gains: gains by regression. Score: mean ratio of the "
    "error to the best law's."
)
# factor from SI to m or degrees, and decimals
_UNITS = {"position": (1.0, 3), "heading": (degrees(1.0), 1)}


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
    title = (
        f"Slip laws from {counted(len(comparison.look.drives), 'whole drive')}, sensor and "
        f"clock by {comparison.best}"
    )
    return Table(title, header, rows, "llr", _DRIVE_NOTE)


def value_text(fit: FittedLaw, name: str) -> str:
    """A parameter with its interval, or with the reason why it has none."""
    value = (fit.values | getattr(fit, "extras", {}))[name]
    why_none = fit.held.get(name, TOO_LITTLE)
    return with_interval(
        value, fit.interval95.get(name), unit_of(fit.name, name), why_none=why_none
    )


def criteria_table(comparison: SteadyComparison, geometry: RobotGeometry) -> Table:
    """A comparison of the fitted laws, the best predictor first, and of the published law, last."""
    rows: list[tuple[str | Cell, ...]] = []
    for name in comparison.laws:
        fit, errors = comparison.laws[name], comparison.validation[name]
        cells = (
            str(len(fit.values)),
            number(fit.rms, 5),
            *([MISSING] * 3 if errors is None else _validation_cells(errors)),
        )
        rows.append((law_cell(name, name == comparison.best, formula=False), *cells))
    samples = comparison.samples
    residual = rms(samples.relative_errors(PUBLISHED.twist(samples.omega, geometry), geometry))
    rows.append((law_cell("published", formula=False), "0", number(residual, 5), *[MISSING] * 3))
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
    ahead, rows = tuple(drive.errors[drive.best]), list[tuple[str | Cell, ...]]()
    today = [name for name in (TODAY, GAINS) if name in drive.errors and name != drive.best]
    for name in [*today, *drive.laws]:
        cells = []
        for errors in map(drive.errors[name].get, ahead):
            sizes = [(getattr(errors, key, None), *unit) for key, unit in _UNITS.items()]
            known = [
                number(factor * each.median, digits)
                for each, factor, digits in sizes
                if each is not None
            ]
            cells.append(pair(known) if known else MISSING)
        rows.append(
            (
                law_cell(name, name == drive.best, formula=False),
                *cells,
                number(drive.score.get(name), 2),
            )
        )
    title = "Held-out prediction, median error of position [m] | heading [deg]"
    return Table(
        title,
        ("law", *(f"{seconds:g} s" for seconds in ahead), "score"),
        rows,
        note=_PREDICTION_NOTE,
    )
