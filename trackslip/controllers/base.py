"""Path-tracking controllers: their protocol, and base classes and helpers for control laws."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import ClassVar, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import require, require_positive
from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference

T = TypeVar("T")


@runtime_checkable
class Controller(Protocol):
    """Converts poses into body twists to drive; slip is left to `SlipLaw` and `compensation`.

    A call may be for any number of robots, so a controller with state stores the state of each
    robot separately. Random controllers have a parameter `seed` in `reset`, see `begin_run`.
    """

    def reset(self) -> None:
        """Discard the controller's state before a new run."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Compute the twists (..., 2) to drive at `time` [s] for measured poses (..., 3)."""


@runtime_checkable
class SensesSprockets(Protocol):
    """A controller that also uses the measured sprocket speeds."""

    def sense(self, omega: Array) -> None:
        """Receive the sprocket speeds (N, 2) [rad/s] of the last period, before `twist`."""


def begin_run(controller: Controller, seeds: Sequence[int]) -> None:
    """Reset a controller before a new run of N robots.

    A `reset` with a parameter `seed` gets the seeds (N,), a whole number per robot. A random
    controller that draws each robot's numbers from the robot's own seed drives it equally in any
    fleet.
    """
    if "seed" in inspect.signature(controller.reset).parameters:
        controller.reset(seed=list(seeds))  # type: ignore[call-arg]
    else:
        controller.reset()


@dataclass(frozen=True)
class ControlLaw:
    """Base class of control laws without state. All parameters of type float must be positive."""

    turns_on_the_spot: ClassVar[bool] = True
    """Whether the law turns a robot whose reference turns with v = 0."""

    def __post_init__(self) -> None:
        for parameter in fields(self):
            if parameter.type in (float, "float"):
                require_positive(parameter.name, getattr(self, parameter.name))

    def reset(self) -> None:
        """Do nothing: a law without state needs no reset."""


class Memory(Generic[T]):
    """State that a control law carries from one call to the next, for a fixed number of robots."""

    def __init__(self) -> None:
        self._last_call: tuple[float, tuple[int, ...], T] | None = None

    def reset(self) -> None:
        """Discard the state; the next call may be for a different number of robots."""
        self._last_call = None

    def recall(self, time: float, robots: tuple[int, ...]) -> tuple[float, T] | None:
        """Time from the last call to `time` [s] and the state stored then; None in the first call.

        `robots` is the shape of the poses without their last axis. Raises InvalidValueError if it
        has changed since the last call.
        """
        if self._last_call is None:
            return None
        last_time, expected, state = self._last_call
        require(robots == expected, "pose", (*robots, 3), f"of shape {(*expected, 3)} until reset")
        return max(time - last_time, 0.0), state

    def store(self, time: float, robots: tuple[int, ...], state: T) -> None:
        """Store the state after a call at `time` [s] for `robots`."""
        self._last_call = (time, robots, state)


class OncePerReference(Generic[T]):
    """Cache for a value computed from the latest reference. References are compared by identity."""

    def __init__(self) -> None:
        self._latest: tuple[Reference, T] | None = None

    def __call__(self, build: Callable[[Reference], T], reference: Reference) -> T:
        """Return `build(reference)`, computed anew only if `reference` has changed."""
        if self._latest is None or self._latest[0] is not reference:
            self._latest = (reference, build(reference))
        return self._latest[1]


@dataclass(frozen=True, kw_only=True)
class Scheduled(ControlLaw):
    """Base class of laws with the gain 2 xi a, a = sqrt(w_d^2 + g v_d^2) (Eqs. 28-30).

    (v_d, w_d) is the reference twist. With feedback gains proportional to 2 xi a, errors decay over
    a distance, not a time. The gain is 0 at standstill.
    """

    damping: float = 0.7
    """xi, the damping ratio [-]."""
    stiffness: float = 10.0
    """g, called b in the paper's Eqs. 28-30 [1/m^2]."""

    def speed_gain(self, twist: ArrayLike) -> Array:
        """Gains 2 xi a (...) [1/s] at reference twists (..., 2)."""
        v, w = np.moveaxis(np.asarray(twist, float), -1, 0)
        a = np.sqrt(w**2 + self.stiffness * v**2)
        return np.asarray(2 * self.damping * a)
