"""Whether the tracks of a robot are fast enough for a reference, slip included."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.trajectory.base import Reference

_SPACING: Final = 0.02  # time between examined points, besides the knots of a reference [s]
_ROUNDING: Final = 1e-9  # relative tolerance on the top speed [-]
_DIGITS: Final = 3  # significant digits of a speed that is possible


@dataclass(frozen=True)
class Demand:
    """The faster track where a reference demands most of it."""

    track_speed: float
    """Surface speed of the track [m/s]."""
    time: float
    """Time at which the reference demands it [s]."""
    speed: float
    """Largest speed of the reference [m/s]."""

    @classmethod
    def of(cls, reference: Reference, law: SlipLaw, geometry: RobotGeometry) -> Self:
        """The demand of a reference on a robot that compensates slip by a law."""
        time = np.arange(0.0, reference.duration, _SPACING)
        # speeds are largest at knots, where curvatures may jump
        knots = np.asarray(getattr(reference, "knots", ()))
        time = np.concatenate([time, knots, np.nextafter(knots, -np.inf)])
        twist = reference.twist(time)
        omega = law.sprocket_speeds(twist, geometry)
        track_speeds = geometry.sprocket_radius * np.abs(omega).max(axis=-1)
        most = int(np.nanargmax(track_speeds))
        return cls(
            track_speed=float(track_speeds[most]),
            time=max(float(time[most]), 0.0),
            speed=float(np.abs(twist[:, 0]).max()),
        )

    def exceeds(self, top_speed: float) -> bool:
        """Whether tracks with this top speed [m/s] are too slow."""
        return self.track_speed > top_speed * (1 + _ROUNDING)

    def possible_speed(self, top_speed: float) -> float:
        """Largest speed at which tracks with this top speed follow the same path [m/s], rounded
        down.

        Track speeds are in proportion to it, except by laws that depend on speed.
        """
        speed = self.speed * top_speed / self.track_speed
        if speed == 0:  # the reference only turns on the spot
            return 0.0
        unit = 10.0 ** (math.floor(math.log10(speed)) - _DIGITS + 1)
        return math.floor(speed / unit) * unit

    def reason(self, top_speed: float) -> str:
        """Why the top speed [m/s] is too low."""
        return (
            f"the faster track takes {self.track_speed:.3g} m/s at {self.time:.1f} s, and "
            f"drive.top_speed is {top_speed:g} m/s"
        )


def require_drivable(
    field: str,
    name: str,
    reference: Reference,
    law: SlipLaw,
    geometry: RobotGeometry,
    top_speed: float,
) -> None:
    """Raise InvalidValueError for a reference, the value `name` of `field`, that is faster than a
    robot with tracks of this top speed [m/s] can drive.
    """
    demand = Demand.of(reference, law, geometry)
    if demand.exceeds(top_speed):
        slower = f"{demand.possible_speed(top_speed):g} instead of {demand.speed:.3g} m/s"
        allowed = f"slow enough for the robot, at most {slower}: {demand.reason(top_speed)}"
        raise InvalidValueError(field, name, allowed)
