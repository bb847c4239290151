"""Driving and measuring the runs of a grid: the work of a worker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from experiments.common.sweep import Row
from experiments.grid.plan import PlannedRun
from experiments.simulate.grid_runs import drive_cells
from experiments.simulate.grid_summary import PoseAccuracy
from sim.loop import Progress
from sim.stopwatch import Stopwatch
from trackslip.errors import LogError
from trackslip.identification.samples import true_samples, usable_samples
from trackslip.logs.runlog import RunLog

_SAMPLED = ("omega_l", "omega_r", "v", "w", "slip_l", "slip_r", "true_slip_l", "true_slip_r", "observed_radius")


@dataclass(frozen=True)
class GridRuns:
    """Runs of constant command in front of the scanner."""

    threads: int
    """Per fleet; 0 for one per processor, or for one if other processes drive, too."""
    sizes: ClassVar[tuple[int, int]] = (64, 128)
    """Smaller fleets are slow; larger ones hardly gain, and lose more when a worker is stopped."""

    def drive(self, runs: Sequence[PlannedRun], watch: Stopwatch, progress: Progress | None) -> list[RunLog]:
        """Drive runs as one fleet."""
        worlds = [run.world(self.threads or (1 if progress is None else 0)) for run in runs]
        cells = [run.cell for run in runs]
        return drive_cells(cells, worlds, progress or (lambda seconds: None), watch, runs[0].setting.kept)

    def measure(self, run: PlannedRun, log: RunLog) -> Row:
        """Speeds, slips and errors of a run; no slips where it gives none, and a note why."""
        geometry = run.world(1).robot.geometry
        try:
            sampling = usable_samples([log], geometry, method=run.setting.config.motion, longest=True)
            sample, truth = sampling.samples, true_samples([log], geometry)
            numbers = np.concatenate([sample.omega[0], sample.twist[0], sample.slip[0], truth.slip[0], sample.radius])
            row = dict(zip(_SAMPLED, numbers.tolist(), strict=True)) | {"note": "; ".join(sampling.notes) or None}
        except LogError as error:
            note = f"run {run.name!r} left out: {str(error).removeprefix(f'run {run.name!r}: ')}"
            row = dict.fromkeys(_SAMPLED) | {"note": note}
        saturated = None if log.truth is None else log.truth.saturated
        share = 0.0 if saturated is None else float(saturated.mean(axis=0).max())
        return row | vars(PoseAccuracy.of([log])) | {"saturated": share}
