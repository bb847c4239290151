"""What a learning task offers to environments: its interface, its spaces, and the user's own terms.

Own terms of rewards and observations are functions of a task, given as "MODULE:NAME", with weights or scales. They take
the task (`sim.path_tracking.tracking.PathTracking` or `sim.traverse.task.Crossing`) after a step and return an array
(N,), one value for each robot:

    def effort(task):
        return np.abs(task.fleet.drive.torque).sum(axis=1)
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.opengl import TaskRenderer, has_display
from trackslip.errors import InvalidValueError, require, require_positive
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


BOUND = 10.0
"""Largest magnitude of an own element of an observation, in its scale."""


@dataclass(frozen=True, kw_only=True)
class OwnTerms:
    """Options of a task: its own terms."""

    own_rewards: dict[str, float] = field(default_factory=dict)
    """Weights of own terms of the reward, by function MODULE:NAME; see `sim.task`."""
    own_observations: dict[str, float] = field(default_factory=dict)
    """Scales of own elements at the end of the observation, by function."""
    privileged: dict[str, float] = field(default_factory=dict)
    """Scales of what only critics shall see, by function: info["privileged"]."""

    def __post_init__(self) -> None:
        scales = self.own_observations | self.privileged
        for name, weight in (*self.own_rewards.items(), *scales.items()):
            function(name)
            valid = isinstance(weight, int | float) and abs(weight) <= MAX_WEIGHT
            require(valid, name, weight, f"a number up to {MAX_WEIGHT:g}")
        for name, scale in scales.items():
            require_positive(name, scale)

    @property
    def own_elements(self) -> tuple[Element, ...]:
        """Own elements of an observation."""
        return tuple(Element(name, "", scale, BOUND) for name, scale in self.own_observations.items())


class Terms:
    """The own terms of a task, whose functions are looked up once."""

    def __init__(self, options: OwnTerms) -> None:
        self._options = options
        names = (*options.own_rewards, *options.own_observations, *options.privileged)
        self._functions = {name: function(name) for name in names}

    def rewards(self, task: Any) -> dict[str, Array]:
        """Weighted terms (N,) of the reward, by function."""
        return {name: weight * self._values(name, task) for name, weight in self._options.own_rewards.items()}

    def observed(self, task: Any) -> NDArray[np.float32]:
        """Own elements (N, k) of the observation, bounded."""
        return self._scaled(task, self._options.own_observations)

    def info(self, task: Any) -> dict[str, NDArray[np.float32]]:
        """Elements (N, k) that only critics shall see, as `privileged`, if there are any."""
        privileged = self._options.privileged
        return {"privileged": self._scaled(task, privileged)} if privileged else {}

    def _scaled(self, task: Any, scales: Mapping[str, float]) -> NDArray[np.float32]:
        columns = [np.clip(self._values(name, task) / scale, -BOUND, BOUND) for name, scale in scales.items()]
        return np.column_stack([np.empty((task.size, 0)), *columns]).astype(np.float32)

    def _values(self, name: str, task: Any) -> Array:
        """Values (N,) of a function; raises InvalidValueError unless they are finite numbers, one for each robot."""
        given = np.asarray(self._functions[name](task), float)
        require(given.shape == (task.size,), name, f"an array of shape {given.shape}", f"of shape {(task.size,)}")
        require(bool(np.isfinite(given).all()), name, given[~np.isfinite(given)][:1].tolist(), "finite")
        return given


def function(name: str) -> Callable[[Any], Any]:
    """The function MODULE:NAME; raises InvalidValueError if there is none."""
    module, _, attribute = name.partition(":")
    try:
        chosen = getattr(importlib.import_module(module), attribute)
    except Exception as error:  # whatever a user's module raises
        raise InvalidValueError("function", name, f"MODULE:NAME ({type(error).__name__}: {error})") from error
    require(callable(chosen), "function", name, "MODULE:NAME of a function of a task")
    return chosen
