"""Laws identified from whole drives: their tables, and their section of a page."""

from functools import partial
from math import degrees

from markupsafe import Markup

from experiments.report.figures import drives as figures
from experiments.report.formats import MISSING, number, pair, significant
from experiments.report.laws import (
    NO_SLIP,
    law_cell,
    parameter_bullets,
    parameter_rows,
    prediction_title,
    symbol,
    unit_of,
    with_error,
)
from experiments.report.page import Block, Plot, Section
from experiments.report.table import Cell, Table
from trackslip.errors import counted
from trackslip.identification.comparison import DriveComparison
from trackslip.identification.drive_law import DriveFit
from trackslip.identification.drive_model import EXTRAS
from trackslip.identification.prediction import HORIZONS
from trackslip.identification.result import Identification

_VALUES = ("value ± std. error", "95 % interval")
_LAW_NOTE = (
    "The standard error holds if slip varies from moment to moment; the 95 % interval also allows for slip that lasts "
    "for seconds. A parameter that the driving does not show is held."
)
AHEAD = tuple(f"{horizon:g} s" for horizon in HORIZONS)
_SCORE_NOTE = (
    "The score is the mean ratio of a law's rms errors to the smallest of any law. Laws whose score is within 2 % of "
    "the smallest predict equally well; of these, the best is the simplest of the likeliest."
)
_HELD = "held"
_TOLD = 2.0  # horizon of the errors in the text [s]
_NOISE = {
    "position": ("position of a pose", 1e3, "mm"),
    "heading": ("heading of a pose", degrees(1.0), "°"),
    "slip_forward": ("slip forwards", 1e3, "mm per √m"),
    "slip_sideways": ("slip sideways", 1e3, "mm per √m"),
    "slip_turn": ("slip in turning", 1e3, "mrad per √m"),
}


def law_table(found: DriveComparison) -> Table:
    """The parameters of the laws, the best predictions first."""
    rows: list[tuple[str | Cell, ...]] = []
    for name in found.ranking:
        law = found.laws[name]
        parameters = [(symbol(name, key), *_printed(law, key, value)) for key, value in law.values.items()]
        rows += parameter_rows(law_cell(name, name == found.best), parameters)
    count = len(found.drives)
    title = f"Slip laws from {counted(count, 'whole drive')}"
    return Table(title, ("law", "parameter", *_VALUES), rows, "llr", _LAW_NOTE)


def extra_table(law: DriveFit) -> Table:
    """Sensor, clock and drift under a law."""
    rows = []
    for name, value in law.extras.items():
        text, interval = _printed(law, name, value)
        held = Cell(f"{_HELD}: {law.held[name]}", _HELD) if name in law.held else interval
        rows.append((EXTRAS[name].title, symbol(law.name, name), text, held))
    return Table("Sensor and clock, by the best law", ("quantity", "", *_VALUES), rows, "llr")


def _printed(law: DriveFit, name: str, value: float) -> tuple[str, ...]:
    """Value with standard error, and 95 % interval."""
    factor, unit = unit_of(law.name, name)
    if name in law.stderr:
        return with_error(value, law.stderr[name], (factor, unit), law.interval95[name])
    return f"{factor * value:.4g} {unit}".rstrip().replace("-", "−"), _HELD


def held_lines(law: DriveFit) -> list[str]:
    """A line for each parameter that was held, with the reason."""
    return [f"held: {symbol(law.name, name)} ({name}), {reason}" for name, reason in law.held.items()]


def position_table(found: DriveComparison) -> Table:
    """Errors of position of held-out prediction, the best law first."""
    rows = [(*_errors(found, name, "position", 1.0, 3), number(found.score[name], 3)) for name in found.ranking]
    header = ("law", *AHEAD, "score")
    return Table("Held-out prediction of position, rms | median [m]", header, rows, note=_SCORE_NOTE)


def heading_table(found: DriveComparison) -> Table | None:
    """Errors of heading; None if no headings were measured."""
    if not _has_headings(found):
        return None
    rows = [_errors(found, name, "heading", degrees(1.0), 2) for name in found.ranking]
    return Table("Held-out prediction of heading, rms | median [deg]", ("law", *AHEAD), rows)


def _errors(found: DriveComparison, law: str, quantity: str, factor: float, digits: int) -> tuple[str | Cell, ...]:
    """A law and its errors of `quantity`, rms | median, at each horizon."""
    title = law_cell(law, law == found.best, formula=False)
    cells: list[str | Cell] = [Cell(NO_SLIP, "none", ["none"], title.mark) if law == "none" else title]
    for horizon in HORIZONS:
        errors = found.errors[law].get(horizon)
        known = [getattr(errors, f"{quantity}_{kind}", None) for kind in ("rms", "median")]
        sizes = [number(factor * error, digits) for error in known if error is not None]
        cells.append(pair(sizes) if sizes else MISSING)
    return tuple(cells)


