"""Training in trackslip/Traverse-v0: corrections of the scripted controller."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.learning.crossing import compare, crossing_table, gain_text
from experiments.learning.network import network_of
from sim.traverse.outcome import Limits
from sim.traverse.policy import OPTIONS, CrossingPolicy

if TYPE_CHECKING:
    from experiments.commands.train import Config

_HARD = ("step up", "stairs up", "beams")
"""Kinds of obstacles that the scripted controller does not always cross, which training draws."""
_LIMITS = Limits(time=20.0, stuck_time=3.0)
"""Of training, which should not spend its time on robots that are stuck."""


class TraverseTraining:
    """See `training.Training`."""

    initial_deviation = -1.0

    def __init__(self, config: Config) -> None:
        self._config = config

    def robots(self) -> Any:
        """The vector environment, whose actions are corrections."""
        from sim.sb3 import TraverseVecEnv

        config = self._config
        options = {
            **OPTIONS,
            "robot": config.robot,
            "difficulty": config.difficulty,
            "kinds": _HARD,
            "obstacles": 1,
            "limits": _LIMITS,
        }
        return TraverseVecEnv(config.robots, config.threads, **options)

    def ended(self, infos: Sequence[dict[str, Any]]) -> dict[str, float]:
        """Share of the courses that were crossed."""
        return {"crossed": float(np.mean([info["outcome"] == "reached" for info in infos]))} if infos else {}

    def save(self, model: Any, file: Path) -> None:
        """Write the policy of a model."""
        CrossingPolicy(network_of(model), {**OPTIONS, "robot": self._config.robot}).save(file)

    def finish(self, policy: Path) -> dict[str, Any]:
        """Compare the policy with the scripted controller on courses that it was not trained on."""
        config = self._config
        rates, gain = compare(
            CrossingPolicy.load(policy), config.difficulty, config.trials, config.seed, config.threads
        )
        return {"rates": rates, "gain": gain}

    def show(self, found: dict[str, Any]) -> None:
        """Print the share of unseen courses that each of them crosses."""
        title = f"Unseen courses, {self._config.trials} of each difficulty"
        crossing_table(title, found["rates"]).print()
        print(gain_text(found["gain"]))
