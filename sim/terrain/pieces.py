"""Ground pieces of a course: level, ramps, steps, stairs, gaps, side slopes, rough ground and given
heights.

A piece runs along x, from the point and height at which the piece before it ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from sim.terrain.solids import SLATE, STONE, Box, Grid, Level, Solid
from trackslip.errors import (
    Checked,
    checked,
    require,
    require_at_most,
    require_finite,
    require_whole,
    require_within,
)
from trackslip.kinematics import Array

_THICKNESS: Final = 0.1  # thickness of the boxes that form slopes [m]
_BLEND_CELL: Final = 0.1  # largest cell of the twisted ground next to a side slope [m]
MAX_LENGTH: Final = 200.0
"""Largest length and width of any part of a course [m]."""
MAX_NUMBER: Final = 500
"""Largest number of stairs, beams, blocks or pallets in a piece."""
LENGTH: Final = (require_within, 0.001, MAX_LENGTH, "m")
"""Check for lengths and widths on a course, as a function and its arguments."""
_MIN_HEIGHT: Final = 1e-4  # of any part of a course [m]
_MAX_HEIGHT: Final = 10.0  # [m]
HEIGHT: Final = (require_within, _MIN_HEIGHT, _MAX_HEIGHT, "m")
"""Check for heights above the ground, as a function and its arguments."""
NUMBER: Final = (require_whole, 1, MAX_NUMBER)
"""Check for the number of parts in a piece, as a function and its arguments."""
# of a ramp or a side slope
_ANGLE: Final = (require_within, -1.2, 1.2, "rad (69 degrees)")
_MAX_EXPONENT: Final = 8.0
_MAX_SAMPLES: Final = 1_000_000  # in a height field
# largest side of rough ground [samples]; its spectrum takes four times the square of this
_MAX_SIDE: Final = 2000
_MIN_CELL: Final = 0.005  # [m]


def _require_width(field: str, value: float) -> None:
    if value != math.inf:  # inf is the course's width
        require_within(field, value, *LENGTH[1:])


def _require_change(field: str, value: float) -> None:
    require_finite(field, value)
    allowed = f"from {_MIN_HEIGHT:g} to {_MAX_HEIGHT:g} m, or its negative to go down"
    require(_MIN_HEIGHT <= abs(value) <= _MAX_HEIGHT, field, value, allowed)


@dataclass(frozen=True)
class Site:
    """Position on the course for a piece."""

    x: float  # start of the piece along the course [m]
    z: float  # height at the start [m]
    width: float  # width of the course [m]
    rng: np.random.Generator  # random generator for this piece


@dataclass(frozen=True)
class Placed:
    """A piece at its position on the course."""

    solids: tuple[Solid, ...]
    x: float  # end of the piece along the course [m]
    z: float  # height at the end [m]


class Piece(Protocol):
    """A piece of a course, which can be placed at a site."""

    def place(self, site: Site) -> Placed:
        """The solids and the end of this piece if it starts at `site`."""


@dataclass(frozen=True)
class Flat(Checked):
    """Level ground."""

    length: float = checked(1.0, *LENGTH)
    """Length of the ground [m]."""

    def place(self, site: Site) -> Placed:
        """Place the ground at `site`; see `Piece`."""
        end = site.x + self.length
        ground = Level(site.x, end, site.width / 2, site.z)
        return Placed((ground,), end, site.z)


@dataclass(frozen=True)
class Ramp(Checked):
    """A slope up or down."""

    angle: float = checked(0.35, *_ANGLE)
    """Angle from the horizontal, negative downhill [rad]."""
    length: float = checked(2.0, *LENGTH)
    """Length along the slope [m]."""

    def place(self, site: Site) -> Placed:
        """Place the slope at `site`; see `Piece`."""
        cos = math.cos(self.angle)
        sin = math.sin(self.angle)
        end = site.x + self.length * cos
        height = site.z + self.length * sin
        # the middle of the slope, which is the box's upper face, and the box below it
        x = (site.x + end) / 2
        z = (site.z + height) / 2
        half = _THICKNESS / 2
        centre = (x + half * sin, 0.0, z - half * cos)
        # about -y: nose up
        turned = (math.cos(self.angle / 2), 0.0, -math.sin(self.angle / 2), 0.0)
        slope = Box(centre, (self.length / 2, site.width / 2, half), turned, SLATE)
        return Placed((slope,), end, height)


@dataclass(frozen=True)
class Step(Checked):
    """A single step up or down, with level ground behind it."""

    height: float = checked(0.1, _require_change)
    """Height of the step, negative for a step down [m]."""
    length: float = checked(1.5, *LENGTH)
    """Length of the ground behind the step [m]."""

    def place(self, site: Site) -> Placed:
        """Place the step at `site`; see `Piece`."""
        end = site.x + self.length
        height = site.z + self.height
        ground = Level(site.x, end, site.width / 2, height, SLATE)
        return Placed((ground,), end, height)


@dataclass(frozen=True)
class Stairs(Checked):
    """Stairs up or down; the next piece begins at the height of the last tread."""

    rise: float = checked(0.15, _require_change)
    """Height of each step, negative for stairs down [m]."""
    run: float = checked(0.28, *LENGTH)
    """Depth of each tread [m]."""
    number: int = checked(8, *NUMBER)
    """Number of steps."""
    width: float = checked(math.inf, _require_width)
    """Width of the stairs [m]; inf for the course's width."""

    def place(self, site: Site) -> Placed:
        """Place the stairs at `site`; see `Piece`."""
        half_width = min(self.width, site.width) / 2
        edges = (site.x + self.run * np.arange(self.number + 1)).tolist()
        heights = (site.z + self.rise * np.arange(1, self.number + 1)).tolist()
        treads = []
        for k, height in enumerate(heights):
            colour = STONE if k % 2 else SLATE
            treads.append(Level(edges[k], edges[k + 1], half_width, height, colour))
        return Placed(tuple(treads), edges[-1], heights[-1])


