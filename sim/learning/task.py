"""Learning tasks: their interface for environments, the elements of their spaces, and the user's
own terms.

The user's own rewards and observations are functions of a task, given as "MODULE:NAME" with a
weight or scale. After a step, such a function gets the task
(`sim.path_tracking.tracking.PathTracking` or `sim.traverse.task.Crossing`) and returns an array
(N,) with one value per robot:

    def effort(task):
        return np.abs(task.fleet.drive.torque).sum(axis=1)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import Checked, InvalidValueError, require, require_positive
from trackslip.inputs import import_own
from trackslip.kinematics import Array
from trackslip.restorable import Restorable

Floats = NDArray[np.float32]
MAX_WEIGHT: Final = 1e6
"""Largest weight in a reward [-]."""
BOUND: Final = 10.0
"""Largest magnitude of a user's own observation element, in units of its scale [-]."""


@dataclass(frozen=True)
class Element:
    """An element of observations or actions: a quantity divided by its scale and clipped."""

    name: str
    """Name of the quantity."""
    unit: str
    """Unit of the quantity, "-" if none."""
    scale: float
    """Value of the quantity, in `unit`, at which the element is 1."""
    bound: float = 1.0
    """Largest magnitude of the element [-]."""


@dataclass(frozen=True, kw_only=True)
class OwnTerms(Checked):
    """A task's options for the user's own terms."""

    own_rewards: dict[str, float] = field(default_factory=dict)
    """Weights of the user's own reward terms, by function MODULE:NAME; see `sim.learning.task`."""
    own_observations: dict[str, float] = field(default_factory=dict)
    """Scales of the user's own elements, which end the observation, by function."""
    privileged: dict[str, float] = field(default_factory=dict)
    """Scales of elements that only a critic sees, by function; their values are in
    info["privileged"].
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        scales = self.own_observations | self.privileged
        for name, number in (*self.own_rewards.items(), *scales.items()):
            function(name)
            valid = isinstance(number, int | float) and abs(number) <= MAX_WEIGHT
            require(valid, name, number, f"a number up to {MAX_WEIGHT:g}")
        for name, scale in scales.items():
            require_positive(name, scale)


def function(name: str) -> Callable[[Any], Any]:
    """Import the function MODULE:NAME; raises InvalidValueError if it doesn't exist."""
    module, _, attribute = name.partition(":")
    try:
        chosen = getattr(import_own(module), attribute)
    except (Exception, SystemExit) as error:  # anything from a user's module
        raise InvalidValueError(
            "function", name, f"MODULE:NAME ({type(error).__name__}: {error})"
        ) from error
    require(callable(chosen), "function", name, "MODULE:NAME of a function of a task")
    return chosen


