"""The paths of closed-loop runs: options of waypoint files, whether controllers and laws can follow
them, and how long they take.
"""

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np

from experiments.common.options import Within, default_is
from experiments.common.paths import PathPlan, is_file
from experiments.simulate.options import require_speed
from trackslip.controllers.base import Controller
from trackslip.controllers.named import CONTROLLERS, TURNING_CONTROLLERS
from trackslip.errors import InvalidValueError, counted
from trackslip.laws.base import TURNING_LAWS, SlipLaw
from trackslip.trajectory.base import Reference
from trackslip.trajectory.path import LIMITS, MotionLimits
from trackslip.trajectory.turns import require_turns, turns_of
from trackslip.trajectory.waypoints import MAX_TOLERANCE, TOLERANCE_SHARE

_SAMPLING_PERIOD: Final = 0.02  # [s]
_SLOW: Final = 0.5  # fraction of the speed below which a bend is slow
_SLOWED: Final = 0.5  # fraction of the time in slow bends from which it is warned of them
_AT_LIMIT: Final = 0.95  # fraction of the largest yaw rate above which a bend limits the speed


@dataclass(frozen=True)
class WaypointOptions:
    """Options of paths from .csv files."""

    speed: Annotated[float | None, default_is(f"{LIMITS.speed:g}", "FLOAT")] = None
    """Speed along the path of a .csv file, lower in bends [m/s]."""
    tolerance: Annotated[
        float | None,
        Within(0, MAX_TOLERANCE, "m"),
        default_is("a tenth of the robot's half gauge", "FLOAT"),
    ] = None
    """Distance by which the path may miss points of a .csv file where that smooths bends [m]."""

    def require_file(self, names: tuple[str, ...], top_speed: float) -> None:
        """Raise InvalidValueError for options that none of the paths `names` uses, and for a speed
        above `top_speed` [m/s].
        """
        has_file = any(is_file(name) for name in names)
        for option in ("speed", "tolerance"):
            value = getattr(self, option)
            if value is not None and not has_file:
                raise InvalidValueError(option, value, "left out for paths without a .csv file")
        if self.speed is not None:
            require_speed("speed", self.speed, top_speed)

    def plan(self, half_gauge: float, top_speed: float) -> PathPlan:
        """How files become paths of a robot with this half gauge [m] and top speed [m/s]."""
        limits = LIMITS if self.speed is None else LIMITS.scaled(self.speed, top_speed)
        tolerance = self.tolerance
        if tolerance is None:
            tolerance = TOLERANCE_SHARE * half_gauge
        return PathPlan(limits, tolerance)


def require_controller(path: Reference, name: str, controller: Controller) -> None:
    """Raise InvalidValueError if the path turns on the spot and the controller `name` can't."""
    known, _, _ = name.partition(":")  # without its gains
    called = known if known in CONTROLLERS else name
    require_turns(path, "controller", called, controller, TURNING_CONTROLLERS)


def require_compensation(path: Reference, name: str, law: SlipLaw) -> None:
    """Raise InvalidValueError if the path turns on the spot, where the law of the compensation
    `name` doesn't hold.
    """
    require_turns(path, "compensation", name, law, TURNING_LAWS)


@dataclass(frozen=True)
class PathSummary:
    """Length and duration of a path."""

    name: str
    duration: float
    """[s]"""
    length: float
    """[m]"""
    turns: int
    """Number of turns on the spot."""
    slow: float
    """Fraction of the time in bends that reduce the speed to less than half of its limit [-]."""

    @classmethod
    def of(cls, name: str, path: Reference, limits: MotionLimits) -> "PathSummary":
        """Sample a path that is planned within `limits`."""
        time = np.arange(0.0, path.duration, _SAMPLING_PERIOD)
        v, w = np.abs(path.twist(time)).T
        is_slow = (v > 0) & (v < _SLOW * limits.speed) & (w > _AT_LIMIT * limits.yaw_rate)
        return cls(
            name=name,
            duration=path.duration,
            length=float(v.sum() * _SAMPLING_PERIOD),
            turns=len(turns_of(path)),
            slow=float(is_slow.mean()),
        )

    def __str__(self) -> str:
        turns = f", {counted(self.turns, 'turn')} on the spot" if self.turns else ""
        return f"Path {self.name}: {self.length:.2f} m in {self.duration:.1f} s{turns}."

    def warnings(self, plan: PathPlan) -> list[str]:
        """A warning if bends between waypoints slow the robot for most of the time."""
        if not is_file(self.name) or self.slow < _SLOWED:
            return []
        mean = 1e3 * self.length / self.duration
        most = 1e3 * plan.limits.speed
        return [
            f"{self.name}: bends between its points slow the robot to {mean:.0f} mm/s on average, "
            f"of {most:.0f} mm/s; smooth the points, or raise --tolerance above "
            f"{plan.tolerance:.4g} m"
        ]
