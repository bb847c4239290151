"""Trained policies that cross courses: corrections of the scripted controller."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sim.network import Network, load_network, refusing
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
        network, about = load_network(path, _FORMAT)
        with refusing(path):
            return cls(network, dict(about["options"]))
