"""Tracking errors of simulated closed-loop runs, and their table."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any, Final

from experiments.common.plain_json import plain
from experiments.common.table import Table, number
from trackslip.errors import LogError
from trackslip.logs.runlog import RunLog
from trackslip.metrics import TrackingErrors, tracking_errors
from trackslip.trajectory.base import Reference

_HEADER: Final = (
    "controller",
    "compensation",
    "rms [mm]",
    "> 12 s [mm]",
    "max [mm]",
    "end [mm]",
    "end [deg]",
)


@dataclass(frozen=True)
class TrackingResult:
    """A closed-loop run, and the tracking errors of its true pose."""

    controller: str
    compensation: str
    localization: str
    errors: TrackingErrors

    def to_json(self) -> dict[str, Any]:
        """The result as an entry of `tracking` in summary.json."""
        entry = plain(self)
        return entry | entry.pop("errors")


def tracking_results(logs: Sequence[RunLog], reference: Reference) -> list[TrackingResult]:
    """Evaluate runs against their reference; raises LogError for a run without truth."""
    results = []
    for log in logs:
        if log.truth is None:
            raise LogError(f"run {log.run!r}: has no truth")
        result = TrackingResult(
            controller=str(log.metadata["controller"]),
            compensation=str(log.metadata["compensation"]),
            localization=str(log.metadata["localization"]),
            errors=tracking_errors(log.time, log.truth.pose, reference),
        )
        results.append(result)
    return results


def tracking_table(results: Sequence[TrackingResult]) -> Table:
    """A table with a row per run."""
    rows = []
    for result in results:
        errors = result.errors
        row = (
            result.controller,
            result.compensation,
            number(1e3 * errors.rms_position, 1),
            number(1e3 * errors.rms_position_after_12s, 1),
            number(1e3 * errors.max_position, 1),
            number(1e3 * errors.final_position, 1),
            number(degrees(errors.final_heading), 2),
        )
        rows.append(row)
    localization = ", ".join(dict.fromkeys(result.localization for result in results))
    note = (
        "Errors of position: rms over the whole run and from 12 s on, largest, final. "
        f"Localization: {localization}."
    )
    return Table("Tracking errors of the true pose", _HEADER, rows, "llr", note)
