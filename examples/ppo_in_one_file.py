"""PPO in one file, like CleanRL's ppo_continuous_action.py but without options, on a batch of
robots.

Episodes end in two ways: a robot that leaves the path terminates its episode, and the end of the
reference truncates it. Only the latter gets the value of its last observation.
"""

from collections.abc import Mapping

import gymnasium as gym
import numpy as np
import torch
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from torch import nn
from torch.distributions import Normal

HORIZON, DISCOUNT, TRACE = 64, 0.98, 0.95


def network(inputs: int, outputs: int) -> nn.Sequential:
    """A network with two hidden layers."""
    return nn.Sequential(
        nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)
    )


def critic_after(
    critic: nn.Module, seen: np.ndarray, info: Mapping[str, np.ndarray]
) -> torch.Tensor:
    """Values (N,) of the observations (N, n) after a step: where an episode ended, of its last
    one, which `seen` replaces by the first of the next episode.
    """
    last = seen.copy()
    for row in np.flatnonzero(info.get("_final_obs", [])):
        last[row] = info["final_obs"][row]
    with torch.no_grad():
        return critic(torch.as_tensor(last))[:, 0]


def generalized_advantages(errors: torch.Tensor, ends: torch.Tensor) -> torch.Tensor:
    """Advantages (T, N) from one-step errors (T, N), where no sum crosses an episode's end."""
    advantages = torch.zeros_like(errors)
    later = torch.zeros_like(errors[0])
    for t in reversed(range(len(errors))):
        later = errors[t] + DISCOUNT * TRACE * (1 - ends[t]) * later
        advantages[t] = later
    return advantages


def main(steps: int = 200_000, robots: int = 32) -> None:
    """Train for `steps` control periods, summed over robots."""
    torch.manual_seed(0)
    options = {"action": "twist", "compensation": "icr_radius", "reference": ("circle", "slalom")}
    batch = gym.make_vec(
        "sim:trackslip/PathTracking-v0", num_envs=robots, autoreset_mode="SameStep", **options
    )
    envs = RecordEpisodeStatistics(batch)
    n, m = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]
    actor, critic, spread = network(n, m), network(n, 1), nn.Parameter(torch.full((m,), -0.5))
    parameters = [*actor.parameters(), *critic.parameters(), spread]
    optimizer = torch.optim.Adam(parameters, lr=1e-3, eps=1e-5)
    observation = torch.as_tensor(envs.reset(seed=0)[0])
    for update in range(steps // (robots * HORIZON)):
        rows = []
        for _ in range(HORIZON):
            with torch.no_grad():
                policy = Normal(actor(observation), spread.exp())
                action = policy.sample()
                log_prob = policy.log_prob(action).sum(1)
                value = critic(observation)[:, 0]
            seen, reward, terminated, truncated, info = envs.step(action.clamp(-1, 1).numpy())
            following = critic_after(critic, seen, info)
            ended = torch.as_tensor(terminated | truncated).float()
            earned = torch.as_tensor(reward, dtype=torch.float32)
            # after the end of the reference, the task would go on; after a failure it wouldn't
            goal = earned + DISCOUNT * following * (1 - torch.as_tensor(terminated).float())
            rows.append((observation, action, log_prob, value, goal, ended, earned))
            observation = torch.as_tensor(seen)
        observations, actions, log_probs, values, goals, ends, rewards = map(
            torch.stack, zip(*rows, strict=True)
        )
        advantages = generalized_advantages(goals - values, ends)
        flat = [
            each.flatten(0, 1)
            for each in (observations, actions, log_probs, advantages, advantages + values)
        ]
        for _ in range(4):
            for chosen in torch.randperm(robots * HORIZON).split(256):
                at, action, before, advantage, goal = (each[chosen] for each in flat)
                policy = Normal(actor(at), spread.exp())
                ratio = (policy.log_prob(action).sum(1) - before).exp()
                advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
                surrogate = torch.min(ratio * advantage, ratio.clamp(0.8, 1.2) * advantage)
                loss = 0.5 * (critic(at)[:, 0] - goal).square().mean() - surrogate.mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(parameters, 0.5)
                optimizer.step()
        print(
            f"{(update + 1) * robots * HORIZON:,} periods: mean reward {rewards.mean():.2f} per "
            "control period"
        )


if __name__ == "__main__":
    main()
