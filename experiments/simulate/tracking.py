"""Tracking errors of simulated closed-loop runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from experiments.common.plain_json import plain
from trackslip.errors import LogError
from trackslip.logs.runlog import RunLog
from trackslip.metrics import TrackingErrors, tracking_errors
from trackslip.trajectory.base import Reference


@dataclass(frozen=True)
class TrackingResult:
    """One run and the errors of its true pose."""

    controller: str
    compensation: str
    localization: str
    errors: TrackingErrors

    def to_json(self) -> dict[str, Any]:
        """An entry of `tracking` in a summary.json."""
        entry = plain(self)
        return entry | entry.pop("errors")


def tracking_results(logs: Sequence[RunLog], reference: Reference) -> list[TrackingResult]:
    """Evaluate runs against their reference; raises LogError for a run without truth."""
    results = []
    for log in logs:
        if log.truth is None:
            raise LogError(f"run {log.run!r}: has no truth")
        names = {key: str(log.metadata[key]) for key in ("controller", "compensation", "localization")}
        results.append(TrackingResult(**names, errors=tracking_errors(log.time, log.truth.pose, reference)))
    return results
