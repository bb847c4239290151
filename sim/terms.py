"""Own terms of rewards and observations: functions of a task, by name, with weights or scales.

A function is given as "MODULE:NAME". It takes the task (`sim.path_tracking.tracking.PathTracking` or
`sim.traverse.task.Crossing`) after a step and returns an array (N,), one value for each robot:

    def effort(task):
        return np.abs(task.fleet.drive.torque).sum(axis=1)
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.task import MAX_WEIGHT, Element
from trackslip.errors import InvalidValueError, require, require_positive
from trackslip.kinematics import Array

BOUND = 10.0
"""Largest magnitude of an own element of an observation, in its scale."""


def require_terms(rewards: Mapping[str, float], scales: Mapping[str, float]) -> None:
    """Raise InvalidValueError unless these are functions with finite weights, and with positive scales."""
    for name, weight in (*rewards.items(), *scales.items()):
        function(name)
        valid = isinstance(weight, int | float) and abs(weight) <= MAX_WEIGHT
        require(valid, name, weight, f"a number up to {MAX_WEIGHT:g}")
    for name, scale in scales.items():
        require_positive(name, scale)


def function(name: str) -> Callable[[Any], Any]:
    """The function MODULE:NAME; raises InvalidValueError if there is none."""
    module, _, attribute = name.partition(":")
    try:
        chosen = getattr(importlib.import_module(module), attribute)
    except Exception as error:  # whatever a user's module raises
        raise InvalidValueError("function", name, f"MODULE:NAME ({type(error).__name__}: {error})") from error
    require(callable(chosen), "function", name, "MODULE:NAME of a function of a task")
    return chosen


def values(name: str, task: Any) -> Array:
    """Values (N,) of a function; raises InvalidValueError unless they are finite numbers, one for each robot."""
    given = np.asarray(function(name)(task), float)
    require(given.shape == (task.size,), name, f"an array of shape {given.shape}", f"of shape {(task.size,)}")
    require(bool(np.isfinite(given).all()), name, given[~np.isfinite(given)][:1].tolist(), "finite")
    return given


def weighted(task: Any, weights: Mapping[str, float]) -> dict[str, Array]:
    """Terms (N,) of the reward, by function."""
    return {name: weight * values(name, task) for name, weight in weights.items()}


def scaled(task: Any, scales: Mapping[str, float]) -> NDArray[np.float32]:
    """Values (N, k) over their scales, bounded."""
    columns = [np.clip(values(name, task) / scale, -BOUND, BOUND) for name, scale in scales.items()]
    return np.column_stack([np.empty((task.size, 0)), *columns]).astype(np.float32)


def elements(scales: Mapping[str, float]) -> tuple[Element, ...]:
    """What `scaled` has in its columns."""
    return tuple(Element(name, "", scale, BOUND) for name, scale in scales.items())
