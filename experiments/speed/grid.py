"""The cost of a large grid of runs, on one process and on several, compared with the bare engine.

The grid is the paper's 25 runs at many ratios of friction. The bare engine steps as many robots, on the same ground and
with the same belt speeds, for as many steps, those for setting the robots down included, in one call and on as many
threads as the grid has processes. It runs before and after each grid; the mean is what the grid is compared with.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Self

import numpy as np

from experiments.driving.grid_runs import before_scanner
from experiments.options.bench import BenchConfig
from experiments.options.grid import SweepConfig
from experiments.speed.simulator import bare_batch
from experiments.sweep.plan import Run, plan
from experiments.sweep.summary import Timing
from sim.fleet import SETTLING, Fleet
from trackslip.kinematics import sprocket_speeds

SENSING = ("scans", "localization", "slips")
"""Stages without a counterpart in the bare engine: scanning, and finding pose and slip in scans."""
_PER_RATIO = 25
_MAX_BARE_ROBOTS = 256  # bare robots at once; of more runs, a sample
_START = 1.0  # after which the sprockets turn at their set points [s]


@dataclass(frozen=True)
class GridSpeed:
    """Speed of a grid."""

    processes: int
    runs: int
    wall_s: float
    """Wall-clock time of the whole command [s]."""
    stages: Mapping[str, float]
    """Work by stage, all processes together [s]."""
    bare_s: float
    """Time that the bare engine takes for the same physics [s]."""
    ratio_to_bare: float
    """Time of the grid without SENSING, over that of the bare engine [-]."""

    @classmethod
    def of(cls, processes: int, runs: int, timing: Timing, bare_s: float) -> Self:
        """From the timing of a grid and the time of the bare engine [s]."""
        rest = timing.wall_s - sum(timing.stages.get(name, 0.0) for name in SENSING) / processes
        return cls(processes, runs, timing.wall_s, dict(timing.stages), bare_s, rest / bare_s)


def measure_grid(
    config: BenchConfig, drive: Callable[[SweepConfig], Timing], step: Callable[[str], None]
) -> list[GridSpeed]:
    """One for each number of processes; `drive` drives and stores a grid, `step` is called with a label after each."""
    ratios = tuple(float(r) for r in np.linspace(0.8, 1.4, max(1, round(config.grid_runs / _PER_RATIO))))
    speeds = []
    for jobs in config.thread_counts:
        sweep = SweepConfig(
            friction_ratio=ratios, seed=config.seed, jobs=jobs, threads=1, duration=config.grid_duration
        )
        runs = plan(sweep)
        before = bare_seconds(runs, jobs)
        timing = drive(sweep)
        step(f"{jobs} processes")
        speeds.append(GridSpeed.of(jobs, len(runs), timing, (before + bare_seconds(runs, jobs)) / 2))
    return speeds


def bare_seconds(runs: list[Run], threads: int) -> float:
    """Time that the bare engine takes for all physics steps of the runs, on worker threads [s]."""
    count = min(len(runs), _MAX_BARE_ROBOTS)
    some = [runs[k] for k in np.unique(np.linspace(0, len(runs) - 1, count).round().astype(int))]
    world = some[0].world(threads)
    start = np.tile(before_scanner(world.robot), (len(some), 1))
    fleet = Fleet(
        world.robot, start, [run.setting.specification.ground for run in some], world.radius_error, threads=threads
    )
    twist = [(run.axes["speed"], run.axes["speed"] / run.axes["radius"]) for run in some]
    fleet.command(sprocket_speeds(np.array(twist), 0.0, world.robot.geometry))
    fleet.advance(_START)
    bare = bare_batch(fleet)
    began = perf_counter()
    bare.step(nstep=round((SETTLING + some[0].setting.config.duration) / world.robot.model.opt.timestep))
    return (perf_counter() - began) * len(runs) / len(some)
