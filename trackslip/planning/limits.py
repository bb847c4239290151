"""Limits on a planned drive, and prior knowledge of the robot."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trackslip.errors import InvalidValueError, LogError, require_non_negative, require_within
from trackslip.kinematics import Array, RobotGeometry
from trackslip.odometry.identified import LawInUse, identified_law

TURNING = 2.0
"""Distance from a robot's centre to its corners, in half gauges, for tracks 1.5 times as long as
the gauge [-].
"""
_BOUNDS = {
    "max_speed": (1e-3, 10.0, "m/s"),
    "acceleration": (1e-3, 100.0, "m/s^2"),
    "duration": (10.0, 3600.0, "s"),
}
_SIDES = (1e-3, 1000.0, "m")  # allowed lengths of an area's sides
_MOST_OFFSET = 100.0  # largest distance of a track's ICR from the track [m]
MOST_DOUBT = 0.9  # largest relative error of prior knowledge of a robot [-]
_PATH_LAW = "icr_radius"  # law with which paths are predicted
_DEVIATIONS = 4.0  # standard errors from an earlier identification for which the area leaves room
# smallest errors assumed after identification [-]
_LEAST_REACH, _LEAST_RADIUS, _LEAST_PULL = 0.01, 0.005, 0.0005
_LEAST_SLIP = 1e-4  # smallest white slip assumed after identification [m/sqrt(m), rad/sqrt(m)]


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
            require_within("area", side, *_SIDES)
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
        require_within("doubt", self.reach_doubt, 0.0, MOST_DOUBT)
        require_within("offset", self.offset, -0.9 * self.geometry.half_gauge, _MOST_OFFSET, "m")
        require_within("radius_error", self.radius_error, -0.9, 0.9)

    @property
    def reach(self) -> float:
        """b + D, the effective half gauge [m]."""
        return self.geometry.half_gauge + self.offset

    @property
    def extremes(self) -> Array:
        """Possible laws (9, 3) of the robot, the expected law first: b + D [m], and 1 + epsilon
        left and right.
        """
        scale = 1 + self.radius_error
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        reach = self.reach * (1 + signs[:, 0] * self.reach_doubt)
        both = scale + signs[:, 1] * self.radius_doubt
        pull = signs[:, 2] * self.pull / 2
        laws = np.stack([reach, both - pull, both + pull], axis=-1)
        return np.concatenate([[[self.reach, scale, scale]], laws])


def first_knowledge(geometry: RobotGeometry) -> Knowledge:
    """Prior knowledge of a robot that was never identified: values typical of hard ground, with a
    margin.
    """
    return Knowledge(geometry, offset=0.3 * geometry.half_gauge)


def read_identification(path: str | Path, law: str | None = None) -> tuple[LawInUse, Knowledge]:
    """Read a law, by default the best, from an identification or a file, and derive the knowledge
    of the robot from it.

    Raises InvalidValueError if the law is missing, LogError if the law has no standard errors.
    """
    used = identified_law(path, law)
    if used.errors is None or not used.errors.names:
        raise LogError(f"{path}: no standard errors of the law {used.name} in it")
    try:
        by_path = identified_law(path, _PATH_LAW)
    except InvalidValueError:
        by_path = used
    knowledge, known = first_knowledge(used.geometry), vars(by_path.law)
    errors = by_path.errors or used.errors
    doubts = dict(zip(errors.names, _DEVIATIONS * np.sqrt(np.diag(errors.covariance)), strict=True))
    if "offset" in doubts:
        doubt = np.clip(
            doubts["offset"] / (used.geometry.half_gauge + known["offset"]),
            _LEAST_REACH,
            MOST_DOUBT,
        )
        knowledge = replace(knowledge, offset=float(known["offset"]), reach_doubt=float(doubt))
    if "radius_error" in doubts:
        doubt = np.clip(doubts["radius_error"], _LEAST_RADIUS, MOST_DOUBT)
        knowledge = replace(
            knowledge, radius_error=float(known["radius_error"]), radius_doubt=float(doubt)
        )
    with suppress(InvalidValueError):  # if icr_sides was not identified
        sides = vars(identified_law(path, "icr_sides").law)
        pull = np.clip(
            abs(sides["radius_error_left"] - sides["radius_error_right"]), _LEAST_PULL, MOST_DOUBT
        )
        knowledge = replace(knowledge, pull=float(pull))
    if used.noise is not None:
        along, across, turning = (max(size, _LEAST_SLIP) for size in vars(used.noise).values())
        knowledge = replace(knowledge, slip=(along, across, turning))
    return used, knowledge
