"""The network of a trained model."""

from typing import Any

from sim.network import Network


def network_of(model: Any) -> Network:
    """The network of a Stable-Baselines3 model, from features to mean actions."""
    policy = model.policy
    layers = [layer for layer in [*policy.mlp_extractor.policy_net, policy.action_net] if hasattr(layer, "weight")]
    weights = tuple(layer.weight.detach().numpy().T.astype(float) for layer in layers)
    biases = tuple(layer.bias.detach().numpy().astype(float) for layer in layers)
    return Network(weights, biases)
