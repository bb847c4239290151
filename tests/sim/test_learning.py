"""Both environments train with what people use: Stable-Baselines3 and a loop like CleanRL's."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from sim.task_env import TaskVectorEnv

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # what it imports is not ours
    torch = pytest.importorskip("torch")
    pytest.importorskip("torch._dynamo")  # its compiler crashes once OpenGL is in use

TRACKING, TRAVERSE = "PathTracking-v0", "Traverse-v0"
OPTIONS = {
    TRACKING: {"reference": "circle", "action": "twist", "max_episode_steps": 60},
    TRAVERSE: {"course": "step10", "flippers": "pairs", "max_episode_steps": 30},
}
LENGTH = {TRACKING: 60, TRAVERSE: 30}  # of the longest episode [control periods]
ROBOTS, HORIZON = 16, 64
UPDATE = ROBOTS * HORIZON  # steps
pytestmark = pytest.mark.filterwarnings("ignore")


def network(inputs, outputs):
    layers = [torch.nn.Linear(inputs, 32), torch.nn.Tanh(), torch.nn.Linear(32, 32), torch.nn.Tanh()]
    return torch.nn.Sequential(*layers, torch.nn.Linear(32, outputs))


def robots(name, **options):
    envs = gym.make_vec(f"sim:trackslip/{name}", num_envs=ROBOTS, threads=1, **OPTIONS[name], **options)
    assert isinstance(envs.unwrapped, TaskVectorEnv)
    return RecordEpisodeStatistics(envs, buffer_length=100_000)


def cleanrl(name, steps):
    """PPO as in CleanRL's ppo_continuous_action.py, without its options."""
    envs = robots(name, autoreset_mode="SameStep")
    n, m = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]
    actor, critic, spread = network(n, m), network(n, 1), torch.nn.Parameter(torch.full((m,), -0.5))
    parameters = [*actor.parameters(), *critic.parameters(), spread]
    optimizer = torch.optim.Adam(parameters, lr=1e-3, eps=1e-5)
    yield parameters
    observation = torch.as_tensor(envs.reset(seed=0)[0])
    done = torch.zeros(ROBOTS)
    for _ in range(steps // UPDATE):
        rows = []
        for _ in range(HORIZON):
            with torch.no_grad():
                policy = torch.distributions.Normal(actor(observation), spread.exp())
                action = policy.sample()
                known = observation, action, policy.log_prob(action).sum(1), critic(observation)[:, 0], done
            seen, reward, terminated, truncated, _ = envs.step(action.clamp(-1, 1).numpy())
            rows.append((*known, torch.as_tensor(reward, dtype=torch.float32)))
            observation, done = torch.as_tensor(seen), torch.as_tensor(terminated | truncated).float()
        observations, actions, log_probs, values, dones, rewards = map(torch.stack, zip(*rows, strict=True))
        with torch.no_grad():
            following, ended, later, advantages = critic(observation)[:, 0], done, 0.0, torch.zeros_like(rewards)
            for t in reversed(range(HORIZON)):
                error = rewards[t] + 0.98 * following * (1 - ended) - values[t]
                advantages[t] = later = error + 0.98 * 0.95 * (1 - ended) * later
                following, ended = values[t], dones[t]
        flat = [one.flatten(0, 1) for one in (observations, actions, log_probs, advantages, advantages + values)]
        for _ in range(4):
            for some in torch.randperm(UPDATE).split(256):
                at, action, before, advantage, goal = (one[some] for one in flat)
                policy = torch.distributions.Normal(actor(at), spread.exp())
                ratio = (policy.log_prob(action).sum(1) - before).exp()
                advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
                surrogate = torch.min(ratio * advantage, ratio.clamp(0.8, 1.2) * advantage)
                loss = 0.5 * (critic(at)[:, 0] - goal).square().mean() - surrogate.mean()
                optimizer.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(parameters, 0.5)
                optimizer.step()
    yield envs.return_queue, envs.length_queue


def stable_baselines(algorithm, name, steps, **settings):
    from stable_baselines3.common.vec_env import VecMonitor

    from sim.sb3 import PathTrackingVecEnv, TraverseVecEnv

    kind = PathTrackingVecEnv if name == TRACKING else TraverseVecEnv
    envs = VecMonitor(kind(ROBOTS, threads=1, **OPTIONS[name]))
    settings |= {"stats_window_size": 100_000, "policy_kwargs": {"net_arch": [32, 32]}}
    model = algorithm("MlpPolicy", envs, seed=0, device="cpu", learning_rate=1e-3, gamma=0.98, **settings)
    yield list(model.policy.parameters())
    model.learn(steps)
    yield [one["r"] for one in model.ep_info_buffer], [one["l"] for one in model.ep_info_buffer]


def sb3_ppo(name, steps):
    ppo = pytest.importorskip("stable_baselines3").PPO
    return stable_baselines(ppo, name, steps, n_steps=HORIZON, batch_size=256, n_epochs=4)


def sb3_sac(name, steps):
    sac = pytest.importorskip("stable_baselines3").SAC
    return stable_baselines(sac, name, steps, batch_size=256, learning_starts=ROBOTS, gradient_steps=4)


def learnt(library, name, steps):
    """Returns (E,) of the episodes of a training, in order; its parameters move, and no episode is lost."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    stages = library(name, steps)
    parameters = next(stages)
    before = [one.detach().clone() for one in parameters]
    returns, lengths = map(np.array, next(stages))
    assert all(torch.isfinite(one).all() for one in parameters)
    assert not all(torch.equal(one, old) for one, old in zip(parameters, before, strict=True))
    assert np.isfinite(returns).all()
    assert lengths.max() <= LENGTH[name]
    assert steps - ROBOTS * LENGTH[name] <= lengths.sum() <= steps
    return returns


LIBRARIES = [cleanrl, sb3_ppo, sb3_sac]


@pytest.mark.parametrize(("library", "name"), [(cleanrl, TRACKING), (sb3_ppo, TRAVERSE)])
def test_it_trains(library, name):
    learnt(library, name, UPDATE)


@pytest.mark.slow
@pytest.mark.parametrize("name", OPTIONS)
@pytest.mark.parametrize("library", LIBRARIES)
def test_it_learns(library, name):
    """The last episodes earn more than the first."""
    updates = (30 if library is sb3_sac else 150) if name == TRACKING else 15
    returns = learnt(library, name, updates * UPDATE)
    quarter = len(returns) // 4
    first, last = returns[:quarter], returns[-quarter:]
    error = np.hypot(first.std(), last.std()) / np.sqrt(quarter)
    assert last.mean() - first.mean() > 5 * error
