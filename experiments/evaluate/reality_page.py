"""Predictions of real robots' logs: tables and their page."""

import math
from collections.abc import Sequence
from functools import partial

from experiments.calibrate.calibration import fit_summary, parameter_cells, printed
from experiments.common.formats import number
from experiments.common.laws import prediction_title, unit_of, with_error
from experiments.common.page import Bullets, Note, Plot, Section
from experiments.common.plain_json import plain
from experiments.common.table import Table
from experiments.evaluate import reality_figures as figures
from experiments.evaluate.reality import Findings
from experiments.validate.suite import Findings as Suite
from trackslip.errors import counted
from trackslip.identification.drive_law import DriveFit
from trackslip.identification.drive_prediction import TODAY

_INTRO = (
    "Parts of each log are predicted by what was fitted to its other parts: by two gains, by slip laws, and by the "
    "simulated robot. Laws and simulator know how late poses are stamped; measured sprocket speeds drive them."
)
_LIMITS = "How robots of other kinds move on other grounds.", "How they obey commands."
_DRIVES = ("", "", "pairs", "position", "90 %", "rms [m]", "heading", "90 %", "rms [deg]")
_STEADY = ("rms", "v [mm/s]", "w [mrad/s]", "v, without rows apart", "w")
_PLOTS = {
    figures.steady: ("Measured against predicted", "On the line, a prediction is right."),
    figures.turning: (
        "D by kind of turn",
        "D, by which belts' ICRs lie farther out than the belts, from v, w and sprocket speeds; by Coulomb friction it "
        "is about constant, but for sprockets of different radii. Medians are of opposite belts and of arcs.",
    ),
    figures.ahead: ("Errors ahead", "Median errors, of the same pairs of poses in all rows."),
    figures.tracks: (
        "One window",
        "The sensor's paths; the best law's error is the median of windows that turn.",
    ),
}


def suite(found: Sequence[Findings]) -> Suite:
    """The checks, tables and page of some data sets."""
    summary = {
        one.name: {"rows": one.rows, "best_law": one.best, "notes": one.notes}
        | {"laws": {name: law.stored for name, law in one.laws.items()}}
        | ({} if one.calibration is None else {"calibrated": fit_summary(one.calibration)})
        for one in found
    }
    return Suite(
        "Simulation against reality",
        [_INTRO],
        [check for one in found for check in one.checks],
        [table for one in found for table in (_table(one), _parameters(one)) if table],
        [_section(one) for one in found],
        _LIMITS,
        {"datasets": summary},
        {"datasets": {one.name: plain(one.data) for one in found}},
        "Of drives, they are errors 1 s ahead",
    )


def _table(found: Findings) -> Table:
    """Errors of all rows; of drives by time ahead."""
    lines: list[tuple[str, ...]] = []
    if found.samples is not None:
        lines += [
            (figures.title(k), *(number(1e3 * x, 1) for x in vars(e[0.0]).values())) for k, e in found.rows.items()
        ]
        return Table(found.data.title, _STEADY, lines)
    for at in found.rows[TODAY]:
        for row, errors in found.rows.items():
            one = errors[at]
            position = (number(x, 3) for x in (one.position_median, one.position_p90, one.position_rms))
            turns = (
                None if x is None else math.degrees(x) for x in (one.heading_median, one.heading_p90, one.heading_rms)
            )
            ahead = f"{at:g} s" if row == TODAY else ""
            lines.append((ahead, figures.title(row), f"{one.count:,}", *position, *(number(x, 1) for x in turns)))
    return Table(f"{found.data.title}: median, 90 % and rms of errors ahead", _DRIVES, lines, "llr")


def _parameters(found: Findings) -> Table | None:
    """Parameters of the calibrated simulator: fitted to all, and without each part."""
    fit = found.calibration
    if fit is None:
        return None
    parts = [f"without part {k + 1}" for k in range(len(fit.folds))]
    lines = []
    for name, one in fit.estimates.items():
        factor, unit = printed(name, one.unit)
        digits = max(0, 1 - math.floor(math.log10(factor * one.stderr)))
        values = (number(factor * fold.value(name), digits, unit) for fold in fit.folds)
        lines.append((name, *parameter_cells(name, one), *values))
    header = ("parameter", "fitted to all", "95 %", *parts)
    return Table(f"{found.data.title}: parameters of the calibrated simulator", header, lines)


def _section(found: Findings) -> Section:
    """A data set's source, figures, best law and what was left out."""
    data, law = found.data, found.laws[found.best]
    values = law.values | (law.extras if isinstance(law, DriveFit) else {})
    parameters = [
        (name, *with_error(values[name], error, unit_of(found.best, name), law.interval95.get(name)))
        for name, error in law.stderr.items()
    ]
    source = f"From {data.source}; {data.licence}. {counted(data.folds, 'part')} are predicted by fits to the others."
    plots = (Plot(f"{found.name}_{draw.__name__}", partial(draw, found), *about, "") for draw, about in _PLOTS.items())
    title = f"Best law: {prediction_title(found.best)}, fitted to all"
    fitted = Table(title, ("parameter", "value", "95 %"), parameters, folded=True)
    left_out = Section("Notes", [Bullets(found.notes)]) if found.notes else None
    return Section(data.title, [Note(source), *plots, fitted, left_out])
