"""Physics steps per second of robots with tracks on level ground, on ten steps and on rough ground.

Robots are spread over the way that one of them has driven, so that they all are on the terrain. A turn starts from
these states: either the engine alone makes all its steps in one call, or belts are set and tracks read in every control
period. Turns of both alternate, see `experiments.speed.simulator`.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mujoco import batch

from experiments.options.bench import BenchConfig
from experiments.speed.simulator import BARE, timed
from sim.robot.tracked import load_tracked
from sim.robot.tracked_model import build_tracked
from sim.terrain import Course, Flat, Rough, Stairs
from sim.tracks import PRESETS, bind

TRACKS = "tracks"
TERRAINS = {
    "flat": Course((Flat(4.0),)),
    "ten steps": Course((Stairs(rise=0.15, run=0.28, number=10),)),
    "rough": Course((Rough(4.0, amplitude=0.1),)),
}
"""Terrain by name."""
CONDITIONS = len(PRESETS) * len(TERRAINS)
"""Number of combinations of a preset and a terrain."""

_FRICTION = (1.0, 1.0)
_SPEED = 0.3  # of the belts [m/s]
_PERIOD = 0.02  # of control [s]
_UNDER_WAY = (5.0, 12.0)  # while the robots are on the terrain [s]
_HEIGHT = 0.02  # of the robot's lowest point at its start [m]
_LIFTED = 0.5  # angle of the front flippers [rad]
_SHARE = 0.25  # of the simulated time: there are so many cases
_FEWEST = 2  # control periods of a turn


@dataclass(frozen=True)
class TerrainSpeed:
    """Speed on a terrain."""

    preset: str
    terrain: str
    case: str
    n: int
    """Number of robots."""
    threads: int
    steps_per_s: float
    """Physics steps per second, all robots together [1/s]."""
    ratio_to_bare: float
    """Speed over that of the bare engine [-]."""
    real_time_factor: float
    """Simulated robot-seconds per second [-]."""


class TerrainRig:
    """N robots on their way over a terrain."""

    def __init__(self, robot: str, preset: str, terrain: str, size: int, threads: int) -> None:
        """`size` robots of a name or file on `threads` worker threads."""
        course, shape = TERRAINS[terrain], load_tracked(robot)
        built = build_tracked(shape, course, preset=preset, friction=_FRICTION)
        belts = bind(built.model, *built.tracks)
        self.size, self.timestep = size, float(built.model.opt.timestep)
        self._substeps = round(_PERIOD / self.timestep)
        self._speeds = np.full((size, len(belts.names)), _SPEED)
        self.batch = batch.Batch(built.model, size, nthread=threads)
        self.belts = belts.bind_batch(self.batch)
        self.belts.set(self._speeds)
        x, y, z, _ = course.start
        place, _ = built.free
        self.batch.qpos[:, place : place + 3] = x, y, z - shape.lowest + _HEIGHT
        angles = np.where(built.flipper_front, _LIFTED, 0.0)
        self.batch.ctrl[:, built.flipper_motor] = built.flipper_control(angles)
        times = np.linspace(*_UNDER_WAY, size)
        steps = np.round(times / self.timestep).astype(int)
        began = 0
        for k, step in enumerate(steps.tolist()):  # robot k drives on alone where robot k - 1 has stopped
            self.batch.step(ids=[k], nstep=step - began)
            if k + 1 < size:
                self.batch.state[k + 1] = self.batch.state[k]
            began = step
        self.start = self.batch.state.copy()

    def rate(self, case: str, seconds: float) -> float:
        """Physics steps per second, all robots together, over `seconds` of all of them together [s]."""
        periods = max(_FEWEST, math.ceil(seconds / (self.size * _PERIOD) - 1e-9))
        self.batch.state[:] = self.start
        steps = periods * self._substeps
        taken = timed(self._drive, periods) if case == TRACKS else timed(self.batch.step, None, steps)
        return self.size * steps / taken

    def _drive(self, periods: int) -> None:
        for _ in range(periods):
            self.belts.set(self._speeds)
            self.batch.step(nstep=self._substeps)
            self.belts.read()


def measure_terrain(config: BenchConfig, step: Callable[[str], None]) -> list[TerrainSpeed]:
    """Every preset, terrain, number of robots and threads in rounds; `step` is called with a label after each."""
    speeds = []
    for preset, terrain in itertools.product(PRESETS, TERRAINS):
        for size, threads in itertools.product(config.terrain_sizes, config.thread_counts):
            rig = TerrainRig(config.terrain_robot, preset, terrain, size, threads)
            rates = _rates(rig, config)
            for case, rate in rates.items():
                per_s, ratio = float(np.median(rate)), float(np.median(np.divide(rate, rates[BARE])))
                speeds.append(TerrainSpeed(preset, terrain, case, size, threads, per_s, ratio, per_s * rig.timestep))
        step(f"{preset}, {terrain}")
    return speeds


def _rates(rig: TerrainRig, config: BenchConfig) -> dict[str, list[float]]:
    rates: dict[str, list[float]] = {BARE: [], TRACKS: []}
    for k in range(1 + config.repeats):  # the first warms up
        for case in rates if k % 2 else reversed(rates):
            rate = rig.rate(case, _SHARE * config.seconds)
            if k > 0:
                rates[case].append(rate)
    return rates
