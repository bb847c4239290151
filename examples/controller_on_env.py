"""A controller in a few lines, on the environment: keeps to the paper's path on ground that it wasn't made for."""

import gymnasium as gym
import numpy as np


def controller(observation: np.ndarray) -> np.ndarray:
    """The reference's twist, corrected by the errors; all in the observation's units (see sim.path_tracking)."""
    ahead, left, turn = observation[:3]
    v, w = observation[3:5]
    return np.clip([v + 1.5 * ahead, w + 4.0 * left + 3.0 * turn], -1.0, 1.0)


def main() -> None:
    """Drive one episode."""
    env = gym.make("sim:trackslip/PathTracking-v0", action="twist", compensation="icr_radius", ground="gravel")
    observation, info = env.reset(seed=0, options={"start_error": (-0.05, -0.1, 0.2)})
    squares, done = [], False
    while not done:
        observation, _reward, terminated, truncated, info = env.step(controller(observation))
        squares.append(np.sum(info["true_error"][:2] ** 2))
        done = terminated or truncated
    print(f"rms position error {1e3 * np.sqrt(np.mean(squares)):.1f} mm, on the path: {info['success']}")
    env.close()


if __name__ == "__main__":
    main()