@dataclass(frozen=True)
class Gap(Checked):
    """A ditch across the course."""

    length: float = checked(0.3, *LENGTH)
    """Length of the gap from edge to edge [m]."""
    depth: float = checked(0.5, *HEIGHT)
    """Depth of the gap's bottom below the ground [m]."""

    def place(self, site: Site) -> Placed:
        """Place the gap at `site`; see `Piece`."""
        end = site.x + self.length
        bottom = Level(site.x, end, site.width / 2, site.z - self.depth, SLATE)
        return Placed((bottom,), end, site.z)


@dataclass(frozen=True)
class SideSlope(Checked):
    """Ground that slopes to one side, between two stretches that twist from level ground to the
    slope and back.
    """

    angle: float = checked(0.3, *_ANGLE)
    """Angle from the horizontal, negative if the left is lower [rad]."""
    length: float = checked(3.0, *LENGTH)
    """Length of the slope, without the twisted stretches [m]."""
    blend: float = checked(1.0, *LENGTH)
    """Length of each twisted stretch [m]."""

    def place(self, site: Site) -> Placed:
        """Place the slope at `site`, see `Piece`; the course's centre line stays level."""
        begin = site.x + self.blend
        end = begin + self.length
        twisted = self._twisted(site)
        before = Grid(site.x, self.blend, site.width, twisted)
        behind = Grid(end, self.blend, site.width, twisted[:, ::-1])
        return Placed((before, self._slope(site, begin, end), behind), end + self.blend, site.z)

    def _slope(self, site: Site, begin: float, end: float) -> Box:
        """The slope from `begin` to `end` along the course [m], the upper face of a box."""
        cos = math.cos(self.angle)
        sin = math.sin(self.angle)
        half = _THICKNESS / 2
        centre = ((begin + end) / 2, half * sin, site.z - half * cos)
        turned = (math.cos(self.angle / 2), math.sin(self.angle / 2), 0.0, 0.0)
        return Box(centre, (self.length / 2, site.width / 2 / cos, half), turned, SLATE)

    def _twisted(self, site: Site) -> Array:
        """Heights (rows, columns) of the ground from level to the slope [m]."""
        columns = _samples(self.blend)
        rows = _samples(site.width)
        left = np.linspace(-site.width / 2, site.width / 2, rows)[:, None]
        share = smooth_step(np.linspace(0.0, 1.0, columns))
        return site.z + left * math.tan(self.angle) * share


def _samples(size: float) -> int:
    """Number of samples in a twisted stretch of this size [m], along one side."""
    return max(2, math.ceil(size / _BLEND_CELL) + 1)


