"""Train a policy with Stable-Baselines3 on a batch of robots; `trackslip train` is the tuned
version.
"""

from stable_baselines3 import PPO

from sim.sb3 import PathTrackingVecEnv


def main(steps: int = 200_000, robots: int = 32) -> None:
    """Train for `steps` control periods, summed over robots."""
    batch = PathTrackingVecEnv(
        robots, action="twist", compensation="icr_radius", ground=("stone", "gravel")
    )
    model = PPO("MlpPolicy", batch, n_steps=64, batch_size=256, gamma=0.97, seed=0, device="cpu")
    model.learn(steps)
    rewards = model.rollout_buffer.rewards
    print(
        f"mean reward {rewards.mean():.2f} per control period after {model.num_timesteps:,} periods"
    )


if __name__ == "__main__":
    main()
