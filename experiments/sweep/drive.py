"""A fleet of a sweep, driven and measured: what a worker does."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from experiments.driving.grid_runs import drive_cells
from experiments.measuring.grid import LocalizationErrors
from experiments.storage.manifest import digest, made_by
from experiments.sweep.plan import Run
from sim.runs import Progress
from sim.stopwatch import Stopwatch
from trackslip.errors import LogError, TrackslipError
from trackslip.identification.samples import true_samples, usable_samples
from trackslip.logs import logfile
from trackslip.logs.runlog import RunLog

_MEASURED = ("omega_l", "omega_r", "v", "w", "observed_radius", "slip_l", "slip_r", "true_slip_l", "true_slip_r")


@dataclass(frozen=True)
class Part:
    """What became of a fleet's runs."""

    rows: list[dict[str, Any]]
    """One for each run, in order: what it is and what was measured, or why there is nothing."""
    runs: bytes | None
    """Those that were driven to the end, as a Parquet file."""
    stages: dict[str, float]
    """Seconds of work by stage."""
    duration: float
    """Simulated, of all its runs together [s]."""
    made_by: str
    """Digest of the code, models and libraries that drove it."""


def drive(runs: Sequence[Run], threads: int = 1, report: Progress = lambda seconds: None) -> Part:
    """Drive a fleet; where it fails, its halves are driven, until the runs that fail stand alone.

    `report` is told the seconds that pass, of all runs together.
    """
    watch = Stopwatch()
    outcomes = _outcomes(runs, threads, lambda seconds: report(seconds * len(runs)), watch)
    rows = []
    for run, outcome in zip(runs, outcomes, strict=True):
        row: dict[str, Any] = {"run": run.name, "id": run.id, **run.axes}
        if isinstance(outcome, RunLog):
            with watch.stage("slips"):
                row |= {"error": None} | _measured(outcome, run)
        else:
            row["error"] = outcome
        rows.append(row)
    logs = [outcome for outcome in outcomes if isinstance(outcome, RunLog)]
    with watch.stage("storing"):
        file = io.BytesIO()
        if logs:
            logfile.write_parquet(logs, file)
    duration = sum(run.config.duration for run in runs)
    return Part(rows, file.getvalue() or None, watch.stages, duration, digest(made_by()))


def _outcomes(runs: Sequence[Run], threads: int, report: Progress, watch: Stopwatch) -> list[RunLog | str]:
    try:
        worlds = [run.world(threads) for run in runs]
        return list(drive_cells([run.cell for run in runs], worlds, report, watch))
    except Exception as error:  # one failed run is a row
        if len(runs) == 1:
            said = str(error) if isinstance(error, TrackslipError) else f"{type(error).__name__}: {error}"
            return [" ".join(said.split())]
    middle = len(runs) // 2
    return [outcome for half in (runs[:middle], runs[middle:]) for outcome in _outcomes(half, threads, report, watch)]


def _measured(log: RunLog, run: Run) -> dict[str, Any]:
    """A run's numbers; None where it has none, and a note why."""
    row: dict[str, Any] = dict.fromkeys(_MEASURED) | {"note": None}
    geometry = run.world(1).robot.geometry
    try:
        sampling = usable_samples([log], geometry, method=run.config.motion)
        sample, truth = sampling.samples, true_samples([log], geometry)
        values = (*sample.omega[0], *sample.twist[0], sample.radius[0], *sample.slip[0], *truth.slip[0])
        row |= dict(zip(_MEASURED, map(float, values), strict=True)) | {"note": "; ".join(sampling.notes) or None}
    except LogError as error:
        row["note"] = f"run {log.run!r} left out: {str(error).removeprefix(f'run {log.run!r}: ')}"
    row |= {name: value for name, value in vars(LocalizationErrors.of([log])).items() if name != "rate_hz"}
    saturated = None if log.truth is None else log.truth.saturated
    return row | {"saturated": 0.0 if saturated is None else float(saturated.mean(axis=0).max())}
