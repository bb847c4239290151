"""What the control laws share: checked parameters, body-frame errors, laws of the speed, values kept per reference."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import require_positive
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

T = TypeVar("T")
Errors = tuple[Array, Array, Array]
"""Errors (e_x, e_y, e_phi), (...) each [m, m, rad]."""


@dataclass(frozen=True)
class ControlLaw:
    """Base of the controllers: its numbers are positive and, unless overridden, there is nothing to reset."""

    def __post_init__(self) -> None:
        for parameter in fields(self):
            if parameter.type in (float, "float"):
                require_positive(parameter.name, getattr(self, parameter.name))

    def reset(self) -> None:
        """Nothing to reset."""


@dataclass(frozen=True)
class ErrorFeedback(ControlLaw, ABC):
    """A law of the reference's twist and the body-frame error only."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3)."""
        errors = body_errors(pose, reference.pose(time))
        twist = np.empty((*errors.shape[:-1], 2))
        twist[..., 0], twist[..., 1] = self._command(
            reference.twist(time), (errors[..., 0], errors[..., 1], errors[..., 2])
        )
        return twist

    @abstractmethod
    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        """v and w, each (...), from the twist (2,) of the reference and the errors (e_x, e_y, e_phi), (...) each."""


class OncePerReference(Generic[T]):
    """Keeps what was built for the last reference, compared by identity."""

    _kept: tuple[Reference, T] | None = None

    def __call__(self, build: Callable[[Reference], T], reference: Reference) -> T:
        """`build(reference)`, called unless `reference` is that of the last call."""
        if self._kept is None or self._kept[0] is not reference:
            self._kept = (reference, build(reference))
        return self._kept[1]


def natural_frequency(twist: ArrayLike, stiffness: float) -> Array:
    """a = sqrt(w_d^2 + g v_d^2) [rad/s] (...) of reference twists (..., 2), g in [1/m^2]; Eqs. 28-30.

    Gains proportional to it make errors decay over a distance instead of over a time; they vanish at standstill.
    """
    twist = np.asarray(twist, float)
    v, w = twist[..., 0], twist[..., 1]
    return np.sqrt(w**2 + stiffness * v**2)


def speed_to_keep_up(desired: Array, errors: Errors, gain: Array) -> Array:
    """v_d plus k [1/s] times the error along the path [m/s] (...), or 0 if that is opposite to v_d.

    Takes the twist (2,) of the reference and the errors, (...) each. For laws that steer towards a point ahead. They
    are unstable when driven away from that point, so the robot waits for a reference behind it; and they have to keep
    driving to turn around, so the speed must not depend on the heading of the robot. To first order this equals
    v_d cos(e_phi) + k e_x.
    """
    e_x, e_y, e_phi = errors
    direction = np.sign(desired[0])
    return direction * np.maximum(direction * (desired[0] + gain * (np.cos(e_phi) * e_x + np.sin(e_phi) * e_y)), 0.0)
