"""Tables of tracking errors, for the terminal and for pages."""

from collections.abc import Sequence
from math import degrees

from experiments.measuring.tracking import TrackingResult
from experiments.report.formats import for_terminal, number
from experiments.report.laws import shown

TRACKING_HEADER = ("controller", "compensation", "rms [mm]", "> 12 s [mm]", "max [mm]", "end [mm]", "end [deg]")


def tracking_table(results: Sequence[TrackingResult]) -> list[tuple[str, ...]]:
    """One line per run, under TRACKING_HEADER."""
    return for_terminal([(result.controller, result.compensation, *_errors(result)) for result in results])


def tracking_rows(results: Sequence[TrackingResult]) -> list[tuple[str, ...]]:
    """One row per run for a page: controller, compensation, localization, and the errors in mm and degrees."""
    return [(r.controller, shown(r.compensation).title, r.localization, *_errors(r)) for r in results]


def _errors(result: TrackingResult) -> list[str]:
    errors = result.errors
    positions = (errors.rms_position, errors.rms_position_after_12s, errors.max_position, errors.final_position)
    return [*(number(1e3 * value, 1) for value in positions), number(degrees(errors.final_heading), 2)]
