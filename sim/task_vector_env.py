"""Learning tasks as gymnasium vector environments: N robots in one batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sim.task_env import Renderer, Task, require_render_mode, spaces
from trackslip.errors import InvalidValueError, TrackslipError, require

Observations = NDArray[np.float32]


class TaskVectorEnv(VectorEnv[Observations, Observations, np.ndarray]):
    """A task of N robots.

    Row i is bitwise identical to the environment of one robot with the seed of row i in gymnasium's SyncVectorEnv, with
    the same spaces, autoreset modes and infos.
    """

    def __init__(
        self,
        task: Callable[[], Task],
        num_envs: int,
        render_mode: str | None,
        renderer: Callable[[Any], Renderer],
        autoreset_mode: AutoresetMode | str,
    ) -> None:
        """Offer what `task` makes; see the environments for the other arguments."""
        require_render_mode(render_mode)
        require(render_mode != "human", "render_mode", render_mode, 'None or "rgb_array", for many robots')
        require(num_envs >= 1, "num_envs", num_envs, "at least 1")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.task = task()
        """The task of all robots."""
        self.single_observation_space, self.single_action_space = spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._ended = np.ones(num_envs, bool)  # whether each robot needs a new episode
        self._begun = False
        self._renderer = renderer(self.task) if render_mode is not None else None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin episodes; raises InvalidValueError for unknown options and values out of range.

        Args:
            seed: an integer s seeds row i as reset(seed=s + i) seeds the single environment; or a sequence with one
                seed per robot, None to keep a robot's generator.
            options: `reset_mask`, (N,) bool, resets some robots only; the others are those of the single environment,
                each a value for all robots or a list with one per robot.
        """
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        mask = np.ones(self.num_envs, bool) if mask is None else mask
        valid = isinstance(mask, np.ndarray) and mask.dtype == bool and mask.shape == (self.num_envs,) and mask.any()
        require(valid, "reset_mask", mask, f"an array ({self.num_envs},) of bool, one of them true")
        rows = np.flatnonzero(mask)
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int | np.integer) else seed
        seeds = [None] * self.num_envs if seeds is None else list(seeds)
        require(len(seeds) == self.num_envs, "seed", seeds, f"an integer, or {self.num_envs}")
        for row in rows:
            own = seeds[row]
            if own is not None or self._generators[row] is None:
                self._generators[row] = seeding.np_random(None if own is None else int(own))[0]
        require(self._begun or len(rows) == self.num_envs, "reset_mask", "not all robots", "all, the first time")
        self._begin(rows, options)
        self._begun = True
        return self.task.observation(), self._infos(mask)

    def step(self, actions: Observations) -> tuple[Observations, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Simulate one control period with actions (N, A).

        Raises:
            InvalidValueError: for actions that aren't finite.
            TrackslipError: before the first reset; without autoreset, while a robot needs a new episode.
        """
        if not self._begun:
            raise TrackslipError("step: reset() comes first")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any():
            waiting = np.flatnonzero(self._ended).tolist()
            raise TrackslipError(f"step: robots {waiting} have ended; reset(options={{'reset_mask': ...}}) comes first")
        task = self.task
        task.step(actions)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            # robots that ended in the previous step are reset instead of stepped
            self._begin(np.flatnonzero(self._ended), {})
        if self._renderer is not None:
            self._renderer.follow()
        reward, terminated, truncated = task.reward.copy(), task.terminated.copy(), task.truncated.copy()
        self._ended = terminated | truncated
        last: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            last = self._final(self._ended)
            self._begin(np.flatnonzero(self._ended), {})
        infos = last | self._infos(np.ones(self.num_envs, bool))
        return task.observation(), reward, terminated, truncated, infos

    def render(self) -> tuple[Any, ...]:
        """Images (480, 640, 3), one per robot; raises TrackslipError if nothing can be drawn."""
        if self._renderer is None:
            raise InvalidValueError("render_mode", None, "given to gymnasium.make_vec, to render")
        return tuple(self._renderer.picture(row) for row in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Free the image buffers."""
        if self._renderer is not None:
            self._renderer.close()

    def _begin(self, rows: NDArray[np.int_], options: Mapping[str, Any]) -> None:
        """Begin episodes of the robots `rows` (R,)."""
        for name, value in options.items():
            valid = not isinstance(value, list) or len(value) == self.num_envs
            require(valid, f"options[{name!r}]", value, f"a value, or a list of {self.num_envs}")
        episodes = []
        for row in rows:
            generator = self._generators[row]
            assert generator is not None
            own = {name: value[row] if isinstance(value, list) else value for name, value in options.items()}
            episodes.append(self.task.draw(generator, own))
        self.task.begin(rows.tolist(), episodes)
        self._ended[rows] = False
        if self._renderer is not None:
            self._renderer.begin(rows.tolist())

    def _final(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """`final_obs` and `final_info` of the robots whose episodes have ended (N,)."""
        observation = np.full(self.num_envs, None, dtype=object)
        for row, values in zip(np.flatnonzero(ended), self.task.observation()[ended], strict=True):
            observation[row] = values
        infos = self._infos(ended)
        return {"final_obs": observation, "_final_obs": ended.copy(), "final_info": infos, "_final_info": ended.copy()}

    def _infos(self, whose: NDArray[np.bool_]) -> dict[str, Any]:
        """Infos with masks `whose` (N,); zero, or None, for the other robots."""
        infos: dict[str, Any] = {}
        others = ~whose
        for name, values in self.task.info().items():
            own = values.copy()
            own[others] = None if values.dtype == object else 0
            infos[name], infos[f"_{name}"] = own, whose.copy()
        return infos
