"""`trackslip bench --grid`: what a large grid of runs costs, on one process and on several, beside the bare engine.

The grid is the paper's 25 runs at many ratios of friction. The bare engine steps as many robots, on the same ground and
with the same belt speeds, for as many steps in one call, those in which robots are set down included, on as many
threads as the grid has processes; it goes before and after each grid, and what is compared with is the mean.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from experiments.commands import grid as command
from experiments.commands.bench import bare_batch
from experiments.driving.grid_runs import before_scanner
from experiments.options.bench import BenchConfig
from experiments.options.grid import SweepConfig
from experiments.report.terminal import print_table
from experiments.storage.results import SUMMARY_FILE
from experiments.sweep.plan import Run, plan
from sim.fleet import SETTLING, Fleet
from trackslip.kinematics import sprocket_speeds

APART = ("scans", "localization", "slips")
"""Stages that the bare engine has nothing to set against: scanning, and finding pose and slip in scans."""
_PER_RATIO = 25
_MAX_BARE_ROBOTS = 256  # bare robots at once; of more, each is a share
_START = 1.0  # after which the sprockets turn as they were told to [s]


def measure_grid(config: BenchConfig, step: Callable[[str], None]) -> list[dict[str, Any]]:
    """A row for each number of processes."""
    ratios = tuple(float(r) for r in np.linspace(0.8, 1.4, max(1, round(config.grid_runs / _PER_RATIO))))
    rows = []
    for jobs in config.thread_counts:
        sweep = SweepConfig(
            friction_ratio=ratios, seed=config.seed, jobs=jobs, threads=1, duration=config.grid_duration
        )
        runs = plan(sweep)
        before = bare_seconds(runs, jobs)
        grid = _grid(sweep, step)
        bare = (before + bare_seconds(runs, jobs)) / 2
        rows.append(row(jobs, len(runs), grid, bare))
    return rows


def bare_seconds(runs: list[Run], threads: int) -> float:
    """Time that the bare engine takes for all physics steps of the runs, on worker threads [s]."""
    some = [
        runs[k] for k in np.unique(np.linspace(0, len(runs) - 1, min(len(runs), _MAX_BARE_ROBOTS)).round().astype(int))
    ]
    world = some[0].world(threads)
    start = np.tile(before_scanner(world.robot), (len(some), 1))
    fleet = Fleet(world.robot, start, [run.specification.ground for run in some], world.radius_error, threads=threads)
    twist = [(run.axes["speed"], run.axes["speed"] / run.axes["radius"]) for run in some]
    fleet.command(sprocket_speeds(np.array(twist), 0.0, world.robot.geometry))
    fleet.advance(_START)
    bare = bare_batch(fleet)
    began = perf_counter()
    bare.step(nstep=round((SETTLING + some[0].config.duration) / world.robot.model.opt.timestep))
    return (perf_counter() - began) * len(runs) / len(some)


def row(jobs: int, runs: int, grid: Mapping[str, Any], bare: float) -> dict[str, Any]:
    """What is told of a grid; stages are seconds of work, all processes together."""
    rest = grid["wall_s"] - sum(grid["stages"].get(name, 0.0) for name in APART) / jobs
    return {
        "processes": jobs,
        "runs": runs,
        "wall_s": grid["wall_s"],
        "stages": dict(grid["stages"]),
        "bare_s": bare,
        "ratio_to_bare": rest / bare,
    }


def _grid(sweep: SweepConfig, step: Callable[[str], None]) -> dict[str, Any]:
    """Drive a grid into a folder that doesn't last; its timing."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "grid"
        with contextlib.redirect_stdout(io.StringIO()):
            command.run(replace(sweep, out=out))
        step(f"{sweep.jobs} processes")
        timing: dict[str, Any] = json.loads((out / SUMMARY_FILE).read_text(encoding="utf-8"))["timing"]
        return timing


def print_grid_summary(summary: Mapping[str, Any]) -> None:
    """Print the grids, and their stages."""
    rows = summary["rows"]
    one = next((row["wall_s"] for row in rows if row["processes"] == 1), None)
    print_table(
        "Speed of a grid",
        ("processes", "runs", "wall [s]", "times as fast", "bare [s]", "without scans, poses, slips / bare"),
        [
            (
                str(row["processes"]),
                str(row["runs"]),
                f"{row['wall_s']:.1f}",
                "-" if one is None else f"{one / row['wall_s']:.2f}",
                f"{row['bare_s']:.1f}",
                f"{row['ratio_to_bare']:.2f}",
            )
            for row in rows
        ],
    )
    stages = list(dict.fromkeys(name for row in rows for name in row["stages"]))
    print_table(
        "Seconds of work by stage, all processes together",
        ("processes", *stages),
        [(str(row["processes"]), *(f"{row['stages'].get(name, 0.0):.1f}" for name in stages)) for row in rows],
    )
