"""Speed profiles: the fastest one along a path within limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import InvalidValueError, require, require_non_negative, require_positive
from trackslip.kinematics import Array
from trackslip.trajectory.base import PiecewiseReference
from trackslip.trajectory.path import PlanarPath

MIN_SPEED = 1e-3  # minimum speed that the tightest bend of a path must allow [m/s]
_MIN_ACCELERATION = 1e-4  # [m/s^2]
_WITHIN = np.array([1e-6, 0.25, 0.5, 0.75, 1 - 1e-6])  # points of a cell without its ends, where the curvature may jump


@dataclass(frozen=True)
class MotionLimits:
    """MotionLimits of the motion along a reference."""

    speed: float = 0.15
    """Maximum speed [m/s]."""
    acceleration: float = 0.05
    """Maximum acceleration along the path [m/s^2]."""
    yaw_rate: float = 0.3
    """Maximum yaw rate [rad/s]."""
    track_speed: float = 0.27
    """Maximum surface speed of the faster track [m/s]."""
    half_gauge: float = 0.215
    """Distance of a track's ICR from the middle of the robot: half the gauge plus the effect of slip [m]."""

    def __post_init__(self) -> None:
        require_non_negative("half_gauge", self.half_gauge)
        for name, least, unit in (
            ("speed", MIN_SPEED, "m/s"),
            ("acceleration", _MIN_ACCELERATION, "m/s^2"),
            ("yaw_rate", 0.0, "rad/s"),
            ("track_speed", MIN_SPEED, "m/s"),
        ):
            value = getattr(self, name)
            require_positive(name, value)
            require(value >= least, name, value, f"at least {least:g} {unit}")

    def speed_at(self, curvature: ArrayLike) -> Array:
        """Maximum speeds (...) at curvatures (...) [m/s]."""
        bend = np.abs(np.asarray(curvature, float))
        by_track = self.track_speed / (1 + self.half_gauge * bend)
        by_yaw_rate = self.yaw_rate / np.maximum(bend, self.yaw_rate / self.speed)
        return np.minimum(np.minimum(self.speed, by_track), by_yaw_rate)


LIMITS = MotionLimits()
"""MotionLimits that the drives of the default robot can follow, slip included."""


class ProfiledReference(PiecewiseReference):
    """A path driven as fast as the limits allow, from rest to rest, at constant acceleration between its knots."""

    def __init__(
        self,
        path: PlanarPath,
        limits: MotionLimits = LIMITS,
        speed_at: Callable[[Array], Array] | None = None,
        direction: int = 1,
    ) -> None:
        """`speed_at` gives largest speeds (...) at arc lengths (...), below MIN_SPEED taken as that [m/s].

        `direction` is 1 for forwards and -1 for reverse. Raises InvalidValueError for a path too tight to be driven at
        MIN_SPEED.
        """
        self._path, self._direction = path, direction
        self._turn = np.array([0.0, 0.0, np.pi if direction < 0 else 0.0])  # from the path to the robot
        speeds = _speeds(path, limits, speed_at)  # (K,)
        durations = 2 * np.diff(path.knots) / (speeds[:-1] + speeds[1:])
        super().__init__(durations, direction * speeds[:-1], direction * speeds[1:])

    def pose_in(self, k: NDArray[np.intp], way: Array) -> Array:
        """See PiecewiseReference."""
        return self._path.pose(self._path.knots[k] + self._direction * way) + self._turn

    def curvature_in(self, k: NDArray[np.intp], way: Array) -> Array:
        """See PiecewiseReference."""
        return self._direction * self._path.curvature(self._path.knots[k] + self._direction * way)


def _speeds(path: PlanarPath, limits: MotionLimits, speed_at: Callable[[Array], Array] | None) -> Array:
    """The maximum speeds (K,) at the knots of the path, zero at both ends; their squares are linear in between."""
    s = path.knots
    within = s[:-1, None] + np.diff(s)[:, None] * _WITHIN
    curvature = path.curvature(within)
    allowed = limits.speed_at(curvature).min(axis=1)  # (K - 1,)
    if allowed.min() < MIN_SPEED:
        row, column = np.unravel_index(np.argmax(np.abs(curvature)), curvature.shape)
        x, y, _ = path.pose(within[row, column])
        raise InvalidValueError(
            f"radius of curvature at ({x:.3f}, {y:.3f})",
            float(f"{1 / abs(curvature[row, column]):.3g}"),
            f"large enough to drive at {MIN_SPEED:g} m/s within the limits of yaw rate and track speed",
        )
    if speed_at is not None:
        allowed = np.minimum(allowed, np.maximum(speed_at(within).min(axis=1), MIN_SPEED))
    square = np.minimum(np.append(allowed, 0.0), np.insert(allowed, 0, 0.0)) ** 2
    # v^2 may grow by 2 a per metre, forwards from the start and backwards from the end
    growth = 2 * limits.acceleration * s
    square = np.minimum.accumulate(square - growth) + growth
    square = np.minimum.accumulate((square + growth)[::-1])[::-1] - growth
    return np.sqrt(np.maximum(square, 0.0))
