import json
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

from sim.env import PathTrackingEnv
from sim.policy import Network, Policy, PolicyController, TrackingPolicy
from sim.traverse.policy import OPTIONS as CROSSING
from trackslip.controllers.base import SensesSprockets
from trackslip.errors import InvalidValueError, LogError
from trackslip.trajectory.segmented import paper_reference

OPTIONS = {"action": "twist", "compensation": "icr_radius", "reference": "paper"}
AUTHORITY = (0.1, 0.5)


def network(rng, sizes=(19, 8, 2)):
    """A network with random weights and biases."""
    pairs = list(pairwise(sizes))
    weights = tuple(rng.normal(0, 0.3, pair) for pair in pairs)
    biases = tuple(rng.normal(0, 0.1, size) for _, size in pairs)
    return Network(weights, biases)


def test_a_network_is_layers_of_tanh_bitwise_for_many_rows():
    rng = np.random.default_rng(0)
    layers = network(rng, (50, 64, 64, 2))
    x = rng.normal(size=(2000, 50))
    weight_1, weight_2, weight_3 = layers.weights
    bias_1, bias_2, bias_3 = layers.biases
    hidden = np.tanh(x @ weight_1 + bias_1)
    hidden = np.tanh(hidden @ weight_2 + bias_2)
    every = layers(x)
    np.testing.assert_allclose(every, hidden @ weight_3 + bias_3, atol=1e-12)
    for k in (0, 1, 24, 1999):
        np.testing.assert_array_equal(every[k], layers(x[k : k + 1])[0])
    assert layers(x[:0]).shape == (0, 2)


@pytest.mark.parametrize(
    ("bias", "expected"), [(0.0, [0.15, 0.12]), (9.0, [0.15 + 0.1 * 0.3, 0.12 + 0.5])]
)
def test_corrections_are_as_large_as_the_authority(bias, expected):
    constant = Network((np.zeros((19, 2)),), (np.full(2, bias),))
    controller = PolicyController(TrackingPolicy(constant, OPTIONS, AUTHORITY), 5.0)
    reference = paper_reference()
    twist = controller.twist(20.0, reference.pose(20.0)[None] + 0.1, reference)
    np.testing.assert_allclose(twist, [expected], atol=1e-7)


ABOUT = {"format": "trackslip policy 1", "authority": AUTHORITY, "options": OPTIONS}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weight_0": np.zeros((19, 3))}, "layers = .*: must be one or more of finite numbers"),
        (
            {"weight_0": np.full((19, 8), np.nan)},
            "layers = .*: must be one or more of finite numbers",
        ),
        (
            {
                "weight_0": np.zeros((19, 0)),
                "bias_0": np.zeros(0),
                "weight_1": np.zeros((0, 2)),
            },
            "layers = .*: must be one or more of finite numbers",
        ),
        (
            {"bias_1": np.full(2, np.inf, np.float16)},
            "layers = .*: must be one or more of finite numbers",
        ),
        (
            {"about": np.array(json.dumps({"format": "trackslip policy 2"}))},
            "format = 'trackslip policy 2': must be 'trackslip policy 1'",
        ),
        (
            {"about": np.array(json.dumps(ABOUT | {"authority": [0.1]}))},
            r"authority = \[0.1\]: must be 2 values",
        ),
        (
            {"about": np.array(json.dumps(ABOUT | {"gain": 2.0}))},
            r"entries = \['authority', 'gain', 'options'\]: must be options, authority",
        ),
        (
            {"about": np.array(json.dumps(ABOUT | {"options": {"acton": "twist"}}))},
            "options = 'acton': must be some of own_rewards, .*action",
        ),
        ({"about": np.array(json.dumps(ABOUT | {"options": 3}))}, "options = 3: must be a dict"),
        ({"about": np.array("[]")}, "not a policy"),
        ({"about": np.array([{"format": 1}], object)}, "not a policy"),
        ({"weight_7": np.zeros((2, 2))}, "arrays = .*'weight_7'.*: must be weight_0, weight_1"),
    ],
)
def test_files_of_policies_that_make_no_sense_are_refused(tmp_path, change, message):
    path = tmp_path / "policy.npz"
    TrackingPolicy(network(np.random.default_rng(0), (19, 8, 2)), OPTIONS, AUTHORITY).save(path)
    np.savez(path, **{**np.load(path), **change})
    with pytest.raises(LogError, match=message):
        TrackingPolicy.load(path)
    for content in (b"PK\x03\x04 and so on", b"no zip"):
        path.write_bytes(content)
        with pytest.raises(LogError, match="not a policy"):
            TrackingPolicy.load(path)


