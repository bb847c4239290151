"""Training in trackslip/PathTracking-v0: corrections of the reference's twist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.learning.training import network_of
from experiments.options.train import TrainConfig
from experiments.recording import record_all
from sim.path_tracking.config import Reward
from sim.path_tracking.randomization import Randomization
from sim.policy import Policy
from trackslip.logs.runlog import RunLog

_RANDOMIZATION = Randomization(start_distance=(0.0, 0.2), start_heading=(-0.4, 0.4), friction_ratio=(0.9, 1.4))
_REWARD = Reward(weight_position=0.8, weight_heading=0.2, weight_change=4.0, position_scale=0.02, heading_scale=0.2)


class PathTrackingTraining:
    """See `training.Training`."""

    initial_deviation = -1.2

    def __init__(self, config: TrainConfig) -> None:
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

    def finish(self, policy: Path, folder: Path) -> dict[str, Any]:
        """Record the policy's drives, if wanted."""
        if self._config.rrd:
            logs = [log for name in self._config.references for log in _driven(self._config, policy, name)]
            record_all(folder, logs)
        return {}

    def show(self, found: dict[str, Any]) -> None:
        """Print nothing: `trackslip benchmark` compares controllers."""


def _driven(config: TrainConfig, policy: Path, reference: str) -> list[RunLog]:
    """Run the policy along a path, from its beginning, on the first of the grounds; as far as it gets if it fails."""
    from experiments.commands.track import drive, make_reference
    from experiments.driving.world import World
    from experiments.options.track import TrackConfig
    from experiments.options.world import GroundOptions
    from sim.run_recorder import RunFailedError

    course = TrackConfig(
        controller=f"ppo:{policy}",
        compensation=config.compensation,
        reference=reference,
        ground=GroundOptions(config.grounds[0]),
        seed=config.seed,
        threads=config.threads,
        rrd=True,
    )
    world = World.of(course)
    try:
        logs = drive(course, world, make_reference(course, world.robot))
    except RunFailedError as error:
        logs = error.logs
    named = {"controller": f"ppo:{config.out}"}
    return [replace(log, run=f"policy {reference}", metadata=log.metadata | named) for log in logs[:1]]
