"""Random policies on many robots at once, each on ground of its own."""

import time

import gymnasium as gym
import numpy as np


def main(robots: int = 64, steps: int = 200) -> None:
    """Let them drive for a while."""
    envs = gym.make_vec("sim:trackslip/PathTracking-v0", num_envs=robots, randomization="typical")
    envs.reset(seed=0)
    envs.action_space.seed(0)
    began, rewards, ended = time.perf_counter(), np.zeros(robots), 0
    for _ in range(steps):
        _observation, reward, terminated, truncated, _info = envs.step(envs.action_space.sample())
        rewards += reward
        ended += int(np.sum(terminated | truncated))
    rate = robots * steps / (time.perf_counter() - began)
    print(f"{rate:,.0f} control periods per second, {rate / 20:,.0f} times real time")
    print(f"mean reward {rewards.mean() / steps:.2f} a period, {ended} episodes ended")
    envs.close()


if __name__ == "__main__":
    main()
