"""Disturbances of scanner, mounting and field, and the errors of slip and localization under each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import degrees
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.common.formats import number
from experiments.common.options import with_option
from experiments.common.table import Table
from experiments.simulate.grid_options import GridConfig
from experiments.simulate.grid_runs import cells_of, drive_cells, drive_grid
from experiments.simulate.grid_summary import LocalizationErrors
from experiments.simulate.world import Specification, World
from experiments.studies.trials import Study, Trial, TrialOutcome, run_trials
from sim.scanner.scanner import MIRROR_PERIOD
from trackslip.errors import LogError
from trackslip.identification.samples import true_samples, usable_samples
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog

if TYPE_CHECKING:
    from experiments.common.run import Run
    from experiments.sensitivity import Config

_OF_SLIP = ("", "outer bias", "std", "largest", "inner bias", "std", "largest")
_HEADER = (*_OF_SLIP, "x [mm]", "y [mm]", "phi [deg]", "valid", "runs")


@dataclass(frozen=True)
class Disturbance:
    """A departure from the nominal experiment."""

    name: str
    options: Mapping[str, float | str] = field(default_factory=dict)
    """Changed options of the grid, such as scanner.noise."""
    plate_left: float = 0.0
    """Offset of the plate to the left of the robot's axis, unknown to the evaluation [m]."""
    clock: float = 0.0
    """Relative error of the scanner's clock against the encoders' [-]."""

    @property
    def settings(self) -> dict[str, float | str]:
        """Differences from the nominal experiment."""
        changed = {name.removeprefix("scanner."): value for name, value in self.options.items()}
        unknown = {"plate_left": self.plate_left, "clock": self.clock}
        return changed | {name: value for name, value in unknown.items() if value}

    def driven(self, config: GridConfig) -> GridConfig:
        """The grid to drive; equal to `config` where only the evaluation is disturbed."""
        for name, value in self.options.items():
            config = with_option(config, name, value)
        return config

    def evaluated(self, log: RunLog) -> RunLog:
        """The run as measured with this plate and this clock; the truth stays."""
        phi = log.pose[:, 2]
        shift = self.plate_left * np.column_stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)])
        # ranges do not tell where the robot is under its plate: with an offset plate, evaluate the poses
        scans = None if self.plate_left else log.scans
        return replace(log, time=log.time * (1 + self.clock), pose=log.pose + shift, scans=scans)


DISTURBANCES = (
    Disturbance("nominal"),
    Disturbance("noise 10 mm", {"scanner.noise": 0.01}),
    Disturbance("quantised to 1 cm", {"scanner.quantisation": 0.01}),
    Disturbance("range bias 10 mm", {"scanner.range_bias": 0.01}),
    Disturbance("mixed pixels, 4.4 mrad", {"scanner.divergence": 0.0044}),
    Disturbance(f"sweep of {MIRROR_PERIOD * 1e3:.1f} ms", {"scanner.scan_duration": MIRROR_PERIOD}),
    Disturbance("dropouts 20 %", {"scanner.dropout": 0.2}),
    Disturbance("posts around", {"obstacles": "posts"}),
    Disturbance("post in front", {"obstacles": "occluded"}),
    Disturbance("walls around", {"obstacles": "room"}),
    Disturbance("person in front", {"obstacles": "walker"}),
    Disturbance("plate 1 mm off the axis", plate_left=0.001),
    Disturbance("clock 0.1 % fast", clock=0.001),
)


def sensitivity(config: Config, run: Run) -> Study:
    """Drive and evaluate the grid under each disturbance, with the same random numbers."""
    trials = [Trial(disturbance.name, given=disturbance) for disturbance in DISTURBANCES]
    outcomes = run_trials(run, partial(disturbed, config=config), trials, "{case}", Specification.of(config))
    return sensitivity_study(DISTURBANCES, [outcome for (outcome,) in outcomes.values()])


def sensitivity_study(disturbances: Sequence[Disturbance], outcomes: Sequence[TrialOutcome]) -> Study:
    """A row of summary.json and a line of the table per disturbance and its outcome, as from `disturbed`."""
    rows = [
        {"effect": one.name, "settings": one.settings, **outcome.numbers, "warnings": list(outcome.notes)}
        for one, outcome in zip(disturbances, outcomes, strict=True)
    ]
    table = Table("Errors of slip over the runs, and of the poses (rms)", _HEADER, [_line(row) for row in rows])
    warnings = [f"warning: {row['effect']}: {row['warnings'][-1]}" for row in rows if row["slip_error"] is None]
    return Study({"rows": rows}, [table, *warnings])


def _line(row: Mapping[str, Any]) -> tuple[str, ...]:
    cells = []
    for track in ("outer", "inner"):
        errors = (row["slip_error"] or {}).get(track, dict.fromkeys(("bias", "std", "largest")))
        bias = number(errors["bias"], 5)
        cells += [bias if not errors["bias"] or errors["bias"] < 0 else f"+{bias}"]
        cells += [number(errors[name], 5) for name in ("std", "largest")]
    poses, runs = row["localization"], row["runs"]
    cells += [number(1e3 * poses[name], 1) for name in ("rmse_x", "rmse_y")]
    cells += [number(degrees(poses["rmse_heading"]), 2), f"{poses['valid_fraction']:.1%}"]
    return row["effect"], *cells, f"{runs['used']}/{runs['all']}"


def disturbed(trial: Trial, _: np.random.Generator, config: Config) -> TrialOutcome:
    """Drive a grid of left turns with a disturbance and evaluate it, by default with the most exact motion method.

    `slip_error` has bias, std and largest error [-] of the outer and the inner track over the runs, None if no run
    could be used; `localization` is of all runs, as LocalizationErrors; `runs` are those used and all.
    """
    disturbance: Disturbance = trial.given
    grid = replace(disturbance.driven(config), threads=1)
    world = World.of(grid)
    logs = [disturbance.evaluated(log) for log in drive_grid(grid, world)]
    slip, warnings = slip_errors(logs, world.robot.geometry, config.motion)
    error = (
        {"bias": slip.mean(axis=0), "std": slip.std(axis=0), "largest": np.abs(slip).max(axis=0)} if len(slip) else {}
    )
    tracks = {
        track: {name: float(both[k]) for name, both in error.items()} for k, track in ((1, "outer"), (0, "inner"))
    }
    numbers = {
        "slip_error": tracks if len(slip) else None,
        "localization": vars(LocalizationErrors.of(logs)),
        "runs": {"used": len(slip), "all": len(logs)},
    }
    return TrialOutcome(numbers=numbers, notes=warnings)


def examples(config: Config) -> list[RunLog]:
    """The first run of the grid under each disturbance."""
    logs = []
    for disturbance in DISTURBANCES:
        grid = disturbance.driven(config)
        (log,) = drive_cells(cells_of(grid)[:1], [World.of(grid)])
        logs.append(replace(disturbance.evaluated(log), run=f"{disturbance.name}, {log.run}"))
    return logs


def slip_errors(logs: Sequence[RunLog], geometry: RobotGeometry, motion: str | None) -> tuple[Array, tuple[str, ...]]:
    """Errors (n, 2) [-] of slip in the n runs that can be used, left track first; and why the others cannot."""
    try:
        sampling = usable_samples(logs, geometry, method=motion, longest=True)
    except LogError as error:
        return np.empty((0, 2)), (str(error),)
    truth = true_samples([log for log in logs if log.run in sampling.samples.run], geometry)
    return sampling.samples.slip - truth.slip, (*sampling.notes, *map(str, sampling.refused))