class Task(Restorable, ABC):
    """A task for N robots, one row each, without an environment's interface. Rows are bitwise
    independent.

    Users step a task, and its episodes end one by one, so `sim.runs.loop` can't run it.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_action", "_terms", "reward", "terminated", "truncated")

    def __init__(
        self,
        config: Any,
        size: int,
        period: float,
        observed: tuple[Element, ...],
        commanded: tuple[Element, ...],
    ) -> None:
        """Set up a task with observed elements `observed`, followed by the user's own; see the
        attributes.
        """
        self.config = config
        """The options, with `reward` and `OwnTerms`."""
        self.size = size
        """Number of robots."""
        self.period = period
        """Control period [s]."""
        own = (Element(name, "", scale, BOUND) for name, scale in config.own_observations.items())
        self.observed = (*observed, *own)
        """The n elements of an observation."""
        self.commanded = commanded
        """The A elements of an action, each in [-1, 1]."""
        names = (*config.own_rewards, *config.own_observations, *config.privileged)
        self._functions = {name: function(name) for name in names}
        terms = (*config.reward.TERMS, *config.own_rewards)
        self._rewards = tuple(f"reward_{term}" for term in terms)
        self._terms: Array = np.zeros((len(self._rewards), size))
        self._action: Array = np.zeros((size, len(commanded)))
        self.reward: Array = np.zeros(size)
        """Rewards (N,) of the last step."""
        self.terminated: NDArray[np.bool_] = np.zeros(size, bool)
        """Mask (N,) of episodes that have terminated."""
        self.truncated: NDArray[np.bool_] = np.zeros(size, bool)
        """Mask (N,) of episodes that have been truncated."""

    @abstractmethod
    def draw(self, generator: np.random.Generator, options: Mapping[str, Any]) -> Any:
        """Draw an episode for a robot from the robot's own generator; `options` replace drawn
        values.
        """

    @abstractmethod
    def begin(self, rows: Sequence[int], episodes: Sequence[Any]) -> None:
        """Begin an episode with each of the robots `rows` (R,)."""

    @abstractmethod
    def step(self, actions: ArrayLike) -> None:
        """Simulate one control period with actions (N, A), clipped to [-1, 1].

        Raises InvalidValueError for actions that aren't finite or have a wrong shape.
        """

    @abstractmethod
    def _observed(self) -> Floats:
        """Observations (N, n') without the user's own elements."""

    @abstractmethod
    def _quantities(self) -> dict[str, NDArray[Any]]:
        """Quantities for `info`, without rewards and privileged elements."""

    def observation(self) -> Floats:
        """Observations (N, n), float32."""
        own = self._scaled(self.config.own_observations)
        return np.concatenate([self._observed(), own], axis=1)

    def info(self) -> dict[str, NDArray[Any]]:
        """Further quantities (N, ...) by name, some of them the task's own arrays; the names are
        always the same.
        """
        info = self._quantities() | dict(zip(self._rewards, self._terms, strict=True))
        if self.config.privileged:
            info["privileged"] = self._scaled(self.config.privileged)
        return info

    def _clear(self, rows: NDArray[np.int_], *states: NDArray[Any]) -> None:
        """Zero the state of the robots `rows` (R,), and their rows in additional `states` (N,
        ...).
        """
        own = (self._action, self.reward, self.terminated, self.truncated, *self._terms)
        for state in (*own, *states):
            state[rows] = 0

    def _clipped(self, actions: ArrayLike) -> tuple[Array, Array]:
        """Clip actions (N, A) to [-1, 1] and store them; return them and their change since the
        last actions.
        """
        shape = self._action.shape
        try:
            action = np.asarray(actions, float)
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidValueError("action", actions, "an array of finite numbers") from error
        given = f"an array of shape {action.shape}"
        require(action.shape == shape, "action", given, f"of shape {shape}")
        is_finite = np.isfinite(action)
        if np.count_nonzero(is_finite) < action.size:
            row = int(np.flatnonzero(~is_finite.all(axis=1))[0])
            raise InvalidValueError("action", action[row].tolist(), f"finite (robot {row})")
        before = self._action
        self._action = np.minimum(np.maximum(action, -1.0), 1.0)
        return self._action, self._action - before

    def _earn(self, terms: Iterable[Array], running: NDArray[np.bool_] | bool = True) -> None:
        """Set rewards from `terms` (N,) and the user's own terms, which are 0 for robots that
        aren't `running`.
        """
        every = list(terms)
        for name, weight in self.config.own_rewards.items():
            every.append(np.where(running, weight * self._values(name), 0.0))
        self._terms = np.array(every)
        # added in order: bitwise identical for any number of robots
        self.reward = np.add.accumulate(self._terms)[-1]

    def _scaled(self, scales: Mapping[str, float]) -> Floats:
        """The user's own elements (N, k), scaled and clipped."""
        elements = np.empty((self.size, len(scales)), np.float32)
        for k, (name, scale) in enumerate(scales.items()):
            elements[:, k] = np.clip(self._values(name) / scale, -BOUND, BOUND)
        return elements

    def _values(self, name: str) -> Array:
        """Values (N,) of a function; raises InvalidValueError unless it returns one finite number
        per robot.
        """
        values = np.asarray(self._functions[name](self), float)
        shape = (self.size,)
        given = f"an array of shape {values.shape}"
        require(values.shape == shape, name, given, f"of shape {shape}")
        is_finite = np.isfinite(values)
        require(bool(is_finite.all()), name, values[~is_finite][:1].tolist(), "finite")
        return values
