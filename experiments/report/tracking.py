"""Tables of closed loops: errors along a path, and courses that are crossed."""

from collections.abc import Sequence
from math import degrees

from experiments.measuring.crossing import POLICY, SCRIPTED, CrossingGain, CrossingRate
from experiments.measuring.tracking import TrackingResult
from experiments.report.formats import number
from experiments.report.laws import shown
from experiments.report.table import Cell, Table

_CROSSING_HEADER = ("controller", "difficulty", "crossed [%]", "95 % interval", "tipped", "stuck", "other", "time [s]")
_HEADER = ("controller", "compensation", "rms [mm]", "> 12 s [mm]", "max [mm]", "end [mm]", "end [deg]")


def tracking_table(results: Sequence[TrackingResult]) -> Table:
    """A row per run."""
    rows: list[tuple[str | Cell, ...]] = []
    for result in results:
        errors = result.errors
        positions = (errors.rms_position, errors.rms_position_after_12s, errors.max_position, errors.final_position)
        cells = [*(number(1e3 * value, 1) for value in positions), number(degrees(errors.final_heading), 2)]
        compensation = Cell(shown(result.compensation).title, result.compensation)
        rows.append((result.controller, compensation, *cells))
    localization = ", ".join(dict.fromkeys(result.localization for result in results))
    note = f"Errors of position: rms over the whole run and from 12 s on, largest, final. Localization: {localization}."
    return Table("Tracking errors of the true pose", _HEADER, rows, "llr", note)


def crossing_table(title: str, rates: Sequence[CrossingRate]) -> Table:
    """A row per controller and difficulty."""
    rows = [
        (
            *(one.controller, f"{one.difficulty:.3g}", f"{100 * one.rate:.1f}"),
            f"{100 * one.low:.1f} to {100 * one.high:.1f}",
            *(str(count) for count in (one.tipped, one.stuck, one.other)),
            number(one.time, 1),
        )
        for one in rates
    ]
    return Table(title, _CROSSING_HEADER, rows)


def gain_text(gain: CrossingGain) -> str:
    """A sentence on the difference between two controllers."""
    rate = f"{100 * gain.gain:+.1f} points, 95 % interval {100 * gain.low:+.1f} to {100 * gain.high:+.1f}"
    alone = f"{gain.only_policy} courses are crossed by the {POLICY} alone, {gain.only_scripted} by the {SCRIPTED} one"
    return f"{POLICY} - {SCRIPTED}: {rate}; {alone}"
