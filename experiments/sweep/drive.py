"""Driving and measuring a fleet of a grid: the task of a worker."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from experiments.driving.grid_runs import drive_cells
from experiments.measuring.grid import PoseErrors
from experiments.sweep.engine import DrivenFleet, Outcome, failure_text
from experiments.sweep.parts import Row
from experiments.sweep.plan import PlannedRun
from experiments.sweep.table import RunRow
from sim.runs import Progress
from sim.stopwatch import Stopwatch
from trackslip.errors import LogError
from trackslip.identification.samples import usable_samples
from trackslip.identification.true_samples import true_samples
from trackslip.logs.runlog import RunLog

_SAMPLED = ("omega_l", "omega_r", "v", "w", "slip_l", "slip_r", "true_slip_l", "true_slip_r", "observed_radius")


def drive_fleet(runs: Sequence[PlannedRun], threads: int = 0, report: Progress | None = None) -> DrivenFleet:
    """Drive a fleet on that many threads, 0 for one per processor, or for one if other processes drive, too."""
    watch = Stopwatch()
    advance = report or (lambda seconds: None)

    def drive(some: Sequence[PlannedRun]) -> list[RunLog]:
        worlds = [run.world(threads or (1 if report is None else 0)) for run in some]
        cells, kept = [run.cell for run in some], some[0].setting.kept
        return drive_cells(cells, worlds, lambda seconds: advance(seconds * len(some)), watch, kept)

    def rows(outcomes: Sequence[Outcome]) -> Iterator[Row]:
        for run, outcome in zip(runs, outcomes, strict=True):
            with watch.stage("slips"):
                yield measured(outcome, run).to_json()

    return DrivenFleet.of(runs, drive, rows, watch, runs[0].setting.config.rrd)


def measured(outcome: Outcome, run: PlannedRun) -> RunRow:
    """The run's row with its numbers; without slips where there are none, and a note why."""
    row = RunRow(run.name, run.id, run.axes)
    if not isinstance(outcome, RunLog):
        return replace(row, error=failure_text(outcome))
    geometry = run.world(1).robot.geometry
    try:
        sampling = usable_samples([outcome], geometry, method=run.setting.config.motion, longest=True)
        sample, truth = sampling.samples, true_samples([outcome], geometry)
        numbers = np.concatenate([sample.omega[0], sample.twist[0], sample.slip[0], truth.slip[0], sample.radius])
        note = "; ".join(sampling.notes) or None
        row = replace(row, note=note, **dict(zip(_SAMPLED, numbers.tolist(), strict=True)))
    except LogError as error:
        row = replace(row, note=f"run {run.name!r} left out: {str(error).removeprefix(f'run {run.name!r}: ')}")
    saturated = None if outcome.truth is None else outcome.truth.saturated
    share = 0.0 if saturated is None else float(saturated.mean(axis=0).max())
    return replace(row, **vars(PoseErrors.of([outcome])), saturated=share)
