"""Tracking errors of simulated closed-loop runs, and their table."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any

from experiments.common.plain_json import plain
from experiments.common.table import Table, number
from trackslip.errors import LogError
from trackslip.logs.runlog import RunLog
from trackslip.metrics import TrackingErrors, tracking_errors
from trackslip.trajectory.base import Reference

_HEADER = (
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
        names = {
            key: str(log.metadata[key]) for key in ("controller", "compensation", "localization")
        }
        results.append(
            TrackingResult(**names, errors=tracking_errors(log.time, log.truth.pose, reference))
        )
    return results


def tracking_table(results: Sequence[TrackingResult]) -> Table:
    """A table with a row per run."""
    rows = []
    for result in results:
        errors = result.errors
        positions = (
            errors.rms_position,
            errors.rms_position_after_12s,
            errors.max_position,
            errors.final_position,
        )
        cells = [
            *(number(1e3 * value, 1) for value in positions),
            number(degrees(errors.final_heading), 2),
        ]
        rows.append((result.controller, result.compensation, *cells))
    localization = ", ".join(dict.fromkeys(result.localization for result in results))
    note = (
        "Errors of position: rms over the whole run and from 12 s on, largest, final. "
        f"Localization: {localization}."
    )
    return Table("Tracking errors of the true pose", _HEADER, rows, "llr", note)
