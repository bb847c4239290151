"""What a learning task offers to environments: its interface, options and spaces."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.opengl import TaskRenderer, has_display
from trackslip.errors import InvalidValueError, require
from trackslip.kinematics import Array

Floats = NDArray[np.float32]
MAX_WEIGHT = 1e6
"""Largest weight in a reward."""


@dataclass(frozen=True)
class Element:
    """An element of observations or actions, which is a quantity divided by its scale, and clipped."""

    name: str
    """The quantity."""
    unit: str
    """Its unit, "-" for none."""
    scale: float
    """The quantity's value at which the element is 1, in its unit."""
    bound: float = 1.0
    """Largest magnitude of the element."""


class Task(Protocol):
    """A task of N robots, one row each."""

    config: Any
    """The options."""
    size: int
    """Number of robots."""
    threads: int
    """Number of worker threads, 0 for one per processor."""
    period: float
    """Control period [s]."""
    observed: tuple[Element, ...]
    """Elements (n) of an observation."""
    commanded: tuple[Element, ...]
    """Elements (A) of an action, each in [-1, 1]."""
    reward: Array
    """Rewards (N,) of the last step."""
    terminated: NDArray[np.bool_]
    """Mask (N,) of the episodes that have ended."""
    truncated: NDArray[np.bool_]
    """Mask (N,) of the episodes that were cut off."""

    def get_state(self) -> dict[str, Any]:
        """A copy of the state, by name."""

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a state."""

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


def numeric(actions: ArrayLike) -> Array:
    """Actions as an array; raises InvalidValueError unless they are numbers."""
    try:
        return np.asarray(actions, float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidValueError("action", actions, "an array of finite numbers") from error


def clipped_actions(actions: ArrayLike, size: int, count: int) -> Array:
    """Actions (N, A) in [-1, 1]; raises InvalidValueError unless they are finite numbers, and of this shape."""
    action = numeric(actions)
    require(action.shape == (size, count), "action", f"an array of shape {action.shape}", f"of shape {(size, count)}")
    if np.count_nonzero(np.isfinite(action)) < action.size:
        row = int(np.flatnonzero(~np.isfinite(action).all(axis=1))[0])
        raise InvalidValueError("action", action[row].tolist(), f"finite (robot {row})")
    return np.minimum(np.maximum(action, -1.0), 1.0)


def metadata(period: float) -> dict[str, Any]:
    """gymnasium's metadata of an environment with a control period [s]."""
    return {"render_modes": ["rgb_array", "human"], "render_fps": round(1 / period)}


def metadata_here(task: Task) -> dict[str, Any]:
    """gymnasium's metadata of an environment on this machine: windows need a display."""
    modes = ["rgb_array", "human"] if has_display() else ["rgb_array"]
    return metadata(task.period) | {"render_modes": modes}


def spaces(task: Task) -> tuple[Any, Any]:
    """Observation space and action space of one robot."""
    observed, commanded = (
        np.array([e.bound for e in elements], np.float32) for elements in (task.observed, task.commanded)
    )
    return gymnasium.spaces.Box(-observed, observed), gymnasium.spaces.Box(-commanded, commanded)


def row_of(info: dict[str, Any]) -> dict[str, Any]:
    """Entries of `info` for robot 0: numbers, texts and arrays."""
    return {name: values[0].copy() if values.ndim > 1 else values.item() for name, values in info.items()}
