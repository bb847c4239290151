"""Train a policy that follows a path, with Stable-Baselines3 on a batch of robots, and print how it
improves: one to two minutes on two cores. `trackslip train` is the tuned version.
"""

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

from sim.sb3 import PathTrackingVecEnv

LINES = 8  # about the improvement


def main(steps: int = 98_304, robots: int = 32) -> None:
    """Train for `steps` control periods, summed over robots."""
    torch.set_num_threads(1)  # more are no faster for small networks
    batch = VecMonitor(
        PathTrackingVecEnv(
            robots,
            action="twist",
            compensation="icr_radius",
            reference="slalom",
            ground=("stone", "gravel"),
        )
    )
    model = PPO("MlpPolicy", batch, n_steps=64, batch_size=256, gamma=0.97, seed=0, device="cpu")
    print(
        f"PPO learns in {steps:,} control periods which twists {robots} robots must be given to "
        "follow a slalom on stone and gravel; an episode ends early if the robot is off the path"
    )
    for _ in range(LINES):
        model.learn(steps // LINES, reset_num_timesteps=False)
        episodes = model.ep_info_buffer  # the last 100
        if episodes:
            length = np.mean([episode["l"] for episode in episodes])
            reward = np.sum([episode["r"] for episode in episodes]) / length / len(episodes)
            print(
                f"after {model.num_timesteps:>7,} periods: on the path for {length:.0f} periods, "
                f"mean reward {reward:.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
