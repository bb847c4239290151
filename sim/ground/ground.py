"""What the tracks stand on: friction, its patches and changes, and the slope."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import InvalidValueError, require_at_most, require_finite, require_non_negative, require_positive
from trackslip.kinematics import Array

MAX_FRICTION = 10.0
MAX_SLOPE = 1.5
"""[rad]"""
MAX_PATCHES = 10_000
"""Patches of a ground, and changes."""


@dataclass(frozen=True)
class Patch:
    """A rectangle of other friction, its sides along the world's axes. A pad is on it when the pad's middle is."""

    x: tuple[float, float]
    """From, to [m]; may be infinite."""
    y: tuple[float, float]
    """From, to [m]; may be infinite."""
    along: float
    """Friction coefficient along the track [-]."""
    across: float
    """Friction coefficient across the track [-]."""

    def __post_init__(self) -> None:
        _require_friction(self.along, self.across)
        for name, pair in (("x", self.x), ("y", self.y)):
            if len(pair) != 2 or not pair[0] < pair[1]:
                raise InvalidValueError(name, tuple(pair), "two ascending numbers")


@dataclass(frozen=True)
class Change:
    """From a time on, the friction of all ground that no patch covers is another."""

    time: float
    """Since the start of the run [s]."""
    along: float
    """Friction coefficient along the track [-]."""
    across: float
    """Friction coefficient across the track [-]."""

    def __post_init__(self) -> None:
        _require_friction(self.along, self.across)
        require_non_negative("time", self.time)


@dataclass(frozen=True)
class Ground:
    """Coulomb friction, along and across the tracks, on a plane.

    Slip depends on the ratio of the two, not on their size. The default is stone paving under tracks whose treads grip
    better sideways; its ratio is tuned so that the robot drives the radii that the paper observed.
    """

    along: float = 0.70
    """Friction coefficient along the track [-]."""
    across: float = 0.778
    """Friction coefficient across the track [-]."""
    slope: float = 0.0
    """Angle of the plane to the horizontal [rad]. Poses and scans are those in the plane."""
    uphill: float = 0.0
    """Heading of a robot that drives straight up the slope [rad]."""
    patches: tuple[Patch, ...] = ()
    """Where the friction is another; the last of overlapping patches counts."""
    changes: tuple[Change, ...] = ()
    """When the friction becomes another, in order of time."""

    def __post_init__(self) -> None:
        _require_friction(self.along, self.across)
        require_non_negative("slope", self.slope)
        require_at_most("slope", self.slope, MAX_SLOPE, "rad")
        require_finite("uphill", self.uphill)
        for name in ("patches", "changes"):
            require_at_most(f"number of {name}", len(getattr(self, name)), MAX_PATCHES)
        times = [change.time for change in self.changes]
        if times != sorted(set(times)):
            raise InvalidValueError("changes", times, "in order of time, each at a time of its own")

    def gravity(self, size: float) -> tuple[float, float, float]:
        """Gravity of `size` [m/s^2] in the frame of the plane: x and y along it, z off it."""
        downhill = size * math.sin(self.slope)
        return -downhill * math.cos(self.uphill), -downhill * math.sin(self.uphill), -size * math.cos(self.slope)

    def require_parking(self, friction: Sequence[float] | Array, heading: float) -> None:
        """Raise InvalidValueError if a robot with this heading [rad] would slide down from rest.

        `friction` (2,): along and across, mean over the pads where the robot stands.
        """
        steepest = friction_angle(friction, self.uphill - heading)
        if self.slope >= steepest:
            raise InvalidValueError(
                "slope",
                self.slope,
                f"less than the friction angle, {steepest:.3g} rad, to park with heading {round(heading, 3) + 0:g} rad",
            )


def friction_angle(friction: Sequence[float] | Array, uphill: float) -> float:
    """Steepest slope [rad] that holds a robot, if it rises in direction `uphill` [rad], counted from its nose.

    The friction limit is an ellipse with half axes `friction` (2,), along and across the tracks.
    """
    along, across = friction
    return float(np.arctan(1 / np.hypot(np.cos(uphill) / along, np.sin(uphill) / across)))


def _require_friction(along: float, across: float) -> None:
    for name, value in (("along", along), ("across", across)):
        require_positive(name, value)
        require_at_most(name, value, MAX_FRICTION)
