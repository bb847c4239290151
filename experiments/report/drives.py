"""Laws identified from whole drives: their tables, and their section of a page."""

from collections.abc import Callable, Mapping
from functools import partial
from math import degrees

from markupsafe import Markup

from experiments.report.figures import drives as figures
from experiments.report.formats import MISSING, number, pair, significant
from experiments.report.laws import (
    EXTRA_SYMBOLS,
    EXTRA_TITLES,
    NO_SLIP,
    SYMBOLS,
    digits_for,
    law_cell,
    parameter_bullets,
    prediction_title,
    unit_of,
    unit_of_extra,
)
from experiments.report.page import Plot, Section
from experiments.report.table import Cell, Table
from trackslip.identification.drive.comparison import DriveComparison
from trackslip.identification.drive.estimate import DriveFit
from trackslip.identification.drive.prediction import HORIZONS, Errors
from trackslip.identification.result import Identification

_LAW_HEADER = ("law", "parameter", "value ± std. error", "95 % interval")
_LAW_NOTE = (
    "The standard error holds if slip varies from moment to moment. The 95 % interval also allows for slip that lasts "
    "for seconds: it is the wider of the model's and of the one that follows from the scatter between stretches of "
    "10 s. A parameter that the driving does not show is held."
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
        parameters = [
            (SYMBOLS.get(key, key), *_printed(law, key, value, *unit_of(name, key)))
            for key, value in law.values.items()
        ]
        first = _law(name, found, formula=True)
        rows += [(first if k == 0 else "", *cells) for k, cells in enumerate(parameters)]
    count = len(found.drives)
    title = f"Slip laws from {'a whole drive' if count == 1 else f'{count} whole drives'}"
    return Table(title, _LAW_HEADER, rows, "llr", _LAW_NOTE)


def extra_table(law: DriveFit) -> Table:
    """Sensor, clock and drift under a law."""
    rows = []
    for name, value in law.extras.items():
        text, interval = _printed(law, name, value, *unit_of_extra(name))
        held = Cell(f"{_HELD}: {law.held[name]}", _HELD) if name in law.held else interval
        rows.append((EXTRA_TITLES[name], EXTRA_SYMBOLS[name], text, held))
    header = ("of the best law", "", "value ± std. error", "95 % interval")
    return Table("Sensor and clock, by the best law", header, rows, "llr")


def held_lines(law: DriveFit) -> list[str]:
    """A line for each parameter that was held, with the reason."""
    symbols = SYMBOLS | EXTRA_SYMBOLS
    return [f"held: {symbols[name]} ({name}), {reason}" for name, reason in law.held.items()]


def position_table(found: DriveComparison) -> Table:
    """Errors of position of held-out prediction, the best law first."""
    rows = [(*_errors(found, name, _position), number(found.score[name], 3)) for name in found.ranking]
    header = ("law", *AHEAD, "score")
    return Table("Held-out prediction of position, rms | median [m]", header, rows, note=_SCORE_NOTE)


def heading_table(found: DriveComparison) -> Table | None:
    """The same of heading; None if no headings were measured."""
    if not any(drive.has_heading for drive in found.drives):
        return None
    rows = [_errors(found, name, _heading) for name in found.ranking]
    return Table("Held-out prediction of heading, rms | median [deg]", ("law", *AHEAD), rows)


def whole_drives(found: Identification) -> Section | None:
    """The section of an identification from whole drives; None if there is none."""
    drive = found.drive
    if drive is None:
        return None
    best = drive.laws[drive.best]
    several, title = len(drive.drives) > 1, prediction_title(drive.best)
    told = gain(drive)
    meaning = ["A slip law gives the slip of both tracks in a turn of radius R. Its parameters are:"]
    prediction = Section(
        "Which law predicts motion",
        [
            Markup(
                "The best law here is <strong>{}</strong>{}. Each law is fitted to {} and predicts the rest: from "
                "every measured pose, the sprocket speeds lead 1, 2, 5 and 10 s ahead, without looking at poses on the "
                "way. Errors include those of the measured poses at both ends, which no law can remove."
            ).format(
                title, f": {told}" if told else "", "all drives but some" if several else "the first half of the drive"
            ),
            Plot(
                "drive_prediction_errors",
                partial(figures.prediction_errors, drive),
                "Errors of prediction",
                "Root mean square errors against how far ahead is predicted, on logarithmic scales; thick: the best "
                "law. Where lines are flat, the poses' noise is all that is left; where they rise, the law is wrong "
                "or slip varies.",
            ),
            position_table(drive),
            heading_table(drive),
        ],
    )
    laws = Section(
        "Laws of whole drives",
        [
            *([*meaning, parameter_bullets(found.geometry)] if found.steady is None else ()),
            law_table(drive),
            extra_table(best),
            noise_text(drive),
        ],
    )
    path = Plot(
        "drive_path",
        partial(figures.path_and_predictions, drive),
        f"Path of {drive.drives[figures.longest(drive)].name}",
        f"Left: measured poses and the most likely trajectory{' of the longest drive' if several else ''}. Right: the "
        "same trajectory (thin), and where the laws predict the robot to go from a few measured poses (dots) by its "
        "sprocket speeds alone. The laws that predict were fitted to "
        f"{'other drives' if several else 'the first half of the drive'}.",
    )
    return Section("Whole drives", [_summary(found, drive), path, prediction, laws, *_plots(drive, best)])


def _summary(found: Identification, drive: DriveComparison) -> str:
    """What the laws were estimated from, and together with what."""
    best, count = drive.laws[drive.best], len(drive.drives)
    duration = sum(float(one.time[-1] - one.time[0]) for one in drive.drives)
    time = f"{duration:.0f} s" if duration < 600 else f"{duration / 60:.0f} min"
    blind = "" if any(one.has_heading for one in drive.drives) else " without headings"
    outlying = f"; {best.left_out} more are outlying and were left out" if best.left_out else ""
    jumps = (
        f" At {best.breaks} step{'' if best.breaks == 1 else 's'} the poses jump lastingly, or the robot slips out of "
        "all proportion; there the trajectory is cut."
    )
    beside = (
        " Most of the driving was steady, so the laws above are the result; these, from all of it, are for comparison."
    )
    return (
        f"Every pose and every encoder reading of {'the drive' if count == 1 else f'{count} drives'} counts here "
        f"({time}, {best.poses:,} poses{blind}{outlying}), at whatever speeds the robot drove. Estimated together are "
        "the trajectory, the law, where the sensor sits, the offset of the clocks, and how large all errors are: the "
        "most likely ones, if the robot moves as the law says, but for slip that varies, and the poses scatter about "
        f"the trajectory.{jumps if best.breaks else ''}{'' if found.method == 'drive' else beside}"
    )


def _plots(drive: DriveComparison, best: DriveFit) -> tuple[Plot | None, ...]:
    """The figures at the end of the section."""
    return (
        Plot(
            "drive_residuals",
            partial(figures.residuals_over_time, best),
            "Residuals over time",
            "Top: the trajectory minus measured poses; a good fit scatters within the green band without a trend. "
            "Bottom: how far each step of the trajectory departs from the law, over its standard deviation. These "
            "departures are smoothed, because single poses tell little of single steps: look for places where one "
            "lasts, such as other ground. Points are thinned out.",
        ),
        Plot(
            "drive_clock_offset",
            partial(figures.clock_offset, drive),
            "Offset of the clocks",
            "How much less likely the data become if the encoders' clock is ahead of the poses' by something else. A "
            "narrow valley means that the driving shows the offset well.",
        )
        if drive.clock is not None
        else None,
        Plot(
            "drive_correlations",
            partial(figures.drive_correlations, best),
            "Correlation of the parameters",
            "Correlation between the errors of two parameters. At +1 or −1 the driving shows only a combination of "
            "the two; more varied driving separates them.",
        )
        if len(best.free) > 1
        else None,
    )


def noise_text(found: DriveComparison) -> str:
    """What scatters by the best law, and by how much."""
    headings = any(drive.has_heading for drive in found.drives)
    sizes = [
        f"{what} {significant(factor * found.laws[found.best].noise[key], unit)}"
        for key, (what, factor, unit) in _NOISE.items()
        if headings or key != "heading"
    ]
    scatter = "Estimated scatter (standard deviations; slip per square root of the distance driven)"
    return f"{scatter}: {', '.join(sizes)}."


def gain(found: DriveComparison) -> str:
    """How much better the best law predicts than no compensation does, in words; empty if that isn't known."""
    ours, theirs = (found.errors.get(name, {}).get(_TOLD) for name in (found.best, "none"))
    if ours is None or theirs is None or found.best == "none":
        return ""
    parts = [f"position {theirs.position_rms / ours.position_rms:.2g} times"]
    if ours.heading_rms and theirs.heading_rms:
        parts.append(f"heading {theirs.heading_rms / ours.heading_rms:.2g} times")
    return f"{_TOLD:g} s ahead, it predicts {' and '.join(parts)} better than {NO_SLIP} (rms)"


def _law(name: str, found: DriveComparison, formula: bool = False) -> Cell:
    law = law_cell(name, name == found.best, formula)
    return Cell(NO_SLIP, "", law.lines, law.mark) if name == "none" else law


def _errors(found: DriveComparison, name: str, cell: Callable[[Errors], str]) -> tuple[str | Cell, ...]:
    """A law and its errors at each horizon."""
    errors: Mapping[float, Errors] = found.errors[name]
    return (_law(name, found), *(cell(errors[h]) if h in errors else MISSING for h in HORIZONS))


def _printed(law: DriveFit, name: str, value: float, factor: float, unit: str) -> tuple[str, str]:
    """Value with standard error, and 95 % interval, with as many decimals as show two digits of the error."""
    if name not in law.stderr:
        return f"{factor * value:.4g} {unit}".rstrip().replace("-", "−"), _HELD
    error = factor * law.stderr[name]
    digits = digits_for(error)
    interval = " to ".join(number(factor * end, digits) for end in law.interval95[name])
    return f"{number(factor * value, digits)} ± {number(error, digits)} {unit}".rstrip(), interval


def _position(errors: Errors) -> str:
    return pair([number(e, 3) for e in (errors.position_rms, errors.position_median)])


def _heading(errors: Errors) -> str:
    if errors.heading_rms is None or errors.heading_median is None:
        return MISSING
    return pair([number(degrees(error), 2) for error in (errors.heading_rms, errors.heading_median)])
