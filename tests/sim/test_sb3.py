import warnings

import gymnasium as gym
import numpy as np
import pytest

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # what it imports is not ours
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("torch._dynamo")  # its compiler crashes once OpenGL is in use

from stable_baselines3.common.env_checker import check_env

from sim.env import PathTrackingVectorEnv
from sim.sb3 import PathTrackingVecEnv, TraverseVecEnv
from trackslip.errors import InvalidValueError

OPTIONS = {"reference": ("paper", "slalom"), "randomization": "typical", "off_path": 0.21}


def test_single_environments_pass_its_checks():
    check_env(gym.make("sim:trackslip/PathTracking-v0", action="twist", pose_source="scanner").unwrapped)
    check_env(gym.make("sim:trackslip/Traverse-v0", flippers="pairs").unwrapped)
    env = TraverseVecEnv(2, threads=1, flippers="pairs")
    env.env_method("set_difficulty", 0.7, 0.7)
    with pytest.raises(InvalidValueError, match="no own methods"):
        env.env_method("set_difficulty", 0.7, 0.7, indices=[0])
    assert env.reset().shape == (2, 63)
    observation, reward, done, infos = env.step(np.zeros((2, 4)))
    assert (observation.shape, reward.shape, done.shape) == ((2, 63), (2,), (2,))
    assert [info["outcome"] for info in infos] == ["driving", "driving"]
    assert [info["difficulty"] for info in infos] == [0.7, 0.7]


def test_it_is_the_vector_environment():
    ours = PathTrackingVectorEnv(4, autoreset_mode="SameStep", **OPTIONS)
    theirs = PathTrackingVecEnv(4, **OPTIONS)
    theirs.seed(5)
    expected, _ = ours.reset(seed=5)
    np.testing.assert_array_equal(theirs.reset(), expected)
    assert theirs.reset_infos[2]["time"] == 0
    ours.action_space.seed(5)
    ends = 0
    for _ in range(150):
        actions = ours.action_space.sample()
        expected, reward, terminated, truncated, info = ours.step(actions)
        observation, rewards, done, infos = theirs.step(actions)
        np.testing.assert_array_equal(observation, expected)
        np.testing.assert_array_equal(rewards, reward.astype(np.float32))
        np.testing.assert_array_equal(done, terminated | truncated)
        for row in np.flatnonzero(done):
            ends += 1
            np.testing.assert_array_equal(infos[row]["terminal_observation"], info["final_obs"][row])
            assert infos[row]["TimeLimit.truncated"] == truncated[row]
            assert infos[row]["time"] == info["final_info"]["time"][row]
            assert info["time"][row] == 0
    assert ends > 0
    assert theirs.env_is_wrapped(object) == [False] * 4
    assert theirs.get_attr("num_envs", [1, 2]) == [4, 4]
    with pytest.raises(InvalidValueError, match="speed"):
        theirs.set_attr("speed", 1)
    theirs.set_options([{"radius_error": value} for value in (0.1, 0.2, 0.0, 0.0)])
    theirs.reset()
    np.testing.assert_allclose(theirs.env.task.fleet.drive.radius[:, 0], [0.066, 0.072, 0.06, 0.06])
