"""Randomization of the properties that vary between episodes."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from sim.fleet.fleet import RunSetup
from sim.ground.ground import MAX_FRICTION, MAX_SHEAR, MAX_SLOPE, Ground, Patch
from sim.motors.motor import Drive, or_tireless
from sim.robot.parameters import MAX_RADIUS_ERROR, RobotParameters
from trackslip.arguments import checks_arguments
from trackslip.errors import Checked, checked, require, require_range
from trackslip.kinematics import Array

Range = tuple[float, float]
"""Smallest and largest value of a uniform distribution."""

MAX_LATENCY: Final = 2
"""Largest latency of the actions [control periods]."""
PARKING: Final = 0.6
"""Ratio of the steepest drawn slope to the smallest friction angle [-]."""


def _require_drawn(field: str, ends: Range | None, low: float, high: float) -> None:
    if ends is not None:
        require_range(field, ends, low, high)


@checks_arguments
@dataclass(frozen=True)
class Randomization(Checked):
    """Ranges (from, to) from which each episode draws. By default, all episodes are equal.

    Soft soil has a friction and a shear modulus of its own, and is the same everywhere: on it,
    `friction_ratio`, `patches` and `shear` aren't drawn.
    """

    friction_ratio: Range = checked((1.0, 1.0), require_range, 0.1, 10.0)
    """Factor on the friction across the tracks, and thus on the ratio of across to along [-]."""
    radius_error: Range | None = checked(None, _require_drawn, -MAX_RADIUS_ERROR, MAX_RADIUS_ERROR)
    """Relative error of the effective sprocket radius; None for the robot's own [-]."""
    mass: Range = checked((1.0, 1.0), require_range, 0.2, 5.0)
    """Factor on the mass and inertia of the chassis, which may represent a payload [-]."""
    com_x: Range = checked((0.0, 0.0), require_range, -1.0, 1.0)
    """Forward offset of the centre of mass from the robot's nominal one [m]."""
    com_y: Range = checked((0.0, 0.0), require_range, -1.0, 1.0)
    """Leftward offset of the centre of mass from the robot's nominal one [m]."""
    slope: Range | None = checked(None, _require_drawn, 0.0, MAX_SLOPE)
    """Slope of the ground, with uphill in any direction; None for the ground's own slope [rad].
    Drawn slopes are limited to 0.6 times the smallest friction angle, so that the robot can park.
    """
    patches: tuple[int, int] = checked((0, 0), require_range, 0, 10)
    """Number of square patches with different friction on the path."""
    patch_size: Range = checked((0.3, 1.0), require_range, 0.01, 100.0)
    """Side length of the patches [m]."""
    patch_friction: Range = checked((0.5, 1.0), require_range, 0.01, MAX_FRICTION / 10)
    """Ratio of the patches' friction to the ground's; across the tracks, `friction_ratio` also
    scales it [-].
    """
    shear: Range | None = checked(None, _require_drawn, 0.0, MAX_SHEAR)
    """Shear modulus of the ground and its patches; None for the ground's own [m]."""
    lag: Range | None = checked(None, _require_drawn, 0.001, 1.0)
    """Time constant of the servos; None for the drive's [s]."""
    latency: tuple[int, int] = checked((0, 0), require_range, 0, MAX_LATENCY)
    """Delay until an action reaches the servos [control periods]."""
    start_distance: Range = checked((0.0, 0.0), require_range, 0.0, 10.0)
    """Distance of the robot from the path's start, in any direction [m]."""
    start_heading: Range = checked((0.0, 0.0), require_range, -math.pi, math.pi)
    """Heading error at the start [rad]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, ends in (("patches", self.patches), ("latency", self.latency)):
            require(all(int(end) == end for end in ends), name, ends, "two integers")

    @classmethod
    def limits(cls, name: str) -> Range:
        """Smallest and largest value allowed for a property."""
        low, high = cls.__dataclass_fields__[name].metadata["check"][1]
        return low, high

    @classmethod
    def typical(cls) -> Randomization:
        """Randomization for typical outdoor conditions."""
        return cls(
            friction_ratio=(0.8, 1.5),
            radius_error=(-0.02, 0.03),
            com_x=(-0.02, 0.02),
            com_y=(-0.03, 0.03),
            slope=(0.0, 0.1),
            patches=(0, 3),
            lag=(0.6 * Drive.lag, 2.0 * Drive.lag),
            latency=(0, MAX_LATENCY),
            start_distance=(0.0, 0.2),
            start_heading=(-0.3, 0.3),
        )

    def on_soft_soil(self) -> Randomization:
        """The ranges that apply on soft soil."""
        return dataclasses.replace(self, friction_ratio=(1.0, 1.0), patches=(0, 0), shear=None)

    def setup(
        self, generator: np.random.Generator, robot: RobotParameters, ground: Ground, path: Array
    ) -> RunSetup:
        """Draw ground, radius error, mass and lag for a robot at the start of `path` (T, 3) [m, m,
        rad].

        The order of the draws is that in which the seeds of stored episodes were used.
        """
        if ground.soil is not None and self != self.on_soft_soil():
            return self.on_soft_soil().setup(generator, robot, ground, path)

        drawn_ground = self._ground(generator, ground, path)
        radius_error = uniform(generator, self.radius_error, robot.radius_error)
        com_x = uniform(generator, self.com_x, 0.0)
        com_y = uniform(generator, self.com_y, 0.0)
        lag = uniform(generator, self.lag, or_tireless(robot.drive).lag)
        mass = 1.0
        if self.mass != (1.0, 1.0):
            mass = uniform(generator, self.mass, 1.0)
        return RunSetup(
            start=tuple(path[0].tolist()),
            ground=drawn_ground,
            radius_error=radius_error,
            lag=lag,
            com_offset=(com_x, com_y),
            mass=mass,
        )

    def _ground(self, generator: np.random.Generator, base: Ground, path: Array) -> Ground:
        """Draw friction, patches, slope and shear of a ground around `path` (T, 3)."""
        ratio = uniform(generator, self.friction_ratio, 1.0)
        count = generator.integers(*self.patches, endpoint=True)
        patches = [self._patch(generator, base, path) for _ in range(count)]
        slope = uniform(generator, self.slope, base.slope)
        uphill = generator.uniform(-math.pi, math.pi)
        changes = [
            dataclasses.replace(change, across=change.across * ratio) for change in base.changes
        ]
        ground = dataclasses.replace(
            base,
            across=base.across * ratio,
            changes=tuple(changes),
            patches=(*base.patches, *patches),
        )
        if self.shear is not None:
            ground = dataclasses.replace(ground, shear=uniform(generator, self.shear, 0.0))
        if self.slope is None:
            return ground
        least = min(
            ground.along,
            ground.across,
            *(min(patch.along, patch.across) for patch in ground.patches),
        )
        steepest = PARKING * math.atan(least)
        return dataclasses.replace(ground, slope=min(slope, steepest), uphill=uphill)

    def _patch(self, generator: np.random.Generator, base: Ground, path: Array) -> Patch:
        """Draw a square patch around a point of `path` (T, 3)."""
        x, y = path[generator.integers(len(path)), :2]
        half = uniform(generator, self.patch_size, 0.0) / 2
        along = base.along * uniform(generator, self.patch_friction, 1.0)
        ratio = base.across / base.along * uniform(generator, self.friction_ratio, 1.0)
        return Patch((x - half, x + half), (y - half, y + half), along, along * ratio)

    def require_standing(self, robot: RobotParameters) -> None:
        """Raise InvalidValueError if the robot would tip over with some of the drawn centres of
        mass.
        """
        for x, y in itertools.product(self.com_x, self.com_y):
            dataclasses.replace(robot, com_x=robot.com_x + x, com_y=robot.com_y + y)


def uniform(generator: np.random.Generator, ends: Range | None, otherwise: float) -> float:
    """Draw a number from a range, or return `otherwise` if it is None; both cases draw once from
    the generator.
    """
    low, high = (otherwise, otherwise) if ends is None else ends
    return low + (high - low) * float(generator.random())
