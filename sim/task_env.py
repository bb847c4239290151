"""Learning tasks as gymnasium environments: what a task is, and the environment of one robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import InvalidValueError, require
from trackslip.kinematics import Array

Floats = NDArray[np.float32]


class Task(Protocol):
    """A task of N robots, one row each."""

    size: int
    """Number of robots."""
    actions: int
    """Number of actions of a robot, each in [-1, 1]."""
    bound: Floats
    """Bounds (n,) of the observations; they lie within -bound and bound."""
    reward: Array
    """Rewards (N,) of the last step."""
    terminated: NDArray[np.bool_]
    """Whether each episode has come to its end (N,)."""
    truncated: NDArray[np.bool_]
    """Whether each episode was cut off (N,)."""

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


class Renderer(Protocol):
    """Draws the robots of a task."""

    def begin(self, rows: Sequence[int]) -> None:
        """Note that episodes of the robots `rows` have begun."""

    def follow(self) -> None:
        """Note that a control period has passed."""

    def picture(self, row: int) -> np.ndarray:
        """Image (480, 640, 3) uint8 of robot `row`."""

    def show(self) -> None:
        """Show robot 0 in a window."""

    def close(self) -> None:
        """Close the window and free the image buffers."""


class TaskEnv(gymnasium.Env[Floats, Floats]):
    """A task of one robot."""

    def __init__(self, task: Task, render_mode: str | None, renderer: Callable[[], Renderer]) -> None:
        """Offer `task`, and draw it with what `renderer` makes if `render_mode` is given."""
        self.render_mode = render_mode
        self.task = task
        """The task of one robot."""
        self.observation_space, self.action_space = spaces(task)
        self._renderer = renderer() if render_mode is not None else None

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


def require_render_mode(mode: str | None) -> None:
    """Raise InvalidValueError for an unknown mode."""
    require(mode in (None, "rgb_array", "human"), "render_mode", mode, 'None, "rgb_array" or "human"')


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
