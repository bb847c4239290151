"""A fleet whose runs are written to a Parquet file while they last: how long that takes, and how much memory."""

import math
import tempfile
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from experiments.options.grid import RunsConfig
from experiments.speed.memory import peak_memory
from sim.fleet import Fleet
from sim.robot.robot import load_robot
from sim.runs import PERIOD, open_loop_parts
from sim.seeds import generator
from trackslip.kinematics import Array, sprocket_speeds
from trackslip.logs.run_writer import RunWriter

_PERIODS = 12  # after which all robots drive steadily


@dataclass(frozen=True)
class ScaleCase:
    """What runs of some robots cost, once these have been set down and drive."""

    robots: int
    duration: float
    """Of each run [s]."""
    seconds: float
    """Wall time of driving and writing the runs [s]."""
    memory: float
    """Peak memory of a process that does nothing else [MB]; NaN where the system doesn't tell."""
    memory_halfway: float
    """The same when up to half of the work was done; NaN if none had been recorded by then [MB]."""
    file_size: float
    """Of the Parquet file [MB]."""

    @property
    def per_robot_second(self) -> float:
        """Wall time per robot and simulated second [s]."""
        return self.seconds / (self.robots * self.duration)


def drive_case(robots: int, duration: float, times: int, seed: int) -> Generator[float, None, ScaleCase]:
    """Drive robots for `duration` [s] at constant speeds, so many times, on as many threads as there are processors.

    Yields the share of the work that is done after each part of a run; the time until it goes on doesn't count.
    """
    fleet = Fleet(load_robot(), np.zeros((robots, 3)))
    omega = _speeds(fleet, seed)
    for _ in range(_PERIODS):
        fleet.command(omega)
        fleet.advance(PERIOD)
    yield 0.0
    seconds, share, halfway = 0.0, 0.0, math.nan
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "runs.parquet"
        began = perf_counter()
        for _ in range(times):
            with RunWriter(file) as writer:
                for logs in open_loop_parts(fleet, omega, duration):
                    writer.write(logs)
                    seconds += perf_counter() - began
                    share += PERIOD * len(logs[0].time) / (times * (duration + PERIOD))  # both ends are recorded
                    if share <= 0.5:
                        halfway = _memory()
                    yield share
                    began = perf_counter()
        seconds += perf_counter() - began
        size = file.stat().st_size / 1e6
    return ScaleCase(robots, duration, seconds / times, _memory(), halfway, size)


def _memory() -> float:
    memory = peak_memory()
    return math.nan if memory is None else memory


def _speeds(fleet: Fleet, seed: int) -> Array:
    """Sprocket speeds (N, 2) of left turns with random radii and speeds in the range of the paper's [rad/s]."""
    paper, random = RunsConfig(), generator(seed, "scale")
    radius = random.uniform(min(paper.radii), max(paper.radii), fleet.size)
    speed = random.uniform(min(paper.speeds), max(paper.speeds), fleet.size)
    return sprocket_speeds(np.column_stack([speed, speed / radius]), 0.0, fleet.robot.geometry)
