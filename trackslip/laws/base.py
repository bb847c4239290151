"""The base class of slip laws, which also computes twists from sprocket speeds, and the law without
slip.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip.arguments import checks_arguments
from trackslip.errors import InvalidValueError
from trackslip.kinematics import (
    Array,
    RobotGeometry,
    body_twist,
    curvature,
    sprocket_speeds,
    twist_of_tracks,
)
from trackslip.viewable import Viewable

TURNING_LAWS: Final = "none, online, or a law that isn't exponential, such as icr_radius"
"""Compensations whose laws hold in turns on the spot."""
# distance outside a jump that counts as rounding [half the jump's height]
_JUMP_ROUNDING: Final = 1e-9
# relative error of the sprocket speeds at which the iteration ends
_CONVERGED: Final = 1e-12
# limits on the slope in a secant step: change of commanded over change of real direction
_SLOPES: Final = (0.2, 5.0)


@checks_arguments
class SlipLaw(Viewable, ABC):
    """Base class of slip laws, which map curvatures (...) [1/m] to slips (..., 2) of the left and
    right track [-].
    """

    records_icr: ClassVar[bool] = False
    """Whether logs of runs with this law record its ICRs, `offset` and `radius_error`."""
    twist_iterations: ClassVar[int] = 12
    """Maximum number of iterations in `twist`. Where a law jumps, some sprocket speeds need all of
    them.
    """
    turns_on_the_spot: ClassVar[bool] = True
    """Whether the law holds in turns on the spot, where the radius is 0."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        checks_arguments(cls)  # of methods that the subclass defines anew

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

        The real twist is a point in the plane (v, b w). It is scaled and rotated until the sprocket
        speeds for it match `omega`. The secant method rotates it: if it was rotated by t, and its
        direction was wrong by m before and by n afterwards, the slope is (m - n) / t, and the next
        rotation is by n divided by this slope.

        Where a law jumps between left and right turns in place, the robot turns in place with
        intermediate slips. If several solutions exist, the result is close to one of them; if none,
        approximate.
        """
        omega = np.asarray(omega, float)
        in_place, turning = self.turns_in_place(omega, geometry)
        commanded = np.broadcast_to(_without_slip(omega, geometry), in_place.shape)
        real = commanded
        is_final = in_place
        rotation = np.zeros(in_place.shape)
        missed_before = np.zeros(in_place.shape)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for k in range(self.twist_iterations):
                demanded = self.sprocket_speeds(_of_plane(real, geometry), geometry)
                ratio = commanded / _without_slip(demanded, geometry)
                ratio = np.where(np.isfinite(ratio) & (ratio != 0), ratio, 1.0)
                missed = np.arctan2(ratio.imag, ratio.real)
                if k == 0:
                    rotation = missed
                else:
                    rotation = missed / _limited((missed_before - missed) / rotation)
                missed_before = missed
                real = np.where(is_final, real, real * np.abs(ratio) * np.exp(1j * rotation))
                # final, as another step might cross a jump
                is_final = is_final | (np.abs(ratio - 1) < _CONVERGED)
                if is_final.all():
                    break
        return _of_plane(np.where(in_place, 1j * turning, real), geometry)

    def effective_half_gauge(self, geometry: RobotGeometry) -> float:
        """Half gauge of tracks without slip that would turn the robot equally [m]: b + D for
        constant ICRs.

        The value comes from turns to both sides with a radius of four half gauges, and is the mean
        for several robots.
        """
        radius = 4 * geometry.half_gauge
        twists = [[[radius, 1.0]], [[radius, -1.0]]]
        left, right = np.moveaxis(self.sprocket_speeds(twists, geometry), -1, 0)
        ratio = np.abs((right - left) / (right + left))
        return float(np.mean(ratio)) * radius

    def turns_in_place(self, omega: Array, geometry: RobotGeometry) -> tuple[np.ndarray, Array]:
        """Mask (...) of sprocket speeds (..., 2) in the jump between left and right turns in place,
        and b w (...).

        b w is in m/s, and 0 outside the jump. Turning in place to the left, the tracks have the
        speeds -b w and b w, so with belt speeds c_l and c_r their slips are 1 + b w / c_l and
        1 - b w / c_r. In the jump, the sum of both slips equals that at either end, i + o of the
        inner and outer track, so

            b w = (2 - i - o) / (1 / c_r - 1 / c_l)

        There, the right track's slip is between o, its slip to the left, and i, that to the right.
        """
        belt = geometry.sprocket_radius * omega
        left = belt[..., 0]
        right = belt[..., 1]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            slips = self(np.inf)
            inner = slips[..., 0]
            outer = slips[..., 1]
            turning = (2 - inner - outer) / (1 / right - 1 / left)

            # the right track's slip, as a deviation from the mean in half the jump's height
            right_slip = 1 - turning / right
            deviation = (right_slip - (inner + outer) / 2) / ((outer - inner) / 2)
            is_opposed = left * right < 0
            jumps = outer > inner
            is_inside = is_opposed & jumps & (np.abs(deviation) <= 1 + _JUMP_ROUNDING)
        return is_inside, np.where(is_inside, turning, 0.0)


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
    lowest, highest = _SLOPES
    limited = np.minimum(np.maximum(slope, lowest), highest)
    return np.where(np.isnan(limited), 1.0, limited)


def by_side(kappa: ArrayLike, inner: Array, outer: Array) -> Array:
    """Slips (..., 2) of the (left, right) tracks from inner and outer slips (...); on a straight
    path, their mean.
    """
    side = np.sign(np.asarray(kappa, float))
    mean = (inner + outer) / 2
    deviation = side * (inner - outer) / 2
    return np.stack([mean + deviation, mean - deviation], axis=-1)


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
        is_inside = (array > low) & (array < high)
        if not is_inside.all():
            wrong = array[~is_inside].flat[0] if array.ndim else value
            raise InvalidValueError(name, wrong, allowed)
