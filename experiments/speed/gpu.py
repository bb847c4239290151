"""Physics steps per second on a GPU, what a fleet leaves of them, and how far robots end from the processor's.

In every round the engine of the processor, on all its threads, MuJoCo Warp alone and a fleet on MuJoCo Warp take turns.
Rates and ratios are medians over the rounds, of wall-clock time; the first round is a warm-up and does not count.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.measuring.check import Check
from experiments.options.bench import BenchConfig
from experiments.speed.simulator import timed
from sim.fleet import Fleet
from sim.robot.robot import Robot
from sim.scanner.scanner import LaserScanner
from sim.warp.devices import CPU, GPU, make_batch
from trackslip import paper
from trackslip.kinematics import sprocket_speeds
from trackslip.slip.law_file import load_laws

_TWIST = 0.2, 0.2  # that the robots drive [m/s], [rad/s]
_STEADY = 2.0  # time after which the sprockets turn at their set points [s]
MOST_APART = 1e-3
"""Largest distance at the end of the paper's runs [m]."""
_DURATION = 30.0  # of those runs [s]
_CALLS = 10  # of a fleet in a turn, one per scan period
_MOST_ON_PROCESSOR = 1024  # robots; its speed doesn't depend on their number


@dataclass(frozen=True)
class GpuSpeed:
    """Speed of N robots."""

    n: int
    """Number of robots."""
    processor_steps_per_s: float
    """Physics steps per second of MuJoCo on all threads of the processor, all robots together [1/s]."""
    warp_steps_per_s: float
    """The same of MuJoCo Warp alone, in one call [1/s]."""
    fleet_steps_per_s: float
    """The same of a fleet on MuJoCo Warp that stops for every scan [1/s]."""
    ratio_to_processor: float
    """Speed of the fleet over that of the processor [-]."""
    real_time_factor: float
    """Simulated robot-seconds per second of the fleet [-]."""


def measure_gpu(
    sizes: Sequence[int], config: BenchConfig, robot: Robot, step: Callable[[str], None], device: str = GPU
) -> list[GpuSpeed]:
    """Measure every number of robots on a `device` of MuJoCo Warp; `step` is called with a label after each round."""
    timestep = robot.model.opt.timestep
    period = LaserScanner().period
    steps = _CALLS * round(period / timestep)
    omega = load_laws()["icr_radius"].sprocket_speeds(_TWIST, robot.geometry)
    speeds = []
    for size in sizes:
        fleet = Fleet(robot, np.zeros((size, 3)), device=device)
        fleet.command(omega)
        fleet.advance(_STEADY)
        alone = _copy(fleet, size, device)
        processor = _copy(fleet, min(size, _MOST_ON_PROCESSOR), CPU)
        rates = []
        for k in range(1 + config.repeats):  # the first warms up
            seconds = [timed(one.step, None, steps) for one in (processor, alone)]
            seconds.append(sum(timed(fleet.advance, period) for _ in range(_CALLS)))
            if k > 0:
                rates.append(np.array([processor.nsim, size, size]) * steps / seconds)
            step(f"{size} robots")
        ratio = float(np.median([rate[2] / rate[0] for rate in rates]))
        processor_rate, warp_rate, fleet_rate = np.median(rates, axis=0).tolist()
        speeds.append(GpuSpeed(size, processor_rate, warp_rate, fleet_rate, ratio, fleet_rate * timestep))
    return speeds


def distance(robot: Robot, device: str = GPU) -> Check:
    """How far the robots of the paper's runs, driven on `device`, end from where those on the processor do."""
    twist = np.array([(v, v / r) for v in paper.SPEEDS for r in paper.COMMANDED_RADII])
    fleets = [Fleet(robot, np.zeros((len(twist), 3)), device=one) for one in (CPU, device)]
    for fleet in fleets:
        fleet.command(sprocket_speeds(twist, 0.0, robot.geometry))
        for _ in range(round(_DURATION)):
            fleet.advance(1.0)
    on_cpu, on_device = (fleet.pose()[:, :2] for fleet in fleets)
    largest = float(np.hypot(*(on_device - on_cpu).T).max())
    return Check(f"{len(twist)} runs of {_DURATION:g} s", "distance from the processor's", largest, MOST_APART, "m")


def _copy(fleet: Fleet, size: int, device: str):  # type: ignore[no-untyped-def]  # MuJoCo has no type hints
    """The first robots of a fleet in its present state, their belts at its present speeds, without the fleet."""
    copy = make_batch(fleet.robot.model, size, device=device)
    for name in ("geom_surfacevel", "pair_friction"):
        copy.expand(name)[:] = fleet.batch.expand(name)[:size]
    copy.state[:] = fleet.batch.state[:size]
    return copy
