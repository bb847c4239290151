"""The vector environments for Stable-Baselines3, which need the extra `rl`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from sim.env import PathTrackingVectorEnv, TraverseVectorEnv
from sim.learning.environment import TaskVectorEnv
from sim.policy import corrected, features
from trackslip.errors import InvalidValueError, TrackslipError, require

try:
    from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
except ImportError as error:
    raise TrackslipError(f'sim.sb3: {error}; pip install -e ".[rl]"') from error


class TaskVecEnv(VecEnv):  # type: ignore[misc, unused-ignore]
    """A vector environment with Stable-Baselines3's interface; the step that ends an episode also
    resets the robot.
    """

    kind: ClassVar[type[TaskVectorEnv]]

    def __init__(self, num_envs: int = 1, threads: int | None = None, **options: Any) -> None:
        """Build the simulator for `num_envs` robots; see the vector environment."""
        env = self.kind(
            num_envs, autoreset_mode=AutoresetMode.SAME_STEP, threads=threads, **options
        )
        self.env = env
        """The vector environment."""
        self.render_mode = env.render_mode
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._continues = False
        self._actions: np.ndarray = np.zeros(env.action_space.shape or ())

    def continue_from(self, state: Mapping[str, Any]) -> None:
        """Return to a state of `env`; the next `reset`, with which every training begins, doesn't
        begin episodes, but continues those of the state.
        """
        self.env.set_state(state)
        self._continues = True

    def reset(self) -> np.ndarray:
        """Begin episodes, with seeds and options if they were set; return observations (N, n)."""
        if self._continues:
            self._continues = False
            self._reset_seeds()
            return self.env.task.observation()
        names = {name for options in self._options for name in options}
        options = {name: [given.get(name) for given in self._options] for name in names}
        observation, info = self.env.reset(seed=list(self._seeds), options=options)
        self.reset_infos = _by_robot(info, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions (N, A) for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Simulate one control period; return observations (N, n), rewards (N,), episode ends (N,)
        and infos.
        """
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        ended = terminated | truncated
        final_info = info.pop("final_info", None)
        final_observation = info.pop("final_obs", None)
        infos = _by_robot(info, self.num_envs)
        if ended.any():
            last = _by_robot(final_info, self.num_envs)
            for row in np.flatnonzero(ended):
                infos[row] = last[row] | {"terminal_observation": final_observation[row]}
        for own, is_cut_off in zip(infos, truncated & ~terminated, strict=True):
            own["TimeLimit.truncated"] = bool(is_cut_off)
        return observation, reward.astype(np.float32), ended, infos

    def close(self) -> None:
        """Free the image buffers."""
        self.env.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Images (H, W, 3), one per robot."""
        return self.env.render()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the vector environment, once per robot."""
        robots = list(self._get_indices(indices))
        return [getattr(self.env, attr_name)] * len(robots)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise InvalidValueError, because the robots in a batch have no attributes of their
        own.
        """
        raise InvalidValueError("attr_name", attr_name, "set on `env`, for all robots")

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of the vector environment once for all robots; return its result once per
        robot.
        """
        robots = list(self._get_indices(indices))
        allowed = "None: robots of a batch have no own methods"
        require(len(robots) == self.num_envs, "indices", indices, allowed)
        result = getattr(self.env, method_name)(*args, **kwargs)
        return [result] * len(robots)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """False for each robot, as no robot is wrapped."""
        return [False] * len(list(self._get_indices(indices)))


class PathTrackingVecEnv(TaskVecEnv):
    """PathTrackingVectorEnv with Stable-Baselines3's interface."""

    kind = PathTrackingVectorEnv


class TraverseVecEnv(TaskVecEnv):
    """TraverseVectorEnv with Stable-Baselines3's interface."""

    kind = TraverseVectorEnv


class Corrections(VecEnvWrapper):  # type: ignore[misc, unused-ignore]
    """Wrapper with corrections to the reference's twist as actions and features as observations;
    see `sim.policy`.
    """

    def __init__(self, robots: PathTrackingVecEnv, authority: tuple[float, float]) -> None:
        """Limit corrections to (v, w) to `authority`, in units of the environment's `twist_scale`
        [-].
        """
        box: Any = robots.observation_space
        low = _features(box.low)
        high = _features(box.high)
        space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        super().__init__(robots, space, robots.action_space)
        self._robots = robots
        self._authority = authority
        self._seen: np.ndarray = np.zeros((robots.num_envs, *box.shape))

    def reset(self) -> np.ndarray:
        """Begin episodes; return features (N, n)."""
        self._seen = self._robots.reset()
        return _features(self._seen)

    def step_async(self, actions: np.ndarray) -> None:
        """Store the corrections (N, 2) in [-1, 1] for `step_wait`."""
        self._robots.step_async(corrected(self._seen, actions, self._authority))

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Simulate one control period; return features (N, n), rewards (N,), episode ends (N,) and
        infos.
        """
        self._seen, reward, ended, infos = self._robots.step_wait()
        for row in np.flatnonzero(ended):
            last = infos[row]["terminal_observation"]
            infos[row]["terminal_observation"] = _features(last)
        return _features(self._seen), reward, ended, infos


def _features(observation: np.ndarray) -> np.ndarray:
    """Features (..., n) as the float32 that Stable-Baselines3 learns from."""
    return features(observation).astype(np.float32)


def _by_robot(info: dict[str, Any], n: int) -> list[dict[str, Any]]:
    """Split infos (N, ...) into one dictionary per robot, without gymnasium's masks."""
    values = {name: each for name, each in info.items() if not name.startswith("_")}
    return [{name: each[row] for name, each in values.items()} for row in range(n)]
