"""What a training consists of, whatever it is that is learnt."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

from sim.network import Network


class Training(Protocol):
    """An environment to learn in, and what becomes of the result."""

    initial_deviation: float
    """Standard deviation of the actions at the beginning, as a natural logarithm."""

    def robots(self) -> Any:
        """The vector environment, with the interface of Stable-Baselines3."""

    def ended(self, infos: Sequence[dict[str, Any]]) -> dict[str, float]:
        """Further values of a point of the learning curve, from the last infos of episodes that have ended."""

    def save(self, model: Any, file: Path) -> None:
        """Write the policy of a model."""

    def finish(self, policy: Path) -> dict[str, Any]:
        """Try the policy that was written; returns entries of summary.json."""

    def show(self, found: dict[str, Any]) -> None:
        """Print what `finish` returned."""


def network_of(model: Any) -> Network:
    """The network of a Stable-Baselines3 model, from features to mean actions."""
    policy = model.policy
    layers = [layer for layer in [*policy.mlp_extractor.policy_net, policy.action_net] if hasattr(layer, "weight")]
    weights = tuple(layer.weight.detach().numpy().T.astype(float) for layer in layers)
    biases = tuple(layer.bias.detach().numpy().astype(float) for layer in layers)
    return Network(weights, biases)
