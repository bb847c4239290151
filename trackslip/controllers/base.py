"""Path-tracking controllers: their protocol, and base classes and helpers for control laws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import require, require_positive
from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference

T = TypeVar("T")


class Controller(Protocol):
    """Converts a pose into the body twist to drive. It does not handle slip: see `SlipLaw` and `compensation`.

    A controller gets the poses of any number of robots at once, so it keeps any state per robot.
    """

    def reset(self) -> None:
        """Discard the state, because a new run begins."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) to drive at `time` [s] from measured poses (..., 3)."""


@runtime_checkable
class SensesSprockets(Protocol):
    """A controller that also uses the sprocket speeds."""

    def sense(self, omega: Array) -> None:
        """Take the sprocket speeds (N, 2) [rad/s] measured over the last period; called before `twist`."""


@dataclass(frozen=True)
class ControlLaw:
    """Base class of controllers. All their numbers must be positive. Without state, there is nothing to reset."""

    def __post_init__(self) -> None:
        for parameter in fields(self):
            if parameter.type in (float, "float"):
                require_positive(parameter.name, getattr(self, parameter.name))

    def reset(self) -> None:
        """Nothing to reset."""


@dataclass(frozen=True)
class Remembering(ControlLaw):
    """Base class of laws with state. The first call after `reset` fixes the number of robots."""

    _kept: dict[str, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def reset(self) -> None:
        """Discard the state; the next call may be for a different number of robots."""
        self._kept.clear()

    def _elapsed(self, time: float, robots: tuple[int, ...]) -> float | None:
        """Time since the last call [s]; None in the first one. Raises InvalidValueError if `robots` has changed."""
        before, last = self._kept.setdefault("robots", robots), self._kept.get("time")
        require(robots == before, "pose", (*robots, 3), f"of shape {(*before, 3)} until reset")
        self._kept["time"] = time
        return None if last is None else max(time - last, 0.0)


class OncePerReference(Generic[T]):
    """Caches a value computed from a reference, for the last reference only; compares references by identity."""

    _kept: tuple[Reference, T] | None = None

    def __call__(self, build: Callable[[Reference], T], reference: Reference) -> T:
        """`build(reference)`, called only if `reference` is not the one from the last call."""
        if self._kept is None or self._kept[0] is not reference:
            self._kept = (reference, build(reference))
        return self._kept[1]


@dataclass(frozen=True, kw_only=True)
class Scheduled(ControlLaw):
    """Base class of laws with a gain 2 xi a, where a = sqrt(w_d^2 + g v_d^2) for the reference twist; Eqs. 28-30.

    Feedback gains proportional to it make errors decay over a distance instead of a time. It is 0 at standstill.
    """

    damping: float = 0.7
    """xi, the damping ratio [-]."""
    stiffness: float = 10.0
    """g, called b in the paper's Eqs. 28-30 [1/m^2]."""

    def speed_gain(self, twist: ArrayLike) -> Array:
        """The gain (...) [1/s] at reference twists (..., 2)."""
        v, w = np.moveaxis(np.asarray(twist, float), -1, 0)
        return np.asarray(2 * self.damping * np.sqrt(w**2 + self.stiffness * v**2))
