import gymnasium as gym
import numpy as np
import pytest

from sim import CrossingReward, Randomization, SensorNoise, TrackingReward

TRACKING = "sim:trackslip/PathTracking-v0"
CROSSING = "sim:trackslip/Traverse-v0"
OPTIONS = {
    TRACKING: {
        "randomization": Randomization.typical(),
        "reward": TrackingReward(weight_change=0.2),
    },
    CROSSING: {
        "course": "step10",
        "noise": SensorNoise(height=0.1),
        "reward": CrossingReward(weight_time=0.4),
    },
}
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.parametrize("name", OPTIONS),
]


def test_torchrl_makes_environments_by_id_and_takes_vectors(name):
    envs = pytest.importorskip("torchrl.envs")
    single = envs.GymEnv(name, **OPTIONS[name])
    envs.check_env_specs(single)
    assert single.rollout(5)["next", "reward"].shape == (5, 1)
    vector = gym.make_vec(name, num_envs=3, threads=1, autoreset_mode="Disabled", **OPTIONS[name])
    assert envs.GymWrapper(vector).rollout(4).batch_size == (3, 4)


def test_minari_recovers_an_environment_with_its_options(name, tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    pytest.importorskip("jax")  # with which it creates data sets
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = gym.make(name, max_episode_steps=5, **OPTIONS[name])
    collector = minari.DataCollector(env, data_format="arrow")
    observation, _ = collector.reset(seed=3)
    for _ in range(5):
        collector.step(np.zeros(collector.action_space.shape, np.float32))
    again = collector.create_dataset("trackslip/test-v0").recover_environment()
    again_observation, _ = again.reset(seed=3)
    np.testing.assert_array_equal(again_observation, observation)
    assert again.unwrapped.task.config == collector.unwrapped.task.config


def test_rllib_steps_a_module_of_its_own(name):
    pytest.importorskip("ray.rllib")
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner

    config = (
        PPOConfig()
        .environment(name, env_config=OPTIONS[name])
        .env_runners(num_envs_per_env_runner=2)
    )
    runner = SingleAgentEnvRunner(config=config)
    (episode, *_) = runner.sample(num_timesteps=8, random_actions=True)
    assert len(episode) >= 4
