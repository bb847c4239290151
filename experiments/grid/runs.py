"""How a worker drives and measures the runs of a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from experiments.common.sweep import Row
from experiments.grid.drawbar import soil_columns
from experiments.grid.plan import PlannedRun
from experiments.simulate.grid_runs import drive_cells
from experiments.simulate.grid_summary import LocalizationErrors, saturation_of, soil_warnings
from sim.runs.loop import Progress
from sim.runs.stopwatch import Stopwatch
from trackslip.errors import LogError
from trackslip.identification.samples import true_samples, usable_samples
from trackslip.logs.runlog import RunLog

_SAMPLED: Final = (
    "omega_l",
    "omega_r",
    "v",
    "w",
    "slip_l",
    "slip_r",
    "true_slip_l",
    "true_slip_r",
    "observed_radius",
)
_POSES: Final = ("rmse_x", "rmse_y", "rmse_heading", "valid_fraction")


@dataclass(frozen=True)
class GridRuns:
    """Runs with constant commands in front of the scanner."""

    threads: int
    """Threads per fleet; 0 means one thread per processor, or a single thread in a worker
    process.
    """
    sizes: ClassVar[tuple[int, int]] = (64, 128)
    """Fleet sizes: smaller fleets are slow; larger fleets are hardly faster, and lose more when a
    worker is stopped.
    """

    def drive(
        self, runs: Sequence[PlannedRun], watch: Stopwatch, progress: Progress | None
    ) -> list[RunLog]:
        """Drive runs as one fleet."""
        threads = self.threads or (1 if progress is None else 0)
        worlds = [run.world(threads) for run in runs]
        cells = [run.cell for run in runs]
        return drive_cells(
            cells, worlds, progress or (lambda seconds: None), watch, runs[0].setting.config.bag
        )

    def measure(self, run: PlannedRun, log: RunLog) -> Row:
        """Speeds, slips and errors of a run, by column; for a run without usable slips, a note on
        the reason.
        """
        geometry = run.world(1).robot.geometry
        try:
            sampling = usable_samples(
                [log], geometry, method=run.setting.config.motion, longest=True
            )
            sample = sampling.samples
            truth = true_samples([log], geometry)
            numbers = np.concatenate(
                [sample.omega[0], sample.twist[0], sample.slip[0], truth.slip[0], sample.radius]
            )
            row: Row = dict(zip(_SAMPLED, numbers.tolist(), strict=True))
            row["note"] = "; ".join(sampling.notes) or None
        except LogError as error:
            reason = str(error).removeprefix(f"run {run.name!r}: ")
            row = dict.fromkeys(_SAMPLED)
            row["note"] = f"run {run.name!r} left out: {reason}"
        notes = [] if row["note"] is None else [row["note"]]
        row["note"] = "; ".join([*notes, *soil_warnings([log])]) or None
        errors = LocalizationErrors.of([log])
        row |= {name: getattr(errors, name) for name in _POSES}
        return row | _of_motors(log) | soil_columns(log)


def _of_motors(log: RunLog) -> Row:
    """The columns of the run table on saturated motors."""
    saturation = saturation_of(log)
    if saturation is None:
        return {
            "saturated": 0.0,
            "saturated_motor": None,
            "torque_at_hand": None,
            "torque_needed": None,
        }
    return {
        "saturated": saturation.share,
        "saturated_motor": saturation.motor,
        "torque_at_hand": saturation.torque,
        "torque_needed": saturation.needed,
    }
