"""Training in trackslip/PathTracking-v0: corrections of the reference's twist."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.learning.network import network_of
from sim.path_tracking.config import Reward
from sim.path_tracking.randomization import Randomization
from sim.policy import Policy

if TYPE_CHECKING:
    from experiments.commands.train import Config

_RANDOMIZATION = Randomization(start_distance=(0.0, 0.2), start_heading=(-0.4, 0.4), friction_ratio=(0.9, 1.4))
_REWARD = Reward(weight_position=0.8, weight_heading=0.2, weight_change=4.0, position_scale=0.02, heading_scale=0.2)


class PathTrackingTraining:
    """See `training.Training`."""

    initial_deviation = -1.2

    def __init__(self, config: Config) -> None:
        self._config = config

    def robots(self) -> Any:
        """The vector environment, whose actions are corrections."""
        from sim.sb3 import Corrections, PathTrackingVecEnv

        config = self._config
        robots = PathTrackingVecEnv(
            config.robots,
            config.threads,
            reference=config.references,
            ground=config.grounds,
            action="twist",
            compensation=config.compensation,
            pose_source="noisy",
            reward=_REWARD,
            randomization=_RANDOMIZATION,
        )
        return Corrections(robots, config.authority)

    def ended(self, infos: Sequence[dict[str, Any]]) -> dict[str, float]:
        """Nothing: the reward says it all."""
        return {}

    def save(self, model: Any, file: Path) -> None:
        """Write the policy of a model."""
        Policy(network_of(model), self._config.authority, {"action": "twist"}).save(file)

    def finish(self, policy: Path) -> dict[str, Any]:
        """Nothing: `trackslip benchmark` compares controllers."""
        return {}

    def show(self, found: dict[str, Any]) -> None:
        """Print nothing."""
