"""Own terms of rewards and observations: functions of a task, by name, with weights or scales.

A function is given as "MODULE:NAME". It takes the task (`sim.path_tracking.tracking.PathTracking` or
`sim.traverse.task.Crossing`) after a step and returns an array (N,), one value for each robot:

    def effort(task):
        return np.abs(task.fleet.drive.torque).sum(axis=1)
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.task import MAX_WEIGHT, Element
from trackslip.errors import InvalidValueError, require, require_positive
from trackslip.kinematics import Array

BOUND = 10.0
"""Largest magnitude of an own element of an observation, in its scale."""


@dataclass(frozen=True, kw_only=True)
class OwnTerms:
    """Options of a task: its own terms."""

    own_rewards: dict[str, float] = field(default_factory=dict)
    """Weights of own terms of the reward, by function MODULE:NAME; see `sim.terms`."""
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
