"""Batches of robots for rl_games and Tianshou, which have vector environments of their own.

Both require older versions of some packages than trackslip, so they are installed without them:

    pip install --no-deps rl-games tianshou

and after that the packages that they name when they are imported.
"""

from typing import Any

import gymnasium as gym
import numpy as np

ENVIRONMENT = "sim:trackslip/PathTracking-v0"


def rl_games_environment(config_name: str, num_actors: int, **options: Any) -> Any:
    """A batch of robots for rl_games, for `vecenv.register("TRACKSLIP", rl_games_environment)`."""
    from rl_games.common.ivecenv import IVecEnv

    class Robots(IVecEnv):
        """Robots whose episodes begin again in the step that ends them."""

        def __init__(self) -> None:
            self.envs = gym.make_vec(
                ENVIRONMENT, num_envs=num_actors, autoreset_mode="SameStep", **options
            )

        def reset(self) -> np.ndarray:
            observation, _ = self.envs.reset(seed=0)
            return observation

        def step(self, actions: np.ndarray) -> tuple[Any, ...]:
            clipped = np.clip(actions, -1.0, 1.0)
            observation, reward, terminated, truncated, _ = self.envs.step(clipped)
            # rl_games adds the value of the last observation where an episode timed out
            infos = {"time_outs": truncated}
            return observation, reward.astype(np.float32), terminated | truncated, infos

        def get_env_info(self) -> dict[str, Any]:
            return {
                "observation_space": self.envs.single_observation_space,
                "action_space": self.envs.single_action_space,
            }

    return Robots()


def tianshou_environment(num_envs: int, **options: Any) -> Any:
    """A batch of robots as a `BaseVectorEnv` of Tianshou, for its collectors."""
    from tianshou.env import BaseVectorEnv

    class Robots(BaseVectorEnv):
        """Robots that Tianshou resets one by one."""

        def __init__(self) -> None:
            self.envs = gym.make_vec(
                ENVIRONMENT, num_envs=num_envs, autoreset_mode="Disabled", **options
            )
            self.env_num = num_envs
            self.is_async = False
            self.is_closed = False
            self.ended = np.ones(num_envs, bool)
            self.seeds: list[int | None] = [None] * num_envs

        def get_env_attr(self, key: str, id: Any = None) -> list[Any]:
            values = self.envs.get_attr(key)
            return [values[row] for row in self._wrap_id(id)]

        def seed(self, seed: int | list[int] | None = None) -> list[Any]:
            several = [None] * num_envs if seed is None else seed
            self.seeds = [seed + k for k in range(num_envs)] if isinstance(seed, int) else several
            return [[one] for one in self.seeds]

        def reset(self, env_id: Any = None, **kwargs: Any) -> tuple[np.ndarray, np.ndarray]:
            rows = self._wrap_id(env_id)
            mask = np.isin(np.arange(num_envs), rows)
            observation, info = self.envs.reset(seed=self.seeds, options={"reset_mask": mask})
            self.seeds = [None] * num_envs
            self.ended[rows] = False
            return observation[rows], _by_robot(info, rows)

        def step(self, action: np.ndarray, id: Any = None) -> tuple[Any, ...]:
            rows = self._wrap_id(id)
            # robots that the collector needs no more wait in new episodes
            others = np.setdiff1d(np.flatnonzero(self.ended), rows)
            if others.size:
                self.reset(others)
            actions = np.zeros(self.envs.action_space.shape, np.float32)
            actions[rows] = np.clip(action, -1.0, 1.0)
            observation, reward, terminated, truncated, info = self.envs.step(actions)
            self.ended = terminated | truncated
            results = (observation, reward, terminated, truncated)
            return *(result[rows] for result in results), _by_robot(info, rows)

        def close(self) -> None:
            self.envs.close()
            self.is_closed = True

    return Robots()


def _by_robot(info: dict[str, Any], rows: Any) -> np.ndarray:
    """Infos (R,) of the robots `rows`, each a dictionary."""
    names = [name for name in info if not name.startswith("_")]
    return np.array([{name: info[name][row] for name in names} | {"env_id": row} for row in rows])
