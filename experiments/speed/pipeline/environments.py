"""What a single environment and the scanner of a single robot cost beside the bare engine."""

from collections.abc import Callable
from time import perf_counter

import gymnasium
import numpy as np

from experiments.measuring.check import Check, at_least
from experiments.speed.environments import ENV, OPTIONS, followed
from experiments.speed.same_motion import SameMotion
from experiments.speed.simulator import BARE, SCANNER, Rig
from sim.path_tracking.config import PERIOD
from sim.robot.robot import load_robot

ENVIRONMENT, SCANNED = "a single environment", "scanner of one robot"
LEAST_SHARE = 0.5
"""Smallest speed over that of the bare engine [-]."""
_PERIODS = 400  # in a round
_UNDER_WAY = 40  # control periods after which the robot drives
_TURN = 20  # scan periods in a turn of the scanner


def measure(seed: int, repeats: int, step: Callable[[str], None]) -> tuple[Check, ...]:
    """Speeds of both on one thread over that of the bare engine; `step` is called with a label after each round.

    Times are wall time; the bare engine takes turns with what is measured, and ratios are medians over all turns.
    """
    environment, rig = _SingleEnvironment(seed), Rig(load_robot(), 1, 1, seed)
    shares: dict[str, list[float]] = {ENVIRONMENT: [], SCANNED: []}
    for k in range(1 + repeats):
        found = {ENVIRONMENT: environment.shares(_PERIODS), SCANNED: _scanner_shares(rig, _PERIODS)}
        if k > 0:  # the first round warms up
            for case, some in found.items():
                shares[case] += some
        step("single robots")
    what = "speed over that of the bare engine"
    return tuple(Check(case, what, float(np.median(some)), at_least(LEAST_SHARE), "x") for case, some in shares.items())


class _SingleEnvironment:
    """A robot that follows its reference in an environment, and the bare engine in the same motion."""

    def __init__(self, seed: int) -> None:
        self._env = gymnasium.make(ENV, **OPTIONS)
        self._seen = self._env.reset(seed=seed)[0]
        fleet = self._env.unwrapped.task.fleet  # type: ignore[attr-defined]
        self._motion = SameMotion(fleet, PERIOD)
        self.shares(_UNDER_WAY)

    def shares(self, periods: int) -> list[float]:
        """The bare engine's time over that of the environment, one for each control period."""
        found = []
        for _ in range(periods):
            action = followed(self._seen[None])[0]
            self._motion.begin()
            began = perf_counter()
            self._seen, _, terminated, truncated, _ = self._env.step(action)
            took = perf_counter() - began
            found.append(self._motion.repeat() / took)
            if terminated or truncated:
                self._seen = self._env.reset()[0]
        return found


def _scanner_shares(rig: Rig, periods: int) -> list[float]:
    """The speed with the scanner over that of the bare engine, one for each turn."""
    return [rig.rate(SCANNER, _TURN) / rig.rate(BARE, _TURN) for _ in range(periods // _TURN)]
