"""Pieces of a course with plane surfaces: level ground, ramps, steps, stairs, gaps and side slopes.

A piece begins where the one before it ended, at its height, and runs along x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.terrain.solids import SLATE, STONE, Box, Grid, Level, Solid
from trackslip.errors import Checked, checked, require, require_finite, require_whole, require_within
from trackslip.kinematics import Array

_THICKNESS = 0.1  # of the boxes of slopes [m]
_BLEND_CELL = 0.1  # largest cell of the twisted ground beside a side slope [m]


MAX_LENGTH = 200.0
"""Largest length and width of anything on a course [m]."""
_MIN_LENGTH = 0.001  # [m]
_MIN_HEIGHT, _MAX_HEIGHT = 1e-4, 10.0  # of anything on a course [m]
_MAX_ANGLE = 1.2  # of a ramp or a side slope [rad]
MAX_NUMBER = 500
"""Largest number of stairs, beams, blocks or pallets in a piece."""


def require_length(field: str, value: float) -> None:
    """Raise InvalidValueError unless a course may have `value` as a length or width [m]."""
    require_within(field, value, _MIN_LENGTH, MAX_LENGTH, "m")


def require_width(field: str, value: float) -> None:
    """Raise InvalidValueError unless `value` is a width on a course [m], or infinite for the course's."""
    if value != math.inf:
        require_length(field, value)


def require_height(field: str, value: float) -> None:
    """Raise InvalidValueError unless `value` is a height above the ground [m]."""
    require_within(field, value, _MIN_HEIGHT, _MAX_HEIGHT, "m")


def require_number(field: str, value: int) -> None:
    """Raise InvalidValueError unless a piece may have `value` parts of a kind."""
    require_whole(field, value, 1, MAX_NUMBER)


def _require_change(field: str, value: float) -> None:
    allowed = f"from {_MIN_HEIGHT:g} to {_MAX_HEIGHT:g} m, or its negative to go down"
    require_finite(field, value)
    require(_MIN_HEIGHT <= abs(value) <= _MAX_HEIGHT, field, value, allowed)


def _require_angle(name: str, value: float) -> None:
    require_within(name, value, -_MAX_ANGLE, _MAX_ANGLE, f"rad ({math.degrees(_MAX_ANGLE):.0f} degrees)")


@dataclass(frozen=True)
class Site:
    """Place of a piece on its course."""

    x: float  # beginning along the course [m]
    z: float  # height there [m]
    width: float  # width of the course [m]
    rng: np.random.Generator  # random numbers of this piece


@dataclass(frozen=True)
class Placed:
    """A piece in its place."""

    solids: tuple[Solid, ...]
    x: float  # end along the course [m]
    z: float  # height there [m]


class Piece(Protocol):
    """A piece of a course."""

    def place(self, site: Site) -> Placed:
        """The solids of this piece, at `site`."""


@dataclass(frozen=True)
class Flat(Checked):
    """Level ground."""

    length: float = checked(1.0, require_length)
    """Length [m]."""

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        end = site.x + self.length
        return Placed((Level(site.x, end, site.width / 2, site.z),), end, site.z)


@dataclass(frozen=True)
class Ramp(Checked):
    """A slope up or down."""

    angle: float = checked(0.35, _require_angle)
    """Angle with the horizontal, < 0 down [rad]."""
    length: float = checked(2.0, require_length)
    """Length along the slope [m]."""

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        end, height = site.x + self.length * cos, site.z + self.length * sin
        half = _THICKNESS / 2
        centre = ((site.x + end) / 2 + half * sin, 0.0, (site.z + height) / 2 - half * cos)
        turned = (math.cos(self.angle / 2), 0.0, -math.sin(self.angle / 2), 0.0)  # nose up about -y
        return Placed((Box(centre, (self.length / 2, site.width / 2, half), turned, SLATE),), end, height)


@dataclass(frozen=True)
class Step(Checked):
    """A single step up or down, and level ground behind it."""

    height: float = checked(0.1, _require_change)
    """Height, < 0 down [m]."""
    length: float = checked(1.5, require_length)
    """Length of the ground behind it [m]."""

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        end, height = site.x + self.length, site.z + self.height
        return Placed((Level(site.x, end, site.width / 2, height, SLATE),), end, height)


@dataclass(frozen=True)
class Stairs(Checked):
    """Stairs up or down; the last tread is at the height of what follows."""

    rise: float = checked(0.15, _require_change)
    """Height of a step, < 0 down [m]."""
    run: float = checked(0.28, require_length)
    """Depth of a tread [m]."""
    number: int = checked(8, require_number)
    """Number of steps."""
    width: float = checked(math.inf, require_width)
    """Width [m]; inf: the course's width."""

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        half_width = min(self.width, site.width) / 2
        edges = site.x + self.run * np.arange(self.number + 1)
        heights = site.z + self.rise * np.arange(1, self.number + 1)
        treads = tuple(
            Level(float(edges[k]), float(edges[k + 1]), half_width, float(heights[k]), STONE if k % 2 else SLATE)
            for k in range(self.number)
        )
        return Placed(treads, treads[-1].x1, treads[-1].z)


@dataclass(frozen=True)
class Gap(Checked):
    """A ditch across the course."""

    length: float = checked(0.3, require_length)
    """Length from edge to edge [m]."""
    depth: float = checked(0.5, require_height)
    """Depth of its bottom [m]."""

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        end = site.x + self.length
        return Placed((Level(site.x, end, site.width / 2, site.z - self.depth, SLATE),), end, site.z)


@dataclass(frozen=True)
class SideSlope(Checked):
    """Ground that falls to one side, between two stretches that twist from level to the slope and back."""

    angle: float = checked(0.3, _require_angle)
    """Angle with the horizontal, < 0 if the left is lower [rad]."""
    length: float = checked(3.0, require_length)
    """Length of the slope, without the twisted stretches [m]."""
    blend: float = checked(1.0, require_length)
    """Length of each twisted stretch [m]."""

    def place(self, site: Site) -> Placed:
        """See `Piece`. The middle of the course stays level."""
        begin = site.x + self.blend
        end = begin + self.length
        cos, sin, half = math.cos(self.angle), math.sin(self.angle), _THICKNESS / 2
        turned = (math.cos(self.angle / 2), math.sin(self.angle / 2), 0.0, 0.0)
        centre = ((begin + end) / 2, half * sin, site.z - half * cos)
        slope = Box(centre, (self.length / 2, site.width / 2 / cos, half), turned, SLATE)
        columns, rows = (max(2, math.ceil(size / _BLEND_CELL) + 1) for size in (self.blend, site.width))
        across = np.linspace(-site.width / 2, site.width / 2, rows)[:, None] * math.tan(self.angle)
        twisted = site.z + across * smooth_step(np.linspace(0.0, 1.0, columns))
        before = Grid(site.x, self.blend, site.width, twisted)
        behind = Grid(end, self.blend, site.width, twisted[:, ::-1])
        return Placed((before, slope, behind), end + self.blend, site.z)


def smooth_step(share: Array) -> Array:
    """From 0 to 1 as `share` goes from 0 to 1, with level ends; constant beyond."""
    share = np.clip(share, 0.0, 1.0)
    return share**2 * (3 - 2 * share)
