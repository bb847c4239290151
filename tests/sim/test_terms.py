import sys
import types

import gymnasium as gym
import numpy as np
import pytest

from trackslip.errors import InvalidValueError


@pytest.fixture(autouse=True)
def module(monkeypatch):
    own = types.ModuleType("own_terms")
    own.torque = lambda task: np.abs(task.fleet.drive.torque).sum(axis=1)
    monkeypatch.setitem(sys.modules, "own_terms", own)


def test_own_terms_of_path_tracking():
    name = "own_terms:torque"
    options = {
        "own_rewards": {name: -0.01},
        "own_observations": {name: 8.0},
        "privileged": {name: 4.0},
    }
    envs = gym.make_vec("sim:trackslip/PathTracking-v0", num_envs=3, threads=1, **options).unwrapped
    plain = gym.make_vec("sim:trackslip/PathTracking-v0", num_envs=3, threads=1).unwrapped
    first, _ = envs.reset(seed=0)
    plain.reset(seed=0)
    assert envs.observed[-1].name == name
    assert first[:, -1].tolist() == [0, 0, 0]
    for _ in range(4):
        action = np.full((3, 2), 0.6, np.float32)
        observation, reward, _, _, info = envs.step(action)
        plain_observation, plain_reward, *_ = plain.step(action)
        torque = np.abs(info["torque"]).sum(axis=1)
        np.testing.assert_allclose(reward, plain_reward - 0.01 * torque)
        np.testing.assert_allclose(observation[:, -1], torque / 8, rtol=1e-6)
        np.testing.assert_array_equal(observation[:, :-1], plain_observation)
        np.testing.assert_allclose(info["privileged"][:, 0], torque / 4, rtol=1e-6)
        np.testing.assert_allclose(info[f"reward_{name}"], -0.01 * torque)
    assert (torque > 0.3).all()
    assert (info["energy"] > 0).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"own_rewards": {"own_terms:missing": 1.0}},
            "function = 'own_terms:missing': must be MODULE:NAME",
        ),
        ({"own_rewards": {"nowhere": 1.0}}, "function = 'nowhere'"),
        ({"own_observations": {"own_terms:torque": 0.0}}, "own_terms:torque = 0.0"),
        (
            {"own_rewards": {"own_terms:torque": "much"}},
            "own_terms:torque = 'much': must be a number",
        ),
        ({"privileged": 3}, "privileged = 3"),
    ],
)
def test_terms_that_cannot_be_are_refused(options, message):
    with pytest.raises(InvalidValueError, match=message):
        gym.make("sim:trackslip/PathTracking-v0", **options)