def smooth_step(share: Array) -> Array:
    """Smooth rise from 0 to 1 as `share` goes from 0 to 1, with level ends; constant outside this
    range.
    """
    share = np.clip(share, 0.0, 1.0)
    return share**2 * (3 - 2 * share)


@dataclass(frozen=True)
class Rough(Checked):
    """Random rough ground with a power spectrum that falls with the wave number; its ends are
    level.
    """

    length: float = checked(4.0, *LENGTH)
    """Length of the ground [m]."""
    amplitude: float = checked(0.1, *HEIGHT)
    """Height difference between the highest and the lowest point [m]."""
    exponent: float = checked(3.0, require_within, 0.0, _MAX_EXPONENT)
    """Exponent of the fall in spectral power per area with the wave number; 3 for roads (ISO 8608)
    [-].
    """
    cell: float = 0.1
    """Size of a cell of the height field [m]."""
    blend: float = 0.5
    """Length of the transition to level ground at each end [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_within("cell", self.cell, _MIN_CELL, self.length, "m, at most the length")
        require_within("blend", self.blend, 0.0, self.length / 2, "m, at most half of the length")

    def place(self, site: Site) -> Placed:
        """Place the rough ground at `site`; see `Piece`."""
        columns = max(2, round(self.length / self.cell)) + 1
        rows = max(2, round(site.width / self.cell)) + 1
        require_at_most("cells along a side of rough ground", max(rows, columns), _MAX_SIDE)
        require_at_most("samples of rough ground", rows * columns, _MAX_SAMPLES)
        waves = _noise(rows, columns, self.exponent, site.rng)
        if self.blend > 0:
            x = np.linspace(0.0, self.length, columns)
            from_ends = np.minimum(x, x[::-1])
            waves = waves * smooth_step(from_ends / self.blend)
        waves[:, [0, -1]] = 0.0  # flush with adjacent pieces
        heights = site.z + waves * (self.amplitude / np.ptp(waves))
        ground = Grid(site.x, self.length, site.width, heights)
        return Placed((ground,), site.x + self.length, site.z)


def _noise(rows: int, columns: int, exponent: float, rng: np.random.Generator) -> Array:
    """Gaussian noise (rows, columns) of mean 0, with power per area of wave numbers ~ wave number
    ** -exponent.

    The noise is cut from a square of twice its size, because noise from a Fourier sum repeats from
    edge to edge.
    """
    size = 2 * max(rows, columns)
    wave_number = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size))
    wave_number[0, 0] = np.inf
    amplitude = wave_number ** (-exponent / 2)
    white = np.fft.rfft2(rng.standard_normal((size, size)))
    noise = np.fft.irfft2(white * amplitude, (size, size))[:rows, :columns]
    return noise - noise.mean()


@dataclass(frozen=True, eq=False)
class HeightField(Checked):
    """Given heights; the mean of the first column joins the previous piece, that of the last column
    the next piece.
    """

    heights: Array
    """Heights (rows, columns) [m]: rows along y, to the left; columns along x, the driving
    direction.
    """
    length: float = checked(4.0, *LENGTH)
    """Length from the first to the last column [m]."""
    width: float = checked(math.inf, _require_width)
    """Width from the first to the last row [m]; inf for the course's width."""

    def __post_init__(self) -> None:
        try:
            values = np.asarray(self.heights, float)
        except (TypeError, ValueError):  # also for rows of different lengths
            values = np.array(np.nan)
        is_grid = values.ndim == 2 and min(values.shape) >= 2
        valid = is_grid and bool(np.isfinite(values).all())
        allowed = "finite numbers in rows and columns, two of each at least"
        require(valid, "heights", f"of shape {values.shape}", allowed)
        require_at_most("samples of heights", values.size, _MAX_SAMPLES)
        require_at_most("range of heights", float(np.ptp(values)), MAX_LENGTH, "m")
        super().__post_init__()

    def place(self, site: Site) -> Placed:
        """Place the height field at `site`; see `Piece`."""
        heights = np.asarray(self.heights, float)
        heights = heights + (site.z - heights[:, 0].mean())
        width = site.width if self.width == math.inf else self.width
        ground = Grid(site.x, self.length, width, heights)
        return Placed((ground,), site.x + self.length, float(heights[:, -1].mean()))
