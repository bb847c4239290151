"""What ground that shears costs a fleet, for every number of robots and threads."""

from __future__ import annotations

from collections.abc import Callable

from experiments.options.bench import BenchConfig
from experiments.validation.shear.cost import ShearCost, cost
from sim.robot.robot import Robot

_TURNS = 4  # in a round


def measure_shear(config: BenchConfig, robot: Robot, step: Callable[[str], None]) -> list[ShearCost]:
    """Every number of robots and threads; `step` is called with a label after each."""
    found = []
    for size in config.shear_sizes:
        for threads in config.thread_counts:
            found.append(cost(robot, size, threads, config.seconds, _TURNS * config.repeats))
            step(f"{size} robots" if size > 1 else "1 robot")
    return found
