"""The table of errors along a path."""

from collections.abc import Sequence
from math import degrees

from experiments.common.formats import number
from experiments.common.laws import shown
from experiments.common.table import Cell, Table
from experiments.simulate.tracking import TrackingResult

_HEADER = ("controller", "compensation", "rms [mm]", "> 12 s [mm]", "max [mm]", "end [mm]", "end [deg]")


def tracking_table(results: Sequence[TrackingResult]) -> Table:
    """A row per run."""
    rows: list[tuple[str | Cell, ...]] = []
    for result in results:
        errors = result.errors
        positions = (errors.rms_position, errors.rms_position_after_12s, errors.max_position, errors.final_position)
        cells = [*(number(1e3 * value, 1) for value in positions), number(degrees(errors.final_heading), 2)]
        compensation = Cell(shown(result.compensation).label, result.compensation)
        rows.append((result.controller, compensation, *cells))
    localization = ", ".join(dict.fromkeys(result.localization for result in results))
    note = f"Errors of position: rms over the whole run and from 12 s on, largest, final. Localization: {localization}."
    return Table("Tracking errors of the true pose", _HEADER, rows, "llr", note)