def test_a_policy_that_unpacks_to_gigabytes_is_refused(tmp_path):
    path = tmp_path / "policy.npz"
    np.savez_compressed(path, about=np.array("{}"), weight_0=np.zeros(13_000_000))
    assert path.stat().st_size < 200_000
    message = r"policy\.npz: unpacks to 104 MB, must be at most 100 MB$"
    for kind in (Policy, TrackingPolicy):
        with pytest.raises(LogError, match=message):
            kind.load(path)


@pytest.mark.parametrize(
    ("inputs", "options", "message"),
    [
        (7, {}, r"= \(7, 2\): must be from 19 inputs to 2"),
        (21, {"loads": True}, "loads of the policy"),
        (19, {"action": "sprockets"}, "action of the policy = 'sprockets': must be 'twist'"),
    ],
)
def test_a_policy_of_another_environment_is_refused(inputs, options, message):
    layers = network(np.random.default_rng(0), (inputs, 2))
    policy = TrackingPolicy(layers, OPTIONS | options, AUTHORITY)
    with pytest.raises(InvalidValueError, match=message):
        PolicyController(policy, 5.0)


def test_a_policy_sees_the_same_in_benchmark_and_environment():
    rng = np.random.default_rng(1)
    policy = TrackingPolicy(network(rng), OPTIONS, AUTHORITY)
    env = PathTrackingEnv(**OPTIONS)
    controller = PolicyController(policy, env.task.fleet.drive.limit)
    assert isinstance(controller, SensesSprockets)
    reference = paper_reference()
    observation, info = env.reset(seed=0, options={"start_error": (0.02, -0.05, 0.1)})
    for _ in range(60):
        action = policy.action(observation[None])[0]
        controller.sense(np.array(info["measured_omega"])[None])
        twist = controller.twist(info["time"], np.array(info["measured_pose"])[None], reference)
        np.testing.assert_allclose(twist[0] / [0.3, 1.0], action, atol=1e-6)
        observation, *_, info = env.step(action.astype(np.float32))


def test_a_stored_policy_is_the_same(tmp_path):
    rng = np.random.default_rng(0)
    for policy in (
        TrackingPolicy(network(rng), OPTIONS, AUTHORITY),
        Policy(network(rng), {"robot": "box"}),
    ):
        policy.save(tmp_path / "policy.npz")
        seen = rng.uniform(-1, 1, (5, 19))
        for path in (tmp_path, tmp_path / "policy.npz"):
            stored = type(policy).load(path)
            np.testing.assert_array_equal(stored.action(seen), policy.action(seen))
            assert stored.options == policy.options
            assert getattr(stored, "authority", None) == getattr(policy, "authority", None)


@pytest.mark.parametrize("task", ["PathTracking", "Traverse"])
def test_an_onnx_file_maps_observations_to_actions_with_units(tmp_path, task):
    """By onnx's own reference implementation."""
    onnx = pytest.importorskip("onnx")
    reference = pytest.importorskip("onnx.reference")
    from sim.policy import write_onnx

    crossing = task == "Traverse"
    options = CROSSING | {"course": "flat"} if crossing else {"action": "twist"}
    env = gym.make(f"sim:trackslip/{task}-v0", **options).unwrapped
    layers = network(np.random.default_rng(0), (len(env.observed), 16, len(env.commanded)))
    layers.weights[1][:] *= 3.0
    policy = Policy(layers, options) if crossing else TrackingPolicy(layers, options, (0.2, 0.6))
    write_onnx(tmp_path / "policy.onnx", policy, env.observed, env.commanded)
    model = onnx.load(tmp_path / "policy.onnx")
    seen = np.array([env.observation_space.sample() for _ in range(50)])
    (action,) = reference.ReferenceEvaluator(model).run(None, {"observation": seen})
    np.testing.assert_allclose(action, policy.action(seen), atol=1e-5)
    is_not_clipped = np.abs(action) < 1
    assert 0.05 < is_not_clipped.mean() < 1
    about = {each.key: json.loads(each.value) for each in model.metadata_props}
    assert about["observation"][0].keys() == {"name", "unit", "scale", "bound"}
    assert [each["unit"] for each in about["action"]] == [each.unit for each in env.commanded]
    assert about["options"] == options
