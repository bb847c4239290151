"""The cost of the learning environments, compared with the bare engine in the same motion.

Robots follow their references; a line of arithmetic turns observations into actions. A turn of the bare engine repeats
what the vector environment did in the turn before: same robots, same start, same belt speeds in every control period.
The single environments, in gymnasium's SyncVectorEnv, drive the same way.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from experiments.options.bench import BenchConfig
from experiments.speed.simulator import BARE, CaseSpeed, Rates, bare_batch, case_speeds, timed
from sim.env import PathTrackingVectorEnv
from sim.path_tracking.config import PERIOD
from trackslip.kinematics import Array

VECTOR, _, SINGLE = ENV_CASES = ("vector env", BARE, "SyncVectorEnv")
ENV = "sim:trackslip/PathTracking-v0"
OPTIONS: dict[str, Any] = {
    "reference": ("circle", "figure_eight", "slalom", "spiral"),
    "action": "twist",
    "compensation": "icr_radius",
}
_BACK = np.array([0.5, 1.0, 1.0])  # gains from the observed errors to the twist
_SINGLE_SHARE = 0.25  # of the control periods: single environments take so much longer
_UNDER_WAY = 40  # control periods after which all robots drive


@dataclass(frozen=True)
class EnvSpeed(CaseSpeed):
    """Speed of the environments."""

    ratio_to_single: float
    """Speed over that of single environments [-]."""


class EnvRig:
    """N robots under way, in the vector environment and in single ones, and the bare engine."""

    def __init__(self, size: int, threads: int, seed: int) -> None:
        """`size` robots on `threads` worker threads."""
        self.size = size
        self._native = PathTrackingVectorEnv(size, threads=threads, **OPTIONS)
        self._singles = gymnasium.make_vec(ENV, num_envs=size, vectorization_mode="sync", **OPTIONS)
        self._seen = {VECTOR: self._native.reset(seed=seed)[0], SINGLE: self._singles.reset(seed=seed)[0]}
        fleet = self._native.task.fleet
        self._fleet = fleet
        self._bare = bare_batch(fleet)
        self._surface = self._bare.expand("geom_surfacevel")[:, fleet.robot.pads, 2]  # live
        self.steps_per_period = round(PERIOD / fleet.robot.model.opt.timestep)
        self.drive(VECTOR, _UNDER_WAY)
        self.drive(SINGLE, _UNDER_WAY)
        self._record(1)

    def rates(self, periods: int) -> dict[str, float]:
        """Physics steps per second, all robots together, of every case in one turn."""
        few = max(1, math.ceil(_SINGLE_SHARE * periods))
        taken = {
            VECTOR: (periods, self._record(periods)),
            BARE: (periods, timed(self._repeat)),
            SINGLE: (few, timed(self.drive, SINGLE, few)),
        }
        return {case: self.size * n * self.steps_per_period / seconds for case, (n, seconds) in taken.items()}

    def drive(self, case: str, periods: int) -> None:
        """Let the robots of an environment follow their references."""
        env = self._native if case == VECTOR else self._singles
        for _ in range(periods):
            self._seen[case] = env.step(followed(self._seen[case]))[0]

    def _record(self, periods: int) -> float:
        """Drive in the vector environment and record the belt speeds; the time that driving took [s]."""
        self._bare.state[:] = self._fleet.batch.state
        self._belts: list[Array] = []
        seconds = 0.0
        for _ in range(periods):
            seconds += timed(self.drive, VECTOR, 1)
            self._belts.append(self._fleet.belts.copy())
        return seconds

    def _repeat(self) -> None:
        """Repeat the recorded motion in the bare engine."""
        for belts in self._belts:
            self._surface[:] = belts
            self._bare.step(nstep=self.steps_per_period)


def followed(seen: Array) -> NDArray[np.float32]:
    """Actions (N, 2) by which robots that observe `seen` (N, n) follow their references."""
    twist = seen[:, 3:5] + np.stack([_BACK[0] * seen[:, 0], seen[:, 1:3] @ _BACK[1:]], axis=1)
    return np.clip(twist, -1, 1).astype(np.float32)


def measure_env(config: BenchConfig, step: Callable[[str], None]) -> Rates:
    """Rates (R,) of every case and number of threads in R rounds after a warm-up; each calls `step` with a label."""
    size = config.env_size
    rates: dict[tuple[str, int, int], list[float]] = {}
    periods = max(2, math.ceil(config.seconds / (size * PERIOD) - 1e-9))
    rigs = {threads: EnvRig(size, threads, config.seed) for threads in config.thread_counts}
    for k in range(1 + config.repeats):
        for threads, rig in rigs.items():
            for case, rate in rig.rates(periods).items():
                if k > 0:
                    rates.setdefault((case, size, threads), []).append(rate)
        step(f"{size} robots")
    return {key: np.array(measured) for key, measured in rates.items()}


def env_speeds(rates: Rates, timestep: float) -> list[EnvSpeed]:
    """One for each case; a physics step is `timestep` [s] long. Ratios are medians over those of the rounds."""
    return [
        EnvSpeed(**vars(one), ratio_to_single=float(np.median(rate / rates[SINGLE, one.n, one.threads])))
        for one, rate in zip(case_speeds(rates, timestep), rates.values(), strict=True)
    ]
