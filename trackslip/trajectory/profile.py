"""How fast a path is driven: limits, and the quickest speeds within them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import InvalidValueError, require_non_negative, require_positive
from trackslip.kinematics import Array
from trackslip.trajectory.path import PlanarPath, cell

MIN_SPEED = 1e-3
"""Speed that a path's tightest bend must allow, at least [m/s]."""
_GENTLEST = 1e-4  # acceleration, at least [m/s^2]
_WITHIN = np.array([1e-6, 0.25, 0.5, 0.75, 1 - 1e-6])  # of a cell; not its ends, where the curvature may jump


@dataclass(frozen=True)
class Limits:
    """What a reference may ask of the robot."""

    speed: float = 0.15
    """[m/s]"""
    acceleration: float = 0.05
    """Along the path [m/s^2]."""
    yaw_rate: float = 0.3
    """[rad/s]"""
    track_speed: float = 0.27
    """Of the faster track's surface [m/s]."""
    half_gauge: float = 0.215
    """From the middle to where a track's surface moves as the ground does: half the gauge, and what slip adds [m]."""

    def __post_init__(self) -> None:
        require_non_negative("half_gauge", self.half_gauge)
        for name, least, unit in (
            ("speed", MIN_SPEED, "m/s"),
            ("acceleration", _GENTLEST, "m/s^2"),
            ("yaw_rate", 0.0, "rad/s"),
            ("track_speed", MIN_SPEED, "m/s"),
        ):
            value = getattr(self, name)
            require_positive(name, value)
            if value < least:
                raise InvalidValueError(name, value, f"at least {least:g} {unit}")

    def speed_at(self, curvature: ArrayLike) -> Array:
        """Largest speeds (...) at curvatures (...) [m/s]."""
        bend = np.abs(np.asarray(curvature, float))
        by_track = self.track_speed / (1 + self.half_gauge * bend)
        by_yaw_rate = self.yaw_rate / np.maximum(bend, self.yaw_rate / self.speed)
        return np.minimum(np.minimum(self.speed, by_track), by_yaw_rate)


LIMITS = Limits()
"""Within reach of the shipped robot's drives, slip included."""


class ProfiledReference:
    """A path driven as fast as limits allow, from rest to rest, at constant acceleration between the path's knots."""

    def __init__(self, path: PlanarPath, limits: Limits = LIMITS) -> None:
        """Raises InvalidValueError for a path so tight that it couldn't be driven at MIN_SPEED."""
        self._path = path
        self._speeds = _speeds(path, limits)  # (K,)
        steps = np.diff(path.knots)
        durations = 2 * steps / (self._speeds[:-1] + self._speeds[1:])
        self._accelerations = np.diff(self._speeds) / durations  # (K - 1,)
        self._times = np.concatenate([[0.0], np.cumsum(durations)])  # (K,)
        self._duration = float(self._times[-1])

    @property
    def duration(self) -> float:
        """When the reference stops [s]."""
        return self._duration

    @property
    def knots(self) -> Array:
        """Times (K,) between which the twist is smooth [s]."""
        return self._times

    def pose(self, time: ArrayLike) -> Array:
        """Poses (..., 3) at times (...) [s]; phi unwrapped."""
        k, t = self._locate(time)
        return self._path.pose(self._way(k, t))

    def twist(self, time: ArrayLike) -> Array:
        """Twists (..., 2) at times (...) [s]."""
        time = np.asarray(time, float)
        k, t = self._locate(time)
        speed = np.where(time < self._duration, np.maximum(self._speeds[k] + self._accelerations[k] * t, 0.0), 0.0)
        return np.stack([speed, speed * self._path.curvature(self._way(k, t))], axis=-1)

    def _way(self, k: NDArray[np.intp], t: Array) -> Array:
        """Arc lengths (...) in cells k (...) at times (...) since their starts."""
        way: Array = self._path.knots[k] + t * (self._speeds[k] + self._accelerations[k] * t / 2)
        return way

    def _locate(self, time: ArrayLike) -> tuple[NDArray[np.intp], Array]:
        """Index of the cell and time since its start, each (...)."""
        clipped = np.minimum(np.maximum(np.asarray(time, float), 0.0), self._duration)
        k = cell(self._times, clipped)
        return k, clipped - self._times[k]


def _speeds(path: PlanarPath, limits: Limits) -> Array:
    """The largest speeds (K,) at the path's knots, zero at both ends; their squares change evenly between knots."""
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
    square = np.minimum(np.append(allowed, 0.0), np.insert(allowed, 0, 0.0)) ** 2
    # v^2 may grow by 2 a per metre, forwards, then backwards from the end
    growth = 2 * limits.acceleration * s
    square = np.minimum.accumulate(square - growth) + growth
    square = np.minimum.accumulate((square + growth)[::-1])[::-1] - growth
    return np.sqrt(np.maximum(square, 0.0))
