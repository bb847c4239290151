"""The base class of slip laws, which also computes twists from sprocket speeds, and the law without
slip.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError
from trackslip.kinematics import (
    Array,
    RobotGeometry,
    body_twist,
    curvature,
    sprocket_speeds,
    twist_of_tracks,
)

_EDGE = 1e-9  # distance outside a jump that counts as rounding [half the jump's height]
_CONVERGED = 1e-12  # relative error of the sprocket speeds at which the iteration ends
# limits on the slope in a secant step: change of commanded over change of real direction
_SLOPES = (0.2, 5.0)


class SlipLaw(ABC):
    """Base class of slip laws, which map curvatures (...) [1/m] to slips (..., 2) of the left and
    right track [-].
    """

    records_icr: ClassVar[bool] = False
    """Whether logs of runs with this law record its ICRs, `offset` and `radius_error`."""
    twist_iterations: ClassVar[int] = 12
    """Maximum number of iterations in `twist`. Where a law jumps, some sprocket speeds need all of
    them.
    """

    @abstractmethod
    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...) [1/m]. Infinite curvature means turning in place."""

    def slip(self, twist: ArrayLike) -> Array:
        """Slips (..., 2) at twists (..., 2). Laws that depend on speed override this method."""
        return self(curvature(twist))

    def under(self, load: ArrayLike) -> SlipLaw:
        """The law at tractions per unit load (..., 2) [-]; the same law if it ignores load."""
        del load
        return self

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that produce twists (..., 2) under this law; Eq. 15."""
        return sprocket_speeds(twist, self.slip(twist), geometry)

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """Twists (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce: the inverse of
        `sprocket_speeds`.

        The secant method rotates and scales the real twist, a point in the plane (v, b w), until
        the sprocket speeds for this twist match `omega`. Where a law jumps between left and right
        turns in place, the robot turns in place with intermediate slips. If several solutions
        exist, the result is close to one of them; if none, approximate.
        """
        omega = np.asarray(omega, float)
        in_place, turning = self.turns_in_place(omega, geometry)
        commanded = np.broadcast_to(_without_slip(omega, geometry), in_place.shape)
        real, found = commanded, in_place
        wrong = turned = np.zeros(in_place.shape)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for k in range(self.twist_iterations):
                demanded = self.sprocket_speeds(_of_plane(real, geometry), geometry)
                ratio = commanded / _without_slip(demanded, geometry)
                ratio = np.where(np.isfinite(ratio) & (ratio != 0), ratio, 1.0)
                missed = np.arctan2(ratio.imag, ratio.real)
                turned = missed if k == 0 else missed / _limited((wrong - missed) / turned)
                wrong = missed
                real = np.where(found, real, real * np.abs(ratio) * np.exp(1j * turned))
                # final, as another step might cross a jump
                found = found | (np.abs(ratio - 1) < _CONVERGED)
                if found.all():
                    break
        return _of_plane(np.where(in_place, 1j * turning, real), geometry)

    def effective_half_gauge(self, geometry: RobotGeometry) -> float:
        """Half gauge of tracks without slip that would turn the robot equally [m]: b + D for
        constant ICRs.

        The value comes from turns to both sides with a radius of four half gauges, and is the mean
        for several robots.
        """
        radius = 4 * geometry.half_gauge
        left, right = np.moveaxis(
            self.sprocket_speeds([[[radius, 1.0]], [[radius, -1.0]]], geometry), -1, 0
        )
        return float(np.mean(np.abs((right - left) / (right + left)))) * radius

    def turns_in_place(self, omega: Array, geometry: RobotGeometry) -> tuple[np.ndarray, Array]:
        """Mask (...) of sprocket speeds (..., 2) in the jump between left and right turns in place,
        and b w (...).

        b w is in m/s, and 0 outside the jump. In the jump, the sum of both tracks' slips equals
        that at either end.
        """
        belt = geometry.sprocket_radius * omega
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            slips = self(np.inf)
            inner, outer = slips[..., 0], slips[..., 1]
            turning = (2 - inner - outer) / (1 / belt[..., 1] - 1 / belt[..., 0])
            beyond = (1 - turning / belt[..., 1] - (inner + outer) / 2) / ((outer - inner) / 2)
            inside = (
                (belt[..., 0] * belt[..., 1] < 0) & (outer > inner) & (np.abs(beyond) <= 1 + _EDGE)
            )
        return inside, np.where(inside, turning, 0.0)


@dataclass(frozen=True)
class NoSlip(SlipLaw):
    """The law of ideal tracks without slip."""

    def __call__(self, kappa: ArrayLike) -> Array:
        """Zero slips (..., 2) at curvatures (...)."""
        return np.zeros((*np.shape(kappa), 2))

    def twist(self, omega: ArrayLike, geometry: RobotGeometry) -> Array:
        """Twists (..., 2) that sprocket speeds omega (..., 2) [rad/s] produce; Eqs. 2 and 5."""
        return body_twist(omega, 0.0, geometry)


def _without_slip(omega: Array, geometry: RobotGeometry) -> np.ndarray:
    """Complex v + i b w (...) [m/s] of the twists that sprocket speeds omega (..., 2) would produce
    without slip.
    """
    twist = twist_of_tracks(geometry.sprocket_radius * omega, geometry.half_gauge)
    return np.asarray(twist[..., 0] + 1j * geometry.half_gauge * twist[..., 1])


def _of_plane(plane: np.ndarray, geometry: RobotGeometry) -> Array:
    """Twists (..., 2) from complex v + i b w (...) [m/s]."""
    return np.stack([plane.real, plane.imag / geometry.half_gauge], axis=-1)


def _limited(slope: Array) -> Array:
    """Slopes (...) limited to _SLOPES; 1 for NaN."""
    slope = np.minimum(np.maximum(slope, _SLOPES[0]), _SLOPES[1])
    return np.where(np.isnan(slope), 1.0, slope)


def by_side(kappa: ArrayLike, inner: Array, outer: Array) -> Array:
    """Slips (..., 2) of the (left, right) tracks from inner and outer slips (...); on a straight
    path, their mean.
    """
    side = np.sign(np.asarray(kappa, float))
    mean, half = (inner + outer) / 2, side * (inner - outer) / 2
    return np.stack([mean + half, mean - half], axis=-1)


def require_between(
    law: SlipLaw, names: Iterable[str], low: float, high: float, allowed: str
) -> None:
    """Raise InvalidValueError unless the parameters `names` are above `low` and below `high`."""
    for name in names:
        value = getattr(law, name)
        try:
            array = np.asarray(value, float)
        except (TypeError, ValueError, OverflowError):
            raise InvalidValueError(name, value, allowed) from None
        inside = (array > low) & (array < high)
        if not inside.all():
            raise InvalidValueError(name, array[~inside].flat[0] if array.ndim else value, allowed)
