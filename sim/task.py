"""What a learning task offers to environments: its interface, options and spaces."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from numbers import Integral, Real
from pathlib import PurePath
from types import NoneType, UnionType
from typing import Any, Protocol, TypeVar, get_args, get_origin, get_type_hints

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.opengl import TaskRenderer, has_display
from sim.toml_file import build
from trackslip.errors import InvalidValueError, require
from trackslip.kinematics import Array

Floats = NDArray[np.float32]
C = TypeVar("C")
MAX_WEIGHT = 1e6
"""Largest weight in a reward."""
_KINDS: dict[Any, tuple[Any, str]] = {  # of options, by type hint: what values are instances of, in words
    str: (str, "a text"),
    bool: (bool, "true or false"),
    float: (Real, "a number"),
    int: (Integral, "a whole number"),
    tuple: (tuple, "a tuple"),
    dict: (dict, "a dictionary"),
    NoneType: (NoneType, "None"),
}


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


def from_options(configuration: type[C], options: Mapping[str, Any]) -> C:
    """Build the dataclass `configuration` from keyword arguments; lists become tuples, and paths texts.

    Options that are dataclasses may be dictionaries of their fields, as in a specification that was read from JSON.
    Raises TypeError for unknown names, InvalidValueError for values of another type and what the configuration itself
    refuses, SettingsFileError for such dictionaries.
    """
    hints = get_type_hints(configuration)
    known = {f.name: hints[f.name] for f in fields(configuration)}  # type: ignore[arg-type]
    for name in options:
        if name not in known:
            raise TypeError(f"unexpected keyword argument {name!r}: options are {', '.join(known)}")
    built = {name: _built(name, value, known[name]) for name, value in options.items()}
    return configuration(**checked("option", built, known))


def _built(name: str, value: object, hint: Any) -> object:
    """An option, with dictionaries as what its type hint allows: dataclasses, or classes with `from_table`."""
    parts = get_args(hint) if isinstance(hint, UnionType) else (hint,)
    if isinstance(value, list | tuple):
        items = [item for part in parts if get_origin(part) is tuple for item in get_args(part)[:1]]
        return tuple(_built(name, each, items[0]) for each in value) if items else value
    if not isinstance(value, Mapping) or any(get_origin(part) is dict for part in parts):
        return value
    kinds = [kind for part in parts for kind in _dataclasses(part)]
    if len(kinds) != 1:
        kinds = [kind for kind in kinds if {f.name for f in fields(kind)} >= set(value)]
    if not kinds:
        return value
    kind = min(kinds, key=lambda kind: len(fields(kind)))
    return kind.from_table(dict(value), name) if hasattr(kind, "from_table") else build(kind, value, name)


def _dataclasses(kind: Any) -> list[Any]:
    """A type if it is a dataclass, else those of its subclasses that are."""
    if is_dataclass(kind):
        return [kind]
    return [each for subclass in getattr(kind, "__subclasses__", list)() for each in _dataclasses(subclass)]


def checked(field: str, options: object, hints: Mapping[str, Any]) -> dict[str, Any]:
    """Options by name, with lists as tuples, and paths as texts.

    Raises InvalidValueError unless they are a mapping with names among `hints` and values of these types.
    """
    require(isinstance(options, Mapping), field, options, "a dictionary")
    assert isinstance(options, Mapping)
    for name in options:
        require(name in hints, field, name, f"one of {', '.join(hints)}")
    values = {name: _plain(value) for name, value in options.items()}
    for name, value in values.items():
        _require_type(name, value, hints[name])
    return values


def _plain(value: object) -> object:
    return tuple(value) if isinstance(value, list) else str(value) if isinstance(value, PurePath) else value


def _require_type(field: str, value: object, hint: Any) -> None:
    """Raise InvalidValueError unless a value is of a type, or of one of several."""
    parts = get_args(hint) if isinstance(hint, UnionType) else (hint,)
    kinds = [_KINDS.get(get_origin(part) or part, (part, "")) for part in parts]
    valid = any(isinstance(value, kind) for kind, _ in kinds) and (hint is bool or not isinstance(value, bool))
    valid = valid and not (isinstance(value, Integral) and abs(int(value)) > sys.float_info.max)
    require(valid, field, value, " or ".join(words or f"a {kind.__name__}" for kind, words in kinds))
