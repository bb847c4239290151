"""Driving and measuring a fleet of a grid: the work of a worker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from experiments.driving.grid_runs import drive_cells
from experiments.measuring.grid import PoseErrors
from experiments.sweep.engine import Outcome, failure_text
from experiments.sweep.plan import PlannedRun
from experiments.sweep.table import Row
from sim.runs import Progress
from sim.stopwatch import Stopwatch
from trackslip.errors import LogError
from trackslip.identification.samples import usable_samples
from trackslip.identification.true_samples import true_samples
from trackslip.logs.runlog import RunLog

_SAMPLED = ("omega_l", "omega_r", "v", "w", "slip_l", "slip_r", "true_slip_l", "true_slip_r", "observed_radius")


@dataclass(frozen=True)
class GridRuns:
    """Runs of constant command in front of the scanner."""

    threads: int
    """Per fleet; 0 for one per processor, or for one if other processes drive, too."""
    recorded: bool
    """Whether recordings are made."""
    sizes: ClassVar[tuple[int, int]] = (64, 128)
    """Smaller fleets are slow; larger ones hardly gain, and lose more when a worker is stopped."""

    def drive(self, runs: Sequence[PlannedRun], watch: Stopwatch, progress: Progress | None) -> list[RunLog]:
        """Drive runs as one fleet."""
        worlds = [run.world(self.threads or (1 if progress is None else 0)) for run in runs]
        cells = [run.cell for run in runs]
        return drive_cells(cells, worlds, progress or (lambda seconds: None), watch, runs[0].setting.kept)

    def measure(self, runs: Sequence[PlannedRun], outcomes: Sequence[Outcome], watch: Stopwatch) -> list[Row]:
        """A row of each run."""
        with watch.stage("slips"):
            return [_measured(run, outcome) for run, outcome in zip(runs, outcomes, strict=True)]


def _measured(run: PlannedRun, outcome: Outcome) -> Row:
    """The run's row with its numbers; without slips where there are none, and a note why."""
    row: Row = {"run": run.name, "id": run.id, **run.axes, "error": None}
    if not isinstance(outcome, RunLog):
        return row | {"error": failure_text(outcome)}
    geometry = run.world(1).robot.geometry
    row |= dict.fromkeys(_SAMPLED)
    try:
        sampling = usable_samples([outcome], geometry, method=run.setting.config.motion, longest=True)
        sample, truth = sampling.samples, true_samples([outcome], geometry)
        numbers = np.concatenate([sample.omega[0], sample.twist[0], sample.slip[0], truth.slip[0], sample.radius])
        row |= dict(zip(_SAMPLED, numbers.tolist(), strict=True)) | {"note": "; ".join(sampling.notes) or None}
    except LogError as error:
        row["note"] = f"run {run.name!r} left out: {str(error).removeprefix(f'run {run.name!r}: ')}"
    saturated = None if outcome.truth is None else outcome.truth.saturated
    share = 0.0 if saturated is None else float(saturated.mean(axis=0).max())
    return row | vars(PoseErrors.of([outcome])) | {"saturated": share}
