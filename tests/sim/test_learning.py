import warnings

import gymnasium as gym
import numpy as np
import pytest

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # what it imports is not ours
    torch = pytest.importorskip("torch")
    pytest.importorskip("torch._dynamo")  # its compiler crashes once OpenGL is in use
    pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.vec_env import VecMonitor

from sim.env import PathTrackingVectorEnv
from sim.sb3 import PathTrackingVecEnv, TraverseVecEnv
from trackslip.errors import InvalidValueError

DRAWN = {"reference": ("paper", "slalom"), "randomization": "typical", "off_path": 0.21}
OPTIONS = {
    PathTrackingVecEnv: {"reference": "circle", "action": "twist", "max_episode_steps": 60},
    TraverseVecEnv: {"course": "step10", "flippers": "pairs", "max_episode_steps": 30},
}
ROBOTS = 16
HORIZON = 64
SETTINGS = {
    PPO: {"n_steps": HORIZON, "batch_size": 256, "n_epochs": 4},
    SAC: {"batch_size": 256, "learning_starts": ROBOTS, "gradient_steps": 4},
}
pytestmark = pytest.mark.filterwarnings("ignore")


def test_its_checks_pass_and_difficulties_can_be_set():
    tracking = gym.make("sim:trackslip/PathTracking-v0", action="twist", pose_source="scanner")
    check_env(tracking.unwrapped)
    crossing = gym.make("sim:trackslip/Traverse-v0", flippers="pairs")
    check_env(crossing.unwrapped)
    env = TraverseVecEnv(2, threads=1, flippers="pairs")
    env.env_method("set_difficulty", 0.7, 0.7)
    env.reset()
    *_, infos = env.step(np.zeros((2, 4)))
    for info in infos:
        assert info["outcome"] == "driving"
        assert info["difficulty"] == 0.7


def test_it_is_the_vector_environment():
    ours = PathTrackingVectorEnv(4, autoreset_mode="SameStep", **DRAWN)
    theirs = PathTrackingVecEnv(4, **DRAWN)
    theirs.seed(5)
    expected, _ = ours.reset(seed=5)
    np.testing.assert_array_equal(theirs.reset(), expected)
    ours.action_space.seed(5)
    ends = 0
    for _ in range(60):
        actions = ours.action_space.sample()
        expected, reward, terminated, truncated, info = ours.step(actions)
        observation, rewards, done, infos = theirs.step(actions)
        np.testing.assert_array_equal(observation, expected)
        np.testing.assert_array_equal(rewards, reward.astype(np.float32))
        np.testing.assert_array_equal(done, terminated | truncated)
        for row in np.flatnonzero(done):
            ends += 1
            last = infos[row]["terminal_observation"]
            np.testing.assert_array_equal(last, info["final_obs"][row])
            assert infos[row]["TimeLimit.truncated"] == truncated[row]
            assert infos[row]["time"] == info["final_info"]["time"][row]
    assert ends > 0
    assert theirs.get_attr("num_envs", [1, 2]) == [4, 4]
    with pytest.raises(InvalidValueError, match="speed"):
        theirs.set_attr("speed", 1)
    theirs.set_options([{"radius_error": value} for value in (0.1, 0.2, 0.0, 0.0)])
    theirs.reset()
    radius = theirs.env.task.fleet.drive.radius[:, 0]
    np.testing.assert_allclose(radius, [0.066, 0.072, 0.06, 0.06])


def test_only_the_first_reset_continues_from_a_state():
    """Later ones begin new episodes."""
    env = PathTrackingVecEnv(2, threads=1)
    env.seed(3)
    at_start = env.reset()
    for _ in range(5):
        on_the_way, *_ = env.step(np.ones((2, 2)))
    assert not np.array_equal(on_the_way, at_start)
    again = PathTrackingVecEnv(2, threads=1)
    again.continue_from(env.env.get_state())
    np.testing.assert_array_equal(again.reset(), on_the_way)
    again.seed(3)
    np.testing.assert_array_equal(again.reset(), at_start)


def learnt(algorithm, kind, updates):
    """Returns (E,) of the episodes of a training, in order; its parameters move, and no episode is
    lost.
    """
    torch.manual_seed(0)
    torch.set_num_threads(1)
    settings = SETTINGS[algorithm] | {
        "stats_window_size": 100_000,
        "policy_kwargs": {"net_arch": [32, 32]},
    }
    envs = VecMonitor(kind(ROBOTS, threads=1, **OPTIONS[kind]))
    model = algorithm(
        "MlpPolicy", envs, seed=0, device="cpu", learning_rate=1e-3, gamma=0.98, **settings
    )
    before = [values.detach().clone() for values in model.policy.parameters()]
    steps = updates * ROBOTS * HORIZON
    model.learn(steps)
    after = list(model.policy.parameters())
    assert all(torch.isfinite(values).all() for values in after)
    assert not all(torch.equal(values, old) for values, old in zip(after, before, strict=True))
    returns = np.array([episode["r"] for episode in model.ep_info_buffer])
    lengths = np.array([episode["l"] for episode in model.ep_info_buffer])
    longest = OPTIONS[kind]["max_episode_steps"]
    assert lengths.max() <= longest
    assert steps - ROBOTS * longest <= lengths.sum() <= steps
    return returns


def test_it_trains():
    learnt(PPO, PathTrackingVecEnv, 1)


@pytest.mark.slow
@pytest.mark.parametrize("kind", OPTIONS)
@pytest.mark.parametrize("algorithm", SETTINGS)
def test_it_learns(algorithm, kind):
    of_tracking = 30 if algorithm is SAC else 150
    updates = of_tracking if kind is PathTrackingVecEnv else 15
    returns = learnt(algorithm, kind, updates)
    quarter = len(returns) // 4
    first = returns[:quarter]
    last = returns[-quarter:]
    error = np.hypot(first.std(), last.std()) / np.sqrt(quarter)
    assert last.mean() - first.mean() > 5 * error
