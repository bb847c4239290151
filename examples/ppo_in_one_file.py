"""PPO in one file, like CleanRL's ppo_continuous_action.py but without options, on a batch of
robots.
"""

import gymnasium as gym
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
    observation, done = torch.as_tensor(envs.reset(seed=0)[0]), torch.zeros(robots)
    for update in range(steps // (robots * HORIZON)):
        rows = []
        for _ in range(HORIZON):
            with torch.no_grad():
                policy = Normal(actor(observation), spread.exp())
                action = policy.sample()
                known = (
                    observation,
                    action,
                    policy.log_prob(action).sum(1),
                    critic(observation)[:, 0],
                    done,
                )
            seen, reward, terminated, truncated, _ = envs.step(action.clamp(-1, 1).numpy())
            rows.append((*known, torch.as_tensor(reward, dtype=torch.float32)))
            observation, done = (
                torch.as_tensor(seen),
                torch.as_tensor(terminated | truncated).float(),
            )
        observations, actions, log_probs, values, dones, rewards = map(
            torch.stack, zip(*rows, strict=True)
        )
        with torch.no_grad():
            following, ended, later, advantages = (
                critic(observation)[:, 0],
                done,
                0.0,
                torch.zeros_like(rewards),
            )
            for t in reversed(range(HORIZON)):
                error = rewards[t] + DISCOUNT * following * (1 - ended) - values[t]
                advantages[t] = later = error + DISCOUNT * TRACE * (1 - ended) * later
                following, ended = values[t], dones[t]
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