def _has_headings(found: DriveComparison) -> bool:
    return any(drive.has_heading for drive in found.drives)


def noise_text(found: DriveComparison) -> str:
    """A text on the scatter about the best law."""
    noise = found.laws[found.best].noise
    sizes = [
        f"{what} {significant(factor * noise[key], unit)}"
        for key, (what, factor, unit) in _NOISE.items()
        if key != "heading" or _has_headings(found)
    ]
    scatter = "Estimated scatter (standard deviations; slip per square root of the distance driven)"
    return f"{scatter}: {', '.join(sizes)}."


def gain(found: DriveComparison) -> str:
    """A sentence on the gain of the best law over no compensation; empty if it isn't known."""
    ours, theirs = (found.errors.get(name, {}).get(_TOLD) for name in (found.best, "none"))
    if ours is None or theirs is None or found.best == "none":
        return ""
    parts = [f"position {theirs.position_rms / ours.position_rms:.2g} times"]
    if ours.heading_rms and theirs.heading_rms:
        parts.append(f"heading {theirs.heading_rms / ours.heading_rms:.2g} times")
    return f"{_TOLD:g} s ahead, it predicts {' and '.join(parts)} better than {NO_SLIP} (rms)"


def whole_drives(found: Identification) -> Section | None:
    """The section of an identification from whole drives; None if there is none."""
    drive = found.drive
    if drive is None:
        return None
    best, told = drive.laws[drive.best], gain(drive)
    steady_too = "" if found.method == "drive" else (
        " Most of the driving was steady, so the laws above are the result; these, from all of it, are for comparison."
    )  # fmt: skip
    path = Plot(
        "drive_path",
        partial(figures.path_and_predictions, drive),
        f"Path of {drive.drives[figures.longest(drive)].name}",
        "Left: measured poses and the most likely trajectory of the longest drive. Right: the same trajectory (thin), "
        "and where laws that were fitted to other driving predict the robot to go from the dots by its sprocket speeds "
        "alone.",
    )
    prediction = Section(
        "Which law predicts motion",
        [
            Markup(
                "The best law here is <strong>{}</strong>{}. Each law is fitted to a part of the driving and predicts "
                "the rest: from every measured pose, the sprocket speeds lead 1, 2, 5 and 10 s ahead. Errors include "
                "those of the measured poses at both ends, which no law can remove."
            ).format(prediction_title(drive.best), told and f": {told}"),
            Plot(
                "drive_prediction_errors",
                partial(figures.prediction_errors, drive),
                "Errors of prediction",
                "Root mean square errors against the time ahead; thick: the best law. Where lines are flat, the poses' "
                "noise is all that is left; where they rise, the law is wrong or slip varies.",
            ),
            position_table(drive),
            heading_table(drive),
        ],
    )
    meaning = () if found.steady else ("The parameters of the laws are:", parameter_bullets(drive.laws, found.geometry))
    laws = Section("Laws of whole drives", [*meaning, law_table(drive), extra_table(best), noise_text(drive)])
    residuals = Plot(
        "drive_residuals",
        partial(figures.residuals_over_time, best),
        "Residuals over time",
        "Top: the trajectory minus measured poses; a good fit scatters within the green band without a trend. Bottom: "
        "smoothed departures of each step from the law, over their standard deviation; where one lasts, the ground may "
        "be another.",
    )
    clock = Plot(
        "drive_clock_offset",
        partial(figures.clock_offset, drive),
        "Clock offset",
        "How much less likely the data become with another offset. A narrow valley means that the driving shows it.",
    )
    correlations = Plot(
        "drive_correlations",
        partial(figures.drive_correlations, best),
        "Correlation of the parameters",
        "Between the errors of two parameters. At +1 or −1 the driving shows only a combination of the two.",
    )
    blocks: list[Block | None] = [
        _driven(drive) + steady_too,
        path,
        prediction,
        laws,
        residuals,
        clock if drive.clock else None,
        correlations if len(best.free) > 1 else None,
    ]
    return Section("Whole drives", blocks)


def _driven(drive: DriveComparison) -> str:
    """A paragraph on the data that the laws were estimated from."""
    best = drive.laws[drive.best]
    duration = sum(float(one.time[-1] - one.time[0]) for one in drive.drives)
    blind = "" if _has_headings(drive) else " without headings"
    return (
        f"Every pose and every encoder reading counts here: {counted(len(drive.drives), 'drive')}, {duration:.0f} s, "
        f"{counted(best.poses, 'pose')}{blind}, without {counted(best.left_out, 'outlying pose')} and "
        f"{counted(best.breaks, 'lasting jump')}. Estimated together are the trajectory, the law, where the sensor "
        "sits, the clock offset, and how large all errors are."
    )
