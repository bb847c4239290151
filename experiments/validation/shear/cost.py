"""What ground that shears costs: processor time of a fleet on it, over that of a fleet on Coulomb ground, in turns."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter, process_time

import numpy as np

from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.robot import Robot

FEWEST = 32
"""Number of robots from which on the cost is bounded."""
MOST = 1.5
"""Largest ratio of processor times, on one thread [-]."""
_MODULUS = 0.01  # [m]
_STEADY = 2.0  # time after which the belts run steadily [s]
_PERIOD = 0.05  # time between two scans [s]


@dataclass(frozen=True)
class ShearCost:
    """Speed of a number of robots on a number of threads."""

    n: int
    """Number of robots."""
    threads: int
    coulomb_steps_per_s: float
    """Physics steps per second, all robots together, on Coulomb ground [1/s]."""
    shear_steps_per_s: float
    """The same on ground that shears [1/s]."""
    cost_ratio: float
    """Median of the ratios of processor time on both, measured one right after the other [-]."""


def cost(robot: Robot, size: int, threads: int, seconds: float, turns: int) -> ShearCost:
    """Let fleets drive in turns, `seconds` of all robots together in each, after one that warms up [s]."""
    fleets = [Fleet(robot, np.zeros((size, 3)), Ground(shear=shear), threads=threads) for shear in (0.0, _MODULUS)]
    for fleet in fleets:
        fleet.command([2.0, 3.0])
        fleet.advance(_STEADY)
    periods = max(1, round(seconds / (size * _PERIOD)))
    times = np.array([[_times(fleet, periods) for fleet in fleets] for _ in range(1 + turns)])[1:]
    passed, worked = np.moveaxis(times, -1, 0)  # (turns, 2) each
    steps = size * periods * _PERIOD / robot.model.opt.timestep
    coulomb, shear = np.median(steps / passed, axis=0)
    return ShearCost(size, threads, float(coulomb), float(shear), float(np.median(worked[:, 1] / worked[:, 0])))


def _times(fleet: Fleet, periods: int) -> tuple[float, float]:
    """Time that passes and time of all processors, of a number of periods [s]."""
    began, worked = perf_counter(), process_time()
    for _ in range(periods):
        fleet.advance(_PERIOD)
    return perf_counter() - began, process_time() - worked
