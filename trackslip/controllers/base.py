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
    """A controller converts poses into body twists to drive. Slip is handled by `SlipLaw` and
    `compensation`.

    A call may be for any number of robots, so a controller with state stores the state of each
    robot separately.
    """

    def reset(self) -> None:
        """Discard the controller's state before a new run."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Compute the twists (..., 2) to drive at `time` [s] for robots measured at poses (...,
        3).
        """


@runtime_checkable
class SensesSprockets(Protocol):
    """A controller that also uses the measured sprocket speeds."""

    def sense(self, omega: Array) -> None:
        """Pass the sprocket speeds (N, 2) [rad/s] measured over the last period to the controller,
        before `twist`.
        """


@dataclass(frozen=True)
class ControlLaw:
    """Base class of control laws without state. All parameters of type float must be positive."""

    def __post_init__(self) -> None:
        for parameter in fields(self):
            if parameter.type in (float, "float"):
                require_positive(parameter.name, getattr(self, parameter.name))

    def reset(self) -> None:
        """Do nothing: a law without state needs no reset."""


@dataclass(frozen=True)
class Remembering(ControlLaw):
    """Base class of control laws with state. The first call after `reset` fixes the number of
    robots.
    """

    _kept: dict[str, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def reset(self) -> None:
        """Discard the state; the next call may be for a different number of robots."""
        self._kept.clear()

    def _elapsed(self, time: float, robots: tuple[int, ...]) -> float | None:
        """Time since the last call [s], None in the first call. Raises InvalidValueError if
        `robots` has changed.
        """
        before, last = self._kept.setdefault("robots", robots), self._kept.get("time")
        require(robots == before, "pose", (*robots, 3), f"of shape {(*before, 3)} until reset")
        self._kept["time"] = time
        return None if last is None else max(time - last, 0.0)


class OncePerReference(Generic[T]):
    """Cache for a value computed from the latest reference. References are compared by identity."""

    _kept: tuple[Reference, T] | None = None

    def __call__(self, build: Callable[[Reference], T], reference: Reference) -> T:
        """Return `build(reference)`, computed anew only if `reference` differs from that of the
        last call.
        """
        if self._kept is None or self._kept[0] is not reference:
            self._kept = (reference, build(reference))
        return self._kept[1]


@dataclass(frozen=True, kw_only=True)
class Scheduled(ControlLaw):
    """Base class of laws with the gain 2 xi a, where a = sqrt(w_d^2 + g v_d^2) for the reference
    twist (Eqs. 28-30).

    With feedback gains proportional to 2 xi a, errors decay over a distance, not a time. The gain
    is 0 at standstill.
    """

    damping: float = 0.7
    """xi, the damping ratio [-]."""
    stiffness: float = 10.0
    """g, called b in the paper's Eqs. 28-30 [1/m^2]."""

    def speed_gain(self, twist: ArrayLike) -> Array:
        """Gains 2 xi a (...) [1/s] at reference twists (..., 2)."""
        v, w = np.moveaxis(np.asarray(twist, float), -1, 0)
        return np.asarray(2 * self.damping * np.sqrt(w**2 + self.stiffness * v**2))
