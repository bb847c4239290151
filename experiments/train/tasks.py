"""The environments that `trackslip train` learns in, and what becomes of their policies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from experiments.benchmark.plants import distribution
from experiments.train.config import Config
from experiments.train.crossing import compare
from sim.network import Network
from sim.path_tracking.config import Reward
from sim.policy import Policy
from sim.robot.named import SHIPPED, load_parameters
from sim.traverse.outcome import Limits
from sim.traverse.policy import OPTIONS, CrossingPolicy

_START_DISTANCE, _START_HEADING = (0.0, 0.2), (-0.4, 0.4)  # ranges [m], [rad]
_REWARD = Reward(weight_position=0.8, weight_heading=0.2, weight_change=30.0, position_scale=0.02, heading_scale=0.2)
_HARD = ("step up", "stairs up", "beams")
"""Kinds of obstacles that the scripted controller does not always cross, which training draws."""
_LIMITS = Limits(time=20.0, stuck_time=3.0)
"""Of training, which should not spend its time on robots that are stuck."""


class LearningTask(Protocol):
    """An environment to learn in, and what becomes of the result."""

    initial_deviation: float
    """Standard deviation of the actions at the beginning, as a natural logarithm."""

    def robots(self) -> Any:
        """The vector environment, with the interface of Stable-Baselines3; its actions are corrections."""

    def ended(self, infos: Sequence[dict[str, Any]]) -> dict[str, float]:
        """Further values of a point of the learning curve, from the last infos of episodes that have ended."""

    def policy(self, network: Network) -> Policy | CrossingPolicy:
        """The policy of a trained network."""

    def tried(self, policy: Path) -> dict[str, Any]:
        """Entries of summary.json from a trial of the policy that was written."""


class PathTrackingTask:
    """Corrections of the reference's twist on drawn plants, in trackslip/PathTracking-v0."""

    initial_deviation = -1.2

    def __init__(self, config: Config) -> None:
        self._config = config

    def robots(self) -> Any:
        """See LearningTask."""
        from sim.sb3 import Corrections, PathTrackingVecEnv

        config = self._config
        parameters, _ = load_parameters(config.robot or SHIPPED)
        plants = distribution(parameters, parameters.drive)
        robots = PathTrackingVecEnv(
            config.robots,
            config.threads,
            robot=parameters,
            reference=config.references,
            ground=config.grounds,
            action="twist",
            compensation=config.compensation,
            laws=config.laws and str(config.laws),
            pose_source="noisy",
            reward=_REWARD,
            randomization=replace(plants, start_distance=_START_DISTANCE, start_heading=_START_HEADING),
        )
        return Corrections(robots, config.authority)

    def ended(self, infos: Sequence[dict[str, Any]]) -> dict[str, float]:
        """See LearningTask."""
        return {}

    def policy(self, network: Network) -> Policy:
        """See LearningTask."""
        return Policy(network, self._config.authority, {"action": "twist"})

    def tried(self, policy: Path) -> dict[str, Any]:
        """See LearningTask."""
        return {}


class Traversing:
    """Corrections of the scripted controller, in trackslip/Traverse-v0."""

    initial_deviation = -1.0

    def __init__(self, config: Config) -> None:
        self._config = config
        self._options = {**OPTIONS, "robot": config.robot or "rescue", "course": list(config.courses)}

    def robots(self) -> Any:
        """See LearningTask."""
        from sim.sb3 import TraverseVecEnv

        courses = {"difficulty": self._config.difficulty, "kinds": _HARD, "obstacles": 1, "limits": _LIMITS}
        return TraverseVecEnv(self._config.robots, self._config.threads, **self._options, **courses)

    def ended(self, infos: Sequence[dict[str, Any]]) -> dict[str, float]:
        """See LearningTask."""
        return {"crossed": float(np.mean([info["outcome"] == "reached" for info in infos]))} if infos else {}

    def policy(self, network: Network) -> CrossingPolicy:
        """See LearningTask."""
        return CrossingPolicy(network, self._options)

    def tried(self, policy: Path) -> dict[str, Any]:
        """See LearningTask: compared with the scripted controller and others, on courses that are new to all."""
        config = self._config
        trained = CrossingPolicy.load(policy)
        rates, gains = compare(trained, config.difficulty, config.trials, config.seed, config.threads)
        return {"rates": rates, "gains": gains}
