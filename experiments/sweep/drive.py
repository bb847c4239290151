"""Drive and measure a fleet of a sweep: what a worker does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from experiments.driving.failures import failure_text, logs_until
from experiments.driving.grid_runs import drive_cells
from experiments.measuring.grid import LocalizationErrors
from experiments.storage.parts import Part
from experiments.sweep.plan import Run
from experiments.sweep.rows import RunRow
from sim.runs import Progress
from sim.stopwatch import Stopwatch
from trackslip.errors import LogError
from trackslip.identification.samples import true_samples, usable_samples
from trackslip.logs.runlog import RunLog


@dataclass(frozen=True)
class DrivenFleet:
    """What became of a fleet."""

    part: Part
    """Rows (of RunRow) and logs of its runs."""
    unfinished: list[RunLog]
    """What was recorded of runs that failed, until they did; empty unless recordings are wanted."""
    stages: dict[str, float]
    """Work by stage [s]."""
    duration: float
    """Simulated time of all its runs together [s]."""


def drive(runs: Sequence[Run], threads: int = 1, report: Progress = lambda seconds: None) -> DrivenFleet:
    """Drive a fleet. If it fails, its halves are driven, until the runs that fail stand alone.

    `report` is called with the simulated seconds that have passed, of all runs together.
    """
    watch = Stopwatch()
    outcomes = _outcomes(runs, threads, lambda seconds: report(seconds * len(runs)), watch)
    rows, logs, unfinished = [], [], []
    for run, outcome in zip(runs, outcomes, strict=True):
        row = RunRow(run.name, run.id, run.axes)
        if isinstance(outcome, RunLog):
            with watch.stage("slips"):
                rows.append(_measured(outcome, run, row))
            logs.append(outcome)
        else:
            rows.append(replace(row, error=failure_text(outcome)))
            unfinished += logs_until(outcome) if run.config.rrd else []
    with watch.stage("storing"):
        part = Part.of([row.to_json() for row in rows], logs)
    return DrivenFleet(part, unfinished, watch.stages, sum(run.config.duration for run in runs))


def _outcomes(runs: Sequence[Run], threads: int, report: Progress, watch: Stopwatch) -> list[RunLog | Exception]:
    try:
        worlds = [run.world(threads) for run in runs]
        return list(drive_cells([run.cell for run in runs], worlds, report, watch))
    except Exception as error:  # a run that fails is a row
        if len(runs) == 1:
            return [error]
    middle = len(runs) // 2
    return [outcome for half in (runs[:middle], runs[middle:]) for outcome in _outcomes(half, threads, report, watch)]


def _measured(log: RunLog, run: Run, row: RunRow) -> RunRow:
    """The row with the run's numbers; without slips where there are none, and a note why."""
    geometry = run.world(1).robot.geometry
    try:
        sampling = usable_samples([log], geometry, method=run.config.motion)
        sample, truth = sampling.samples, true_samples([log], geometry)
        row = replace(
            row,
            **dict(zip(("omega_l", "omega_r"), sample.omega[0].tolist(), strict=True)),
            **dict(zip(("v", "w"), sample.twist[0].tolist(), strict=True)),
            **dict(zip(("slip_l", "slip_r"), sample.slip[0].tolist(), strict=True)),
            **dict(zip(("true_slip_l", "true_slip_r"), truth.slip[0].tolist(), strict=True)),
            observed_radius=float(sample.radius[0]),
            note="; ".join(sampling.notes) or None,
        )
    except LogError as error:
        row = replace(row, note=f"run {log.run!r} left out: {str(error).removeprefix(f'run {log.run!r}: ')}")
    located = LocalizationErrors.of([log])
    saturated = None if log.truth is None else log.truth.saturated
    return replace(
        row,
        rmse_x=located.rmse_x,
        rmse_y=located.rmse_y,
        rmse_heading=located.rmse_heading,
        valid_fraction=located.valid_fraction,
        saturated=0.0 if saturated is None else float(saturated.mean(axis=0).max()),
    )
