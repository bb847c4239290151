"""Limits on a planned drive, and prior knowledge of the robot."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from trackslip.errors import InvalidValueError, LogError, require_non_negative, require_within
from trackslip.kinematics import Array, RobotGeometry
from trackslip.odometry.identified import LawInUse, identified_law

CORNER_DISTANCE: Final = 2.0
"""Distance of the corners of a robot 1.5 gauges long from its centre, in half gauges [-]."""
MAX_DOUBT: Final = 0.9
"""Largest relative error of prior knowledge of a robot [-]."""
_BOUNDS: Final = {
    "max_speed": (1e-3, 10.0, "m/s"),
    "acceleration": (1e-3, 100.0, "m/s^2"),
    "duration": (10.0, 3600.0, "s"),
}
_SIDE_BOUNDS: Final = (1e-3, 1000.0, "m")  # allowed lengths of an area's sides
_MAX_OFFSET: Final = 100.0  # largest distance of a track's ICR from the track [m]
_FIRST_OFFSET: Final = 0.3  # typical D of a robot on hard ground, in half gauges [-]
_PATH_LAW: Final = "icr_radius"  # law with which paths are predicted
# standard errors from an earlier identification for which the area leaves room
_DEVIATIONS: Final = 4.0
# smallest errors assumed after identification
_MIN_REACH_DOUBT: Final = 0.01  # of b + D [-]
_MIN_RADIUS_DOUBT: Final = 0.005  # of epsilon [-]
_MIN_PULL: Final = 0.0005  # of the difference between left and right [-]
_MIN_SLIP: Final = 1e-4  # smallest white slip after identification [m/sqrt(m), rad/sqrt(m)]


@dataclass(frozen=True)
class DriveLimits:
    """Limits on a drive's speed, acceleration, area and duration."""

    max_speed: float
    """Maximum belt speed [m/s]."""
    acceleration: float
    """Maximum belt acceleration [m/s^2]."""
    area: tuple[float, float]
    """Length and width of the area that the robot may not leave [m]."""
    duration: float
    """Duration of the drive [s]."""
    clearance: float = 0.0
    """Distance that the robot's centre keeps from the edge of the area [m]."""

    def __post_init__(self) -> None:
        for name, bounds in _BOUNDS.items():
            require_within(name, getattr(self, name), *bounds)
        require_non_negative("clearance", self.clearance)
        for side in self.area:
            require_within("area", side, *_SIDE_BOUNDS)
            if side <= 2 * self.clearance:
                raise InvalidValueError(
                    "area", self.area_text, f"more than twice the clearance, {self.clearance:g} m"
                )

    @property
    def area_text(self) -> str:
        """The area in the format of the command line."""
        return f"{self.area[0]:g}x{self.area[1]:g}"

    @property
    def room(self) -> Array:
        """Length and width (2,) of the area in which the robot's centre may be [m]."""
        return np.array(self.area) - 2 * self.clearance


@dataclass(frozen=True)
class Knowledge:
    """Prior knowledge of the robot's motion."""

    geometry: RobotGeometry
    offset: float  # D: expected distance of the ICRs outside the tracks [m]
    # epsilon: expected relative error of the effective sprocket radius [-]
    radius_error: float = 0.0
    reach_doubt: float = 0.15  # largest relative error of b + D [-]
    radius_doubt: float = 0.02  # largest deviation of epsilon from `radius_error` [-]
    pull: float = 0.001  # largest difference between the left and right radius errors [-]
    slip: tuple[float, float, float] = (0.002, 0.002, 0.005)
    """White slip forwards, sideways [m/sqrt(m)] and in yaw [rad/sqrt(m)]."""

    def __post_init__(self) -> None:
        require_within("doubt", self.reach_doubt, 0.0, MAX_DOUBT)
        require_within("offset", self.offset, -0.9 * self.geometry.half_gauge, _MAX_OFFSET, "m")
        require_within("radius_error", self.radius_error, -0.9, 0.9)

    @property
    def reach(self) -> float:
        """b + D, the effective half gauge [m]."""
        return self.geometry.half_gauge + self.offset

    @property
    def extremes(self) -> Array:
        """Possible laws (9, 3): b + D [m], and 1 + epsilon left and right; the expected law first.

        The others are the corners of the box of all doubts.
        """
        scale = 1 + self.radius_error
        expected = np.array([[self.reach, scale, scale]])
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1)
        reach_sign, scale_sign, pull_sign = signs
        reach = self.reach * (1 + reach_sign * self.reach_doubt)
        mean_scale = scale + scale_sign * self.radius_doubt
        half_pull = pull_sign * self.pull / 2
        corners = np.stack([reach, mean_scale - half_pull, mean_scale + half_pull], axis=-1)
        return np.concatenate([expected, corners])


def first_knowledge(geometry: RobotGeometry) -> Knowledge:
    """Prior knowledge of a robot never identified: typical of hard ground, with a margin."""
    return Knowledge(geometry, offset=_FIRST_OFFSET * geometry.half_gauge)


def read_identification(path: str | Path, law: str | None = None) -> tuple[LawInUse, Knowledge]:
    """Read a law, by default the best, and the knowledge of the robot that follows from it.

    `path` is an identification or a file of laws. Raises InvalidValueError if the law is missing,
    LogError if the law has no standard errors.
    """
    used = identified_law(path, law)
    if used.errors is None or not used.errors.names:
        raise LogError(f"{path}: no standard errors of the law {used.name} in it")
    try:
        by_path = identified_law(path, _PATH_LAW)
    except InvalidValueError:
        by_path = used
    knowledge = first_knowledge(used.geometry)
    found = vars(by_path.law)
    errors = by_path.errors or used.errors
    deviations = _DEVIATIONS * np.sqrt(np.diag(errors.covariance))
    doubts = dict(zip(errors.names, deviations.tolist(), strict=True))

    if "offset" in doubts:
        offset = float(found["offset"])
        relative = doubts["offset"] / (used.geometry.half_gauge + offset)
        doubt = min(max(relative, _MIN_REACH_DOUBT), MAX_DOUBT)
        knowledge = replace(knowledge, offset=offset, reach_doubt=doubt)
    if "radius_error" in doubts:
        radius_error = float(found["radius_error"])
        doubt = min(max(doubts["radius_error"], _MIN_RADIUS_DOUBT), MAX_DOUBT)
        knowledge = replace(knowledge, radius_error=radius_error, radius_doubt=doubt)
    with suppress(InvalidValueError):  # if icr_sides was not identified
        sides = vars(identified_law(path, "icr_sides").law)
        difference = abs(sides["radius_error_left"] - sides["radius_error_right"])
        pull = min(max(difference, _MIN_PULL), MAX_DOUBT)
        knowledge = replace(knowledge, pull=float(pull))
    if used.noise is not None:
        along = max(used.noise.forward, _MIN_SLIP)
        across = max(used.noise.sideways, _MIN_SLIP)
        turning = max(used.noise.turn, _MIN_SLIP)
        knowledge = replace(knowledge, slip=(along, across, turning))
    return used, knowledge
