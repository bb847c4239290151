"""Learning tasks as gymnasium environments: of one robot, and of N robots in one batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Protocol, TypeVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from sim.opengl import TaskRenderer
from trackslip.errors import InvalidValueError, TrackslipError, require
from trackslip.kinematics import Array

Floats = NDArray[np.float32]
C = TypeVar("C")


class Task(Protocol):
    """A task of N robots, one row each."""

    size: int
    """Number of robots."""
    actions: int
    """Number of actions of a robot, each in [-1, 1]."""
    bound: Floats
    """Bounds (n,) of the observations' magnitudes."""
    reward: Array
    """Rewards (N,) of the last step."""
    terminated: NDArray[np.bool_]
    """Mask (N,) of the episodes that have ended."""
    truncated: NDArray[np.bool_]
    """Mask (N,) of the episodes that were cut off."""

    def draw(self, generator: np.random.Generator, options: Mapping[str, Any]) -> Any:
        """Draw a robot's episode from its own generator; `options` replace drawn values."""

    def begin(self, rows: Sequence[int], episodes: Sequence[Any]) -> None:
        """Begin episodes with the robots `rows` (R,), one each."""

    def step(self, actions: ArrayLike) -> None:
        """Simulate one control period with actions (N, A)."""

    def observation(self) -> Any:
        """Observations (N, n), float32."""

    def info(self) -> dict[str, NDArray[Any]]:
        """Further quantities by name, as arrays (N, ...), which may be the task's own; the keys are always the same."""


@dataclass(frozen=True)
class TaskKind:
    """Classes from which a task's environments are built."""

    configuration: type
    """Dataclass of the task's options."""
    task: Callable[[Any, int, int], Any]
    """Makes a Task from a configuration, the number of robots and the number of threads."""
    renderer: Callable[[Any], TaskRenderer]
    """Makes what draws a task."""


class TaskEnv(gymnasium.Env[Floats, Floats]):
    """A task of one robot."""

    kind: ClassVar[TaskKind]

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        """Build the simulator; `render_mode` is None, "rgb_array" or "human", `options` are the configuration's fields.

        Raises InvalidValueError for options that are unknown or out of range.
        """
        allowed = 'None, "rgb_array" or "human"'
        require(render_mode in (None, "rgb_array", "human"), "render_mode", render_mode, allowed)
        self.render_mode = render_mode
        self.task = self.kind.task(from_options(self.kind.configuration, options), 1, 1)
        """The task of one robot."""
        self.observation_space, self.action_space = spaces(self.task)
        self._renderer = self.kind.renderer(self.task) if render_mode is not None else None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode, drawn from a generator with this seed, or from the current one if it is None.

        `options` replace drawn values, see the task's `draw`. Raises InvalidValueError for unknown options and values
        out of range.
        """
        super().reset(seed=seed)
        self.task.begin([0], [self.task.draw(self.np_random, options or {})])
        if self._renderer is not None:
            self._renderer.begin([0])
            self._show()
        return self.task.observation()[0], row_of(self.task.info())

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Simulate one control period; raises InvalidValueError for an action that isn't finite."""
        task = self.task
        task.step(np.asarray(action, float)[None])
        if self._renderer is not None:
            self._renderer.follow()
            self._show()
        ends = bool(task.terminated[0]), bool(task.truncated[0])
        return task.observation()[0], float(task.reward[0]), *ends, row_of(task.info())

    def render(self) -> Any:
        """Image (480, 640, 3), or None for "human", which updates the window; raises TrackslipError if it fails."""
        if self._renderer is None:
            raise InvalidValueError("render_mode", None, "given to gymnasium.make, to render")
        return self._renderer.picture(0) if self.render_mode == "rgb_array" else self._show()

    def _show(self) -> None:
        if self._renderer is not None and self.render_mode == "human":
            self._renderer.show()

    def close(self) -> None:
        """Close the window."""
        if self._renderer is not None:
            self._renderer.close()


class TaskVectorEnv(VectorEnv[Floats, Floats, np.ndarray]):
    """A task of N robots.

    Row i is bitwise identical to the environment of one robot with the seed of row i in gymnasium's SyncVectorEnv, with
    the same spaces, autoreset modes and infos.
    """

    kind: ClassVar[TaskKind]

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        **options: Any,
    ) -> None:
        """Build the simulator of `num_envs` robots on `threads` worker threads, 0 for one per processor.

        `render_mode` is None or "rgb_array", `autoreset_mode` gymnasium's, `options` are the configuration's fields.
        Raises InvalidValueError for options that are unknown or out of range.
        """
        require(render_mode in (None, "rgb_array"), "render_mode", render_mode, 'None or "rgb_array", for many robots')
        require(num_envs >= 1, "num_envs", num_envs, "at least 1")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.task = self.kind.task(from_options(self.kind.configuration, options), num_envs, threads)
        """The task of all robots."""
        self.single_observation_space, self.single_action_space = spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._ended = np.ones(num_envs, bool)  # whether each robot needs a new episode
        self._begun = False
        self._renderer = self.kind.renderer(self.task) if render_mode is not None else None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin episodes; raises InvalidValueError for unknown options and values out of range.

        Args:
            seed: an integer s seeds row i as reset(seed=s + i) seeds the single environment; or a sequence with one
                seed per robot, None to keep a robot's generator.
            options: `reset_mask`, (N,) bool, resets some robots only; the others are those of the single environment,
                each a value for all robots or a list with one per robot.
        """
        options = dict(options or {})
        mask = options.pop("reset_mask", np.ones(self.num_envs, bool))
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

    def step(self, actions: Floats) -> tuple[Floats, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
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


def clipped_actions(actions: ArrayLike, size: int, count: int) -> Array:
    """Actions (N, A) in [-1, 1]; raises InvalidValueError unless they are finite, and of this shape."""
    action = np.asarray(actions, float)
    require(action.shape == (size, count), "action", f"an array of shape {action.shape}", f"of shape {(size, count)}")
    if np.count_nonzero(np.isfinite(action)) < action.size:
        row = int(np.flatnonzero(~np.isfinite(action).all(axis=1))[0])
        raise InvalidValueError("action", action[row].tolist(), f"finite (robot {row})")
    return np.minimum(np.maximum(action, -1.0), 1.0)


def metadata(period: float) -> dict[str, Any]:
    """gymnasium's metadata of an environment with a control period [s]."""
    return {"render_modes": ["rgb_array", "human"], "render_fps": round(1 / period)}


def spaces(task: Task) -> tuple[Any, Any]:
    """Observation space and action space of one robot."""
    observations = gymnasium.spaces.Box(-task.bound, task.bound, dtype=np.float32)
    return observations, gymnasium.spaces.Box(-1.0, 1.0, (task.actions,), np.float32)


def row_of(info: dict[str, Any]) -> dict[str, Any]:
    """Entries of `info` for robot 0: numbers, texts and arrays."""
    return {name: values[0].copy() if values.ndim > 1 else values.item() for name, values in info.items()}


def from_options(configuration: type[C], options: Mapping[str, Any]) -> C:
    """Build the dataclass `configuration` from keyword arguments; lists become tuples.

    Raises InvalidValueError for unknown names, and what the configuration itself refuses.
    """
    known = [f.name for f in fields(configuration)]  # type: ignore[arg-type]
    for name in options:
        require(name in known, "option", name, f"one of {', '.join(known)}")
    return configuration(**{n: tuple(value) if isinstance(value, list) else value for n, value in options.items()})
