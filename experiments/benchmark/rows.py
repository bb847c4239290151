"""The rows of a benchmark: runs, means over seeds, and the leaderboard."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from experiments.benchmark.cases import Case
from experiments.storage.manifest import relative
from experiments.storage.plain_json import plain
from sim.seeds import generator
from trackslip.metrics import Expense, TrackingErrors

Measures = Mapping[str, float | None]
"""Values of MEASURES by name, in their units; None where there is nothing to measure."""
_OF_ONLINE = ("icr_offset", "icr_radius_error")
MEASURES = (
    *(f.name for f in dataclasses.fields(TrackingErrors) if f.name != "success"),
    *(f.name for f in dataclasses.fields(Expense)),
    "valid_fraction",
    *_OF_ONLINE,
)
"""Errors and expense of a run, as in `trackslip.metrics`; the share of the scans that gave a pose [-]; and what online
compensation found in the end: the longitudinal offset of the ICRs [m] and the error of the sprocket radius [-]."""
WITH_INTERVAL = ("rms_position", "rms_position_after_12s", "rms_position_arc", "rms_heading")
"""Measures whose means have intervals."""
_RESAMPLES = 2000


@dataclass(frozen=True)
class CaseRow:
    """One run of a benchmark."""

    case: Case
    error: str | None = None
    """Why it failed."""
    measures: Measures = field(default_factory=dict)
    success: bool = False
    """Whether the robot stayed within 0.5 m of where it should be."""
    compute_ms: Sequence[float] = ()
    """Times of steps of its controller and compensation, if they were measured [ms]."""

    def to_json(self) -> dict[str, Any]:
        """As summary.json has it: of a run that failed, only what it is and why; no times."""
        row: dict[str, Any] = self.case.factors | {"error": self.error}
        if self.error is not None:
            return row
        measured = {n: value for n, value in self.measures.items() if n not in _OF_ONLINE or value is not None}
        return row | measured | {"success": self.success}

    def to_part(self) -> dict[str, Any]:
        """As a part has it."""
        measured = {"measures": self.measures, "success": self.success, "compute_ms": self.compute_ms}
        return {"run": self.case.name, "id": self.case.id, "error": self.error, **measured}

    @classmethod
    def from_part(cls, case: Case, row: Mapping[str, Any]) -> Self:
        """From what `to_part` gave."""
        return cls(case, row["error"], row["measures"], row["success"], row["compute_ms"])


@dataclass(frozen=True)
class BoardEntry:
    """A line of the leaderboard: means over the references and grounds of a controller with a compensation."""

    controller: str
    compensation: str
    start: str
    means: Measures
    """Over the runs that did not fail."""
    success: float
    """Share of the runs that stayed within 0.5 m of where they should be."""
    compute_ms_p50: float | None
    """Median time of a step of controller and compensation [ms]."""


@dataclass(frozen=True)
class BenchmarkRow(BoardEntry):
    """The same for one reference and ground: means over the runs that differ only in their seeds."""

    reference: str
    ground: str
    seeds: int
    """Number of runs."""
    failed: int
    """Number of runs that failed."""
    intervals: Mapping[str, tuple[float, float] | None]
    """95 % bootstrap intervals of the means of WITH_INTERVAL, in their units; None for fewer than two runs."""
    compute_ms_p99: float | None
    """99th percentile of the time of a step [ms]."""

    def to_json(self) -> dict[str, Any]:
        """As summary.json has it."""
        row = plain(self)
        means, intervals = row.pop("means"), row.pop("intervals")
        return row | means | {f"{name}_ci95": ends for name, ends in intervals.items()}

    @classmethod
    def of(cls, runs: Sequence[CaseRow]) -> Self:
        """From the rows of its runs."""
        measured = [run.measures for run in runs if run.error is None]
        times = [time for run in runs for time in run.compute_ms]
        p50, p99 = (float(np.percentile(times, percent)) if times else None for percent in (50, 99))
        return cls(
            **{name: value for name, value in runs[0].case.factors.items() if name != "seed"},
            seeds=len(runs),
            failed=len(runs) - len(measured),
            means=_means(measured),
            intervals={name: bootstrap95(_known(one.get(name) for one in measured)) for name in WITH_INTERVAL},
            success=float(np.mean([run.success for run in runs])),
            compute_ms_p50=p50,
            compute_ms_p99=p99,
        )


def over_seeds(runs: Sequence[CaseRow]) -> list[BenchmarkRow]:
    """One row for the runs that differ only in their seeds, in order."""
    found: dict[Case, list[CaseRow]] = {}
    for run in runs:
        found.setdefault(replace(run.case, seed=0, id=""), []).append(run)
    return [BenchmarkRow.of(same) for same in found.values()]


def bootstrap95(values: Sequence[float]) -> tuple[float, float] | None:
    """Percentile bootstrap interval of the mean over seeds; None for fewer than two values."""
    if len(values) < 2:
        return None
    drawn = generator(0, "bootstrap over seeds").integers(len(values), size=(_RESAMPLES, len(values)))
    low, high = np.percentile(np.array(values)[drawn].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)


def board(rows: Sequence[BenchmarkRow]) -> list[BoardEntry]:
    """The leaderboard: entries that keep the path most often come first.

    Equals are ordered by the mean of the position error once the transient is over.
    """
    found: dict[tuple[str, str, str], list[BenchmarkRow]] = {}
    for row in rows:
        found.setdefault((row.controller, row.compensation, row.start), []).append(row)
    entries = []
    for names, same in found.items():
        means, success = _means([row.means for row in same]), float(np.mean([row.success for row in same]))
        entries.append(BoardEntry(*names, means, success, _mean(row.compute_ms_p50 for row in same)))
    return sorted(entries, key=lambda entry: (-entry.success, settled_error(entry.means)))


def settled_error(means: Measures) -> float:
    """Position error once the transient is over, or that of a shorter run; infinite where there is none [m]."""
    known = _known((means["rms_position_after_12s"], means["rms_position"]))
    return known[0] if known else float("inf")


def losses(rows: Sequence[BenchmarkRow]) -> list[str]:
    """One line for each controller, compensation and ground: how many runs lost the path, or failed, and where."""
    found: dict[tuple[str, str, str], list[BenchmarkRow]] = {}
    for row in rows:
        found.setdefault((row.controller, row.compensation, row.ground), []).append(row)
    lines = []
    for (controller, compensation, ground), same in found.items():
        lost = sum(round((1 - row.success) * row.seeds) for row in same)
        if lost:
            failed = sum(row.failed for row in same)
            where = ", ".join(dict.fromkeys(relative(row.reference) for row in same if row.success < 1))
            lines.append(
                f"{relative(controller)} with {compensation} on {relative(ground)} loses the path in {lost} of"
                f" {sum(row.seeds for row in same)} runs{f', {failed} of them failed' if failed else ''}: {where}"
            )
    if len(lines) < len(found):
        lines.append("all others keep the path in every run" if lines else "every run keeps the path")
    return lines


def _means(measured: Sequence[Measures]) -> Measures:
    """Means over those that have a value."""
    return {name: _mean(one.get(name) for one in measured) for name in MEASURES}


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _mean(values: Iterable[float | None]) -> float | None:
    known = _known(values)
    return float(np.mean(known)) if known else None
