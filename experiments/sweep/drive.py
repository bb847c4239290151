"""Drive and measure a fleet of a sweep: what a worker does."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from experiments.driving.failures import DrivenFleet, drive_isolating, failure_text, logs_until
from experiments.driving.grid_runs import drive_cells
from experiments.measuring.grid import PoseErrors
from experiments.storage.parts import Part
from experiments.sweep.plan import Run
from experiments.sweep.rows import RunRow
from sim.runs import Progress
from sim.stopwatch import Stopwatch
from trackslip.errors import LogError
from trackslip.identification.samples import usable_samples
from trackslip.identification.true_samples import true_samples
from trackslip.logs.runlog import RunLog

_SAMPLED = ("omega_l", "omega_r", "v", "w", "slip_l", "slip_r", "true_slip_l", "true_slip_r", "observed_radius")


def drive(runs: Sequence[Run], threads: int = 1, report: Progress = lambda seconds: None) -> DrivenFleet:
    """Drive a fleet. If it fails, its halves are driven, until the runs that fail stand alone.

    `report` is called with the simulated seconds that have passed, of all runs together.
    """
    watch = Stopwatch()

    def drive_fleet(some: Sequence[Run]) -> list[RunLog]:
        worlds = [run.world(threads) for run in some]
        cells, kept = [run.cell for run in some], some[0].setting.kept
        return drive_cells(cells, worlds, lambda seconds: report(seconds * len(some)), watch, kept)

    rows, logs, unfinished = [], [], []
    for run, outcome in zip(runs, drive_isolating(runs, drive_fleet), strict=True):
        row = RunRow(run.name, run.id, run.axes)
        if isinstance(outcome, RunLog):
            with watch.stage("slips"):
                rows.append(_measured(outcome, run, row))
            logs.append(outcome)
        else:
            rows.append(replace(row, error=failure_text(outcome)))
            unfinished += logs_until(outcome) if run.setting.config.rrd else []
    with watch.stage("storing"):
        part = Part.of([row.to_json() for row in rows], logs)
    return DrivenFleet(part, unfinished, sum(run.setting.config.duration for run in runs), watch.stages)


def _measured(log: RunLog, run: Run, row: RunRow) -> RunRow:
    """The row with the run's numbers; without slips where there are none, and a note why."""
    geometry = run.world(1).robot.geometry
    try:
        sampling = usable_samples([log], geometry, method=run.setting.config.motion, longest=True)
        sample, truth = sampling.samples, true_samples([log], geometry)
        numbers = np.concatenate([sample.omega[0], sample.twist[0], sample.slip[0], truth.slip[0], sample.radius])
        note = "; ".join(sampling.notes) or None
        row = replace(row, note=note, **dict(zip(_SAMPLED, numbers.tolist(), strict=True)))
    except LogError as error:
        row = replace(row, note=f"run {log.run!r} left out: {str(error).removeprefix(f'run {log.run!r}: ')}")
    saturated = None if log.truth is None else log.truth.saturated
    share = 0.0 if saturated is None else float(saturated.mean(axis=0).max())
    return replace(row, **vars(PoseErrors.of([log])), saturated=share)
