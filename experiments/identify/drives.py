"""Laws identified from whole drives: their tables, and their section of a page."""

from functools import partial
from math import degrees

from markupsafe import Markup

from experiments.common.formats import MISSING, number, pair, significant
from experiments.common.laws import (
    NO_SLIP,
    law_cell,
    parameter_bullets,
    parameter_rows,
    prediction_title,
    symbol,
    unit_of,
    with_error,
)
from experiments.common.page import Block, Plot, Section
from experiments.common.table import Cell, Table
from experiments.identify import drive_figures as figures
from trackslip.errors import counted
from trackslip.identification.comparison import DriveComparison
from trackslip.identification.drive_law import DriveFit
from trackslip.identification.drive_model import EXTRAS
from trackslip.identification.drive_prediction import GAINS, TODAY
from trackslip.identification.result import Identification

_VALUES = ("value ± std. error", "95 % interval")
_LAW_NOTE = (
    "The standard error holds if slip varies from moment to moment; the 95 % interval also allows for slip that lasts "
    "for seconds. A parameter that the driving does not show is held."
)
_SCORE_NOTE = (
    "Of all pairs of measured poses between which the robot moves, outlying poses included. Today: dead reckoning "
    "without slip, delay, or a place of the sensor that wasn't given. Two gains: factors on speed and yaw rate by "
    "least squares, likewise without delay. The score is the mean error relative to the smallest of any law, averaged "
    "over the times ahead. Of the laws that predict as well as the one with the smallest errors at most times ahead, "
    "within one standard error, the best is the simplest."
)
_PLAIN = {TODAY: "as it drives today", GAINS: "two gains"}
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
    """Errors of position of held-out prediction: without identification, then the best law first."""
    rows = [(*_errors(found, name, "position", 1.0, 3), number(found.score.get(name), 2)) for name in _rows(found)]
    title = "Held-out prediction of position, rms | median | 90 % [m]"
    return Table(title, (*_header(found), "score"), rows, note=_SCORE_NOTE)


def heading_table(found: DriveComparison) -> Table | None:
    """Errors of heading; None if no headings were measured."""
    if not _has_headings(found):
        return None
    rows = [_errors(found, name, "heading", degrees(1.0), 1) for name in _rows(found)]
    return Table("Held-out prediction of heading, rms | median | 90 % [deg]", _header(found), rows)


def _rows(found: DriveComparison) -> list[str]:
    """What is compared by prediction, in the order of its rows."""
    return [*(name for name in _PLAIN if name in found.errors), *found.ranking]


def _header(found: DriveComparison) -> tuple[str, ...]:
    """The times ahead that the drives are long enough for, with the number of pairs of poses."""
    return ("law", *(f"{ahead:g} s, {errors.count:,} pairs" for ahead, errors in found.errors[found.best].items()))


def _errors(found: DriveComparison, law: str, quantity: str, factor: float, digits: int) -> tuple[str | Cell, ...]:
    """A law and its errors of `quantity`, rms | median | 90 %, at each horizon."""
    title = law_cell(law, law == found.best, formula=False)
    plain = {"none": Cell(NO_SLIP, "none", ["none"], title.mark)} | {key: Cell(text) for key, text in _PLAIN.items()}
    cells: list[str | Cell] = [plain.get(law, title)]
    for horizon in found.errors[found.best]:
        errors = found.errors[law].get(horizon)
        known = [getattr(errors, f"{quantity}_{kind}", None) for kind in ("rms", "median", "p90")]
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
    """A sentence on the gain of the best law over what the robot has today; empty if it isn't known."""
    ours, theirs = (found.errors.get(name, {}) for name in (found.best, TODAY))
    ahead = _TOLD if _TOLD in ours else min(ours, default=_TOLD)
    if not ours or ahead not in theirs:
        return ""
    us, them = ours[ahead], theirs[ahead]
    parts = [f"position {them.position_median / us.position_median:.2g} times"]
    if us.heading_median and them.heading_median:
        parts.append(f"heading {them.heading_median / us.heading_median:.2g} times")
    return f"{ahead:g} s ahead, it predicts {' and '.join(parts)} better than the robot does today (median)"


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
                "The best law here is <strong>{}</strong>: {}. {}Each law is fitted to a part of the driving and "
                "predicts the rest: from every measured pose, the sprocket speeds lead 1, 2, 5 and 10 s ahead. Errors "
                "include those of the measured poses at both ends, which no law can remove."
            ).format(prediction_title(drive.best), drive.reason, told and f"{told[0].upper()}{told[1:]}. "),
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
