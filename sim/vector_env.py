"""The vector environment trackslip/PathTracking-v0: path tracking of N robots in one batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sim.env import METADATA, require_render_mode, spaces
from sim.path_tracking.config import EnvConfig
from sim.path_tracking.renderer import Renderer
from sim.path_tracking.tracking import PathTracking
from trackslip.errors import InvalidValueError, TrackslipError, require

Observations = NDArray[np.float32]
Rows = NDArray[np.int_]


class PathTrackingVectorEnv(VectorEnv[Observations, Observations, np.ndarray]):
    """N robots, each with its own ground and reference.

    Row i is bitwise identical to the environment `sim.env.PathTrackingEnv` with the seed of row i in gymnasium's
    SyncVectorEnv, with the same spaces, autoreset modes and infos.
    """

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        **options: Any,
    ) -> None:
        """Build the simulator of `num_envs` robots on `threads` worker threads, 0 for one per processor.

        `render_mode` is None or "rgb_array", `autoreset_mode` gymnasium's, `options` are the fields of `EnvConfig`.
        Raises InvalidValueError for options that are unknown or out of range.
        """
        require_render_mode(render_mode)
        require(render_mode != "human", "render_mode", render_mode, 'None or "rgb_array", for many robots')
        require(num_envs >= 1, "num_envs", num_envs, "at least 1")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**METADATA, "autoreset_mode": self.autoreset_mode}
        self.tracking = PathTracking(EnvConfig.of(options), num_envs, threads)
        self.single_observation_space, self.single_action_space = spaces(self.tracking)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._ended = np.ones(num_envs, bool)  # whether each robot needs a new episode
        self._begun = False
        self._renderer = Renderer(self.tracking) if render_mode is not None else None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin episodes.

        Args:
            seed: an integer s seeds row i as reset(seed=s + i) seeds the single environment; or a sequence with one
                seed per robot, None to keep a robot's generator.
            options: `reset_mask`, (N,) bool, resets some robots only; the others are those of the single environment,
                each a value for all robots or a list with one per robot.

        Raises:
            InvalidValueError: for unknown options and values out of range.
        """
        options = dict(options or {})
        rows = self._masked(options.pop("reset_mask", None))
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int | np.integer) else seed
        seeds = [None] * self.num_envs if seeds is None else list(seeds)
        require(len(seeds) == self.num_envs, "seed", seeds, f"an integer, or {self.num_envs}")
        for row in rows:
            if seeds[row] is not None or self._generators[row] is None:
                self._generators[row] = seeding.np_random(None if seeds[row] is None else int(seeds[row]))[0]
        require(self._begun or len(rows) == self.num_envs, "reset_mask", "not all robots", "all, the first time")
        self._begin(rows, options)
        self._begun = True
        return self.tracking.observation(), self._infos(np.isin(np.arange(self.num_envs), rows))

    def step(self, actions: Observations) -> tuple[Observations, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Simulate one control period with actions (N, 2).

        Raises:
            InvalidValueError: for actions that aren't finite.
            TrackslipError: before the first reset; without autoreset, while a robot needs a new episode.
        """
        if not self._begun:
            raise TrackslipError("step: reset() comes first")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any():
            waiting = np.flatnonzero(self._ended).tolist()
            raise TrackslipError(f"step: robots {waiting} have ended; reset(options={{'reset_mask': ...}}) comes first")
        tracking = self.tracking
        tracking.step(actions)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            # robots that ended in the previous step are reset instead of stepped
            self._begin(np.flatnonzero(self._ended), {})
        if self._renderer is not None:
            self._renderer.follow()
        reward, terminated, truncated = tracking.reward.copy(), tracking.terminated.copy(), tracking.truncated.copy()
        self._ended = terminated | truncated
        last: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            last = self._final(self._ended)
            self._begin(np.flatnonzero(self._ended), {})
        infos = last | self._infos(np.ones(self.num_envs, bool))
        return tracking.observation(), reward, terminated, truncated, infos

    def render(self) -> tuple[Any, ...]:
        """Images (480, 640, 3), one per robot; raises TrackslipError if nothing can be drawn."""
        if self._renderer is None:
            raise InvalidValueError("render_mode", None, "given to gymnasium.make_vec, to render")
        return tuple(self._renderer.picture(row) for row in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Free the image buffers."""
        if self._renderer is not None:
            self._renderer.close()

    def _masked(self, mask: Any) -> Rows:
        """Rows (R,) of a mask (N,)."""
        if mask is None:
            return np.arange(self.num_envs)
        valid = isinstance(mask, np.ndarray) and mask.dtype == bool and mask.shape == (self.num_envs,) and mask.any()
        require(valid, "reset_mask", mask, f"an array ({self.num_envs},) of bool, one of them true")
        return np.flatnonzero(mask)

    def _begin(self, rows: Rows, options: Mapping[str, Any]) -> None:
        """Begin episodes of the robots `rows` (R,)."""
        for name, value in options.items():
            valid = not isinstance(value, list) or len(value) == self.num_envs
            require(valid, f"options[{name!r}]", value, f"a value, or a list of {self.num_envs}")
        episodes = []
        for row in rows:
            generator = self._generators[row]
            assert generator is not None
            own = {name: value[row] if isinstance(value, list) else value for name, value in options.items()}
            episodes.append(self.tracking.draw(generator, own))
        self.tracking.begin(rows.tolist(), episodes)
        self._ended[rows] = False
        if self._renderer is not None:
            self._renderer.begin(rows.tolist())

    def _final(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """`final_obs` and `final_info` of the robots whose episodes have ended (N,)."""
        observation = np.full(self.num_envs, None, dtype=object)
        for row, values in zip(np.flatnonzero(ended), self.tracking.observation()[ended], strict=True):
            observation[row] = values
        infos = self._infos(ended)
        return {"final_obs": observation, "_final_obs": ended.copy(), "final_info": infos, "_final_info": ended.copy()}

    def _infos(self, whose: NDArray[np.bool_]) -> dict[str, Any]:
        """Infos with masks `whose` (N,); zero for the other robots."""
        infos: dict[str, Any] = {}
        for name, values in self.tracking.info().items():
            values[~whose] = 0
            infos[name], infos[f"_{name}"] = values, whose.copy()
        return infos
