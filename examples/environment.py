"""A short policy in the learning environment, which follows the paper's path on ground it was not
tuned for.
"""

import gymnasium as gym
import numpy as np


def policy(observation: np.ndarray) -> np.ndarray:
    """The reference twist plus proportional feedback, in the units of the observation (see
    sim.path_tracking).
    """
    ahead, left, turn = observation[:3]
    v, w = observation[3:5]
    return np.clip([v + 1.5 * ahead, w + 4.0 * left + 3.0 * turn], -1.0, 1.0)


def main() -> None:
    """Drive one episode, then a batch of robots with random actions."""
    env = gym.make(
        "sim:trackslip/PathTracking-v0", action="twist", compensation="icr_radius", ground="gravel"
    )
    observation, info = env.reset(seed=0, options={"start_error": (-0.05, -0.1, 0.2)})
    squares, done = [], False
    while not done:
        observation, _reward, terminated, truncated, info = env.step(policy(observation))
        squares.append(np.sum(info["true_error"][:2] ** 2))
        done = terminated or truncated
    print(
        f"rms position error {1e3 * np.sqrt(np.mean(squares)):.1f} mm, on the path: "
        f"{info['success']}"
    )
    env.close()

    envs = gym.make_vec("sim:trackslip/PathTracking-v0", num_envs=8, randomization="typical")
    envs.reset(seed=0)
    envs.action_space.seed(0)
    rewards = [envs.step(envs.action_space.sample())[1] for _ in range(50)]
    print(f"mean reward of random actions {np.mean(rewards):.2f} per control period")
    envs.close()


if __name__ == "__main__":
    main()
