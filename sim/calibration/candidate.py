"""Candidates in a calibration, and the parameters that can differ between them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, Final

from sim.ground.ground import Ground
from sim.motors.motor import or_tireless
from sim.robot.parameters import RobotParameters
from trackslip.kinematics import RobotGeometry
from trackslip.se2 import Mounting

_FARTHEST: Final = 3.0  # largest distance from the base value [standard deviations of the prior]


@dataclass(frozen=True)
class Candidate:
    """A robot with its drive and pose sensor, on level ground."""

    robot: RobotParameters = field(default_factory=RobotParameters)
    ground: Ground = field(default_factory=Ground)
    # position and yaw of the pose sensor on the robot
    sensor: Mounting = field(default_factory=Mounting)
    clock: float = 0.0  # encoder clock minus pose clock [s]

    @property
    def geometry(self) -> RobotGeometry:
        """Half gauge and nominal sprocket radius, for the kinematics."""
        return self.robot.geometry

    def value(self, name: str) -> float:
        """Value of the parameter `name`."""
        return PARAMETERS[name].read(self)

    def with_values(self, values: Mapping[str, float]) -> Candidate:
        """A copy of the candidate with new `values` for some parameters, by name."""
        candidate = self
        for name, value in values.items():
            candidate = PARAMETERS[name].write(candidate, value)
        return candidate


@dataclass(frozen=True)
class Parameter:
    """A number that can be fitted, with a normal prior around the base candidate's value."""

    read: Callable[[Candidate], float]
    """Returns a candidate's value."""
    write: Callable[[Candidate, float], Candidate]
    """Returns a copy of a candidate with a new value."""
    spread: float
    """Standard deviation of the prior, in units of `size`; if `relative`, of the value's
    logarithm.
    """
    unit: str = ""
    """Unit of the value."""
    relative: bool = False
    """Whether the prior is normal in the value's logarithm."""
    size: Callable[[Candidate], float] = lambda base: 1.0
    """Returns the unit of `spread` for a base candidate."""
    low: float = -math.inf
    """Smallest value."""
    high: float = math.inf
    """Largest value."""

    def scaled(self, base: Candidate, value: float) -> float:
        """Signed distance of a value from the base candidate's value, in standard deviations of the
        prior.
        """
        centre = self.read(base)
        if self.relative:
            return math.log(value / centre) / self.spread
        return (value - centre) / (self.spread * self.size(base))

    def unscaled(self, base: Candidate, scaled: float) -> float:
        """Value at a scaled distance; the inverse of `scaled`."""
        centre = self.read(base)
        if self.relative:
            value = centre * math.exp(scaled * self.spread)
        else:
            value = centre + scaled * self.spread * self.size(base)
        return min(max(value, self.low), self.high)  # in spite of rounding

    def limits(self, base: Candidate) -> tuple[float, float]:
        """Limits on the scaled value: three standard deviations, or less if the smallest or largest
        value is closer.
        """
        low = -_FARTHEST
        if not self.relative or self.low >= 0:  # the logarithm has no lower end
            low = max(low, self.scaled(base, self.low))
        return low, min(_FARTHEST, self.scaled(base, self.high))


def _field(
    path: str,
    spread: float,
    unit: str = "",
    write: Callable[[Candidate, float], Candidate] | None = None,
    **options: Any,
) -> Parameter:
    """The parameter at a dotted path of fields in the candidate; by default, `write` changes that
    field alone.
    """

    def read(candidate: Candidate) -> float:
        return float(attrgetter(path)(candidate))

    def write_field(candidate: Candidate, value: float) -> Candidate:
        changed: Candidate = _with(candidate, path, value)
        return changed

    return Parameter(read, write or write_field, spread, unit, **options)


def _with(owner: Any, path: str, value: float) -> Any:
    """A copy of a dataclass with a new value at a dotted path of fields."""
    name, _, rest = path.partition(".")
    changed = _with(getattr(owner, name), rest, value) if rest else value
    return replace(owner, **{name: changed})


def _ratio(candidate: Candidate) -> float:
    return candidate.ground.across / candidate.ground.along


def _with_ratio(candidate: Candidate, ratio: float) -> Candidate:
    across = candidate.ground.along * ratio
    return replace(candidate, ground=replace(candidate.ground, across=across))


def _with_friction(candidate: Candidate, along: float) -> Candidate:
    """A candidate with another friction, whose ratio of across to along stays."""
    ground = replace(candidate.ground, along=along, across=along * _ratio(candidate))
    return replace(candidate, ground=ground)


def _with_length(candidate: Candidate, length: float) -> Candidate:
    return replace(candidate, robot=candidate.robot.with_contact_length(length))


def _lag(candidate: Candidate) -> float:
    return or_tireless(candidate.robot.drive).lag


def _with_lag(candidate: Candidate, lag: float) -> Candidate:
    drive = replace(or_tireless(candidate.robot.drive), lag=lag)
    return replace(candidate, robot=replace(candidate.robot, drive=drive))


def _radius(side: int) -> Parameter:
    """The radius error of one side: 0 for the left, 1 for the right."""

    def sides(candidate: Candidate) -> list[float]:
        mean = candidate.robot.radius_error
        split = candidate.robot.radius_split
        return [mean - split, mean + split]

    def read(candidate: Candidate) -> float:
        return sides(candidate)[side]

    def write(candidate: Candidate, value: float) -> Candidate:
        both = sides(candidate)
        both[side] = value
        left, right = both
        mean = (left + right) / 2
        split = (right - left) / 2
        robot = replace(candidate.robot, radius_error=mean, radius_split=split)
        return replace(candidate, robot=robot)

    return Parameter(read, write, spread=0.07)


PARAMETERS: Final = {
    "half_gauge": _field("robot.half_gauge", 0.1, "m", relative=True),
    "contact_length": _field("robot.contact_length", 0.15, "m", relative=True, write=_with_length),
    "radius_error": _field("robot.radius_error", 0.07),
    "radius_left": _radius(0),
    "radius_right": _radius(1),
    "friction": _field("ground.along", 0.7, relative=True, write=_with_friction),
    "friction_ratio": Parameter(_ratio, _with_ratio, 0.3, relative=True),
    "shear": _field("ground.shear", 0.015, "m", low=0.0),
    "com_x": _field("robot.com_x", 0.02, "m", size=lambda base: base.robot.contact_length),
    "com_y": _field("robot.com_y", 0.15, "m", size=lambda base: base.robot.half_gauge),
    "com_height": _field("robot.com_height", 0.3, "m", relative=True),
    "sensor_x": _field("sensor.x", 0.3, "m"),
    "sensor_y": _field("sensor.y", 0.3, "m"),
    "sensor_yaw": _field("sensor.yaw", 0.1, "rad"),
    "clock": _field("clock", 0.3, "s", low=-0.5, high=0.5),
    "lag": Parameter(_lag, _with_lag, 1.0, "s", relative=True, high=1.0),
}
"""Parameters that can be fitted, by name; radii are fitted as relative errors."""
OF_SENSOR: Final = frozenset({"sensor_x", "sensor_y", "sensor_yaw", "clock"})
"""Parameters without an effect on the robot's motion."""
OF_DRIVE: Final = frozenset({"lag"})
"""Parameters that only matter when commands drive the robot."""
