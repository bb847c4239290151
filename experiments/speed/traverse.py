"""The cost of trackslip/Traverse-v0, compared with the bare engine in the same motion.

Robots cross random courses under the scripted controller. A turn of the bare engine begins where a turn of the vector
environment began, and runs with the belts and flippers that it had at the end of each control period.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from mujoco import batch

from experiments.options.bench import BenchConfig
from experiments.speed.simulator import BARE, CaseSpeed, Rates, case_speeds, timed
from sim.traverse.env import TraverseVectorEnv
from trackslip.kinematics import Array

VECTOR = "vector env"
_UNDER_WAY = 15  # control periods after which all robots drive


class TraverseRig:
    """N robots on their courses, in the vector environment and in the bare engine."""

    def __init__(self, size: int, threads: int, seed: int) -> None:
        """`size` robots on `threads` worker threads."""
        self.size = size
        self._env = TraverseVectorEnv(size, threads=threads, action="correction")
        self._env.reset(seed=seed)
        self._still = np.zeros(self._env.action_space.shape or (), np.float32)
        world = self._env.task.world
        self._batch = world.batch
        self.timestep = float(world.tracked.model.opt.timestep)
        self.steps_per_period = round(world.period / self.timestep)
        self._bare = batch.Batch(world.tracked.model, size, nthread=self._batch.nthread)
        self._drive(_UNDER_WAY)

    def rates(self, periods: int) -> dict[str, float]:
        """Physics steps per second, all robots together, of both cases in one turn."""
        self._begin()
        motion: list[tuple[Array, Array]] = []
        seconds = 0.0
        for _ in range(periods):
            seconds += timed(self._drive, 1)
            motion.append((self._batch.expand("geom_surfacevel").copy(), self._batch.ctrl.copy()))
        steps = self.size * periods * self.steps_per_period
        return {VECTOR: steps / seconds, BARE: steps / timed(self._repeat, motion)}

    def _drive(self, periods: int) -> None:
        for _ in range(periods):
            self._env.step(self._still)

    def _begin(self) -> None:
        """Put the bare engine's robots where those of the environment are, on the same courses."""
        for name in batch.MODEL_FIELDS:
            if self._batch.expanded(name) is not None:
                self._bare.expand(name)[:] = self._batch.expand(name)
        self._bare.state[:] = self._batch.state

    def _repeat(self, motion: list[tuple[Array, Array]]) -> None:
        surface = self._bare.expand("geom_surfacevel")
        for belts, motors in motion:
            surface[:], self._bare.ctrl[:] = belts, motors
            self._bare.step(nstep=self.steps_per_period)


def measure_traverse(config: BenchConfig, step: Callable[[str], None]) -> list[CaseSpeed]:
    """Speed of the environment and of the bare engine for each number of threads; calls `step` after every round."""
    size = config.env_size
    rates: dict[tuple[str, int, int], list[float]] = {}
    rigs = {threads: TraverseRig(size, threads, config.seed) for threads in config.thread_counts}
    rig = next(iter(rigs.values()))
    periods = max(2, math.ceil(config.seconds / (size * rig.steps_per_period * rig.timestep) - 1e-9))
    for k in range(1 + config.repeats):  # the first warms up
        for threads, one in rigs.items():
            for case, rate in one.rates(periods).items():
                if k > 0:
                    rates.setdefault((case, size, threads), []).append(rate)
        step(f"{size} robots")
    measured: Rates = {key: np.array(each) for key, each in rates.items()}
    return [replace(one, case=f"Traverse-v0, {one.case}") for one in case_speeds(measured, rig.timestep)]
