"""Policies that cross courses: the scripted controller, and trained corrections of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sim.policy import Network, load_network
from sim.traverse.reflex import Reflex
from sim.traverse.world import Command, Traverse
from trackslip.errors import Checked, checked, require_non_negative, require_positive
from trackslip.kinematics import Array

OPTIONS: dict[str, Any] = {"action": "correction", "flippers": "pairs", "period": 0.2}
"""Fields of `TraverseConfig` for which policies are trained."""
_FORMAT = "trackslip crossing policy 1"


@dataclass(frozen=True)
class CrossingPolicy:
    """The result of a training: the network, and the environment that it was trained in."""

    network: Network
    """From observations to actions in [-1, 1]."""
    options: dict[str, Any]
    """Fields of `TraverseConfig` on which observations and actions depend."""

    def action(self, observation: ArrayLike) -> Array:
        """Actions (N, A) in [-1, 1] for observations (N, n)."""
        return np.clip(self.network(np.asarray(observation, float)), -1.0, 1.0)

    def save(self, path: Path) -> None:
        """Write a .npz file."""
        self.network.save(path, {"format": _FORMAT, "options": self.options})

    @classmethod
    def load(cls, path: Path) -> CrossingPolicy:
        """Read a file written by `save`, or policy.npz in a folder; raises LogError for any other file."""
        network, (options,) = load_network(path, _FORMAT, "options")
        return cls(network, options)


@dataclass(frozen=True)
class Scripted(Checked):
    """Drives along y = 0 and keeps the flippers on reflex."""

    speed: float = checked(0.4, require_positive)
    """Forward speed of the belts [m/s]."""
    position_gain: float = checked(0.3, require_non_negative)
    """Belt speed per distance from the middle [1/s]."""
    heading_gain: float = checked(0.45, require_non_negative)
    """Belt speed per heading [m/s]."""
    turn: float = checked(0.3, require_non_negative)
    """Largest difference of a belt's speed from the mean of both [m/s]."""
    reflex: Reflex = field(default_factory=Reflex)
    """Reflex of the flippers."""

    def command(self, world: Traverse) -> Command:
        """Set points of all robots in `world`."""
        state = world.state
        aside = -self.position_gain * state.position[:, 1] - self.heading_gain * state.heading
        turn = np.clip(aside, -self.turn, self.turn)
        return Command(self.speed + turn[:, None] * np.array([-1.0, 1.0]), world.reflex(self.reflex))
