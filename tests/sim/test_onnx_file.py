"""Policies as ONNX files give the actions of the policies, by onnx's own reference implementation."""

import json

import gymnasium as gym
import numpy as np
import pytest

from sim.policy import CrossingPolicy, Network, Policy
from sim.traverse.policy import OPTIONS

onnx = pytest.importorskip("onnx")
from onnx.reference import ReferenceEvaluator  # noqa: E402

from sim.policy import write_onnx  # noqa: E402


@pytest.mark.parametrize("task", ["PathTracking", "Traverse"])
def test_a_graph_from_observations_to_actions_with_their_units(tmp_path, task):
    crossing = task == "Traverse"
    options = OPTIONS | {"course": "flat"} if crossing else {"action": "twist"}
    env = gym.make(f"sim:trackslip/{task}-v0", **options).unwrapped
    rng, (n, a) = np.random.default_rng(0), (len(env.observed), len(env.commanded))
    weights = rng.normal(0, 0.4, (n, 16)), rng.normal(0, 0.8, (16, a))
    network = Network(weights, (rng.normal(size=16), rng.normal(0, 0.3, a)))
    policy = CrossingPolicy(network, options) if crossing else Policy(network, (0.2, 0.6), options)
    write_onnx(tmp_path / "policy.onnx", policy, env.observed, env.commanded)
    model = onnx.load(tmp_path / "policy.onnx")
    seen = np.array([env.observation_space.sample() for _ in range(50)])
    (action,) = ReferenceEvaluator(model).run(None, {"observation": seen})
    np.testing.assert_allclose(action, policy.action(seen), atol=1e-5)
    assert 0.05 < (np.abs(action) < 1).mean() < 1  # some are clipped
    about = {each.key: json.loads(each.value) for each in model.metadata_props}
    assert about["observation"][0].keys() == {"name", "unit", "scale", "bound"}
    assert [each["unit"] for each in about["action"]] == [each.unit for each in env.commanded]
    assert about["options"] == options
