"""Pieces that are height fields: rough ground and given heights."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim.terrain.pieces import MAX_LENGTH, Placed, Site, require_height, require_length, require_width, smooth_step
from sim.terrain.solids import Grid
from trackslip.errors import Checked, InvalidValueError, checked, require, require_at_most, require_within
from trackslip.kinematics import Array

_MAX_EXPONENT = 8.0
_MAX_SAMPLES = 1_000_000  # of a height field
_MAX_SIDE = 2000  # samples along a side of rough ground, whose spectrum takes four times its square
_MIN_CELL = 0.005  # [m]


@dataclass(frozen=True)
class Rough(Checked):
    """Random rough ground whose power spectrum falls with the wave number; it begins and ends level."""

    length: float = checked(4.0, require_length)
    """Length [m]."""
    amplitude: float = checked(0.1, require_height)
    """From the lowest to the highest point [m]."""
    exponent: float = checked(3.0, require_within, 0.0, _MAX_EXPONENT)
    """Exponent with which spectral power per area falls with the wave number; 3 as of roads (ISO 8608)."""
    cell: float = 0.1
    """Size of a cell of the height field [m]."""
    blend: float = 0.5
    """Length of the transition to level ground at either end [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_within("cell", self.cell, _MIN_CELL, self.length, "m, at most the length")
        require_within("blend", self.blend, 0.0, self.length / 2, "m, at most half of the length")

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        columns, rows = (max(2, round(size / self.cell)) + 1 for size in (self.length, site.width))
        require_at_most("cells along a side of rough ground", max(rows, columns), _MAX_SIDE)
        require_at_most("samples of rough ground", rows * columns, _MAX_SAMPLES)
        waves = _noise(rows, columns, self.exponent, site.rng)
        if self.blend > 0:
            x = np.linspace(0.0, self.length, columns)
            waves = waves * smooth_step(np.minimum(x, x[::-1]) / self.blend)
        waves[:, [0, -1]] = 0.0  # flush with what it lies between
        heights = site.z + waves * (self.amplitude / np.ptp(waves))
        end = site.x + self.length
        return Placed((Grid(site.x, self.length, site.width, heights),), end, site.z)


def _noise(rows: int, columns: int, exponent: float, rng: np.random.Generator) -> Array:
    """Gaussian noise (rows, columns) of mean 0 whose power per area of wave numbers is ~ wave number ** -exponent.

    It is cut from a square of twice the size: noise from a Fourier sum repeats itself from edge to edge.
    """
    size = 2 * max(rows, columns)
    wave_number = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size))
    wave_number[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((size, size))) * wave_number ** (-exponent / 2)
    noise = np.fft.irfft2(spectrum, (size, size))[:rows, :columns]
    return noise - noise.mean()


@dataclass(frozen=True, eq=False)
class HeightField(Checked):
    """Given heights; the mean of the first column joins the piece before, that of the last the piece behind."""

    heights: Array
    """Heights (rows, columns) [m]: rows along y, to the left, columns along x, the way to drive."""
    length: float = checked(4.0, require_length)
    """Length from the first to the last column [m]."""
    width: float = checked(math.inf, require_width)
    """Width from the first to the last row [m]; inf: the course's width."""

    def __post_init__(self) -> None:
        try:
            shape = np.shape(self.heights)
        except ValueError:
            raise InvalidValueError("heights", self.heights, "rows of equal lengths") from None
        require(len(shape) == 2 and min(shape) >= 2, "shape of heights", shape, "(rows, columns), at least (2, 2)")
        require_at_most("samples of heights", int(np.prod(shape)), _MAX_SAMPLES)
        values = np.ravel(self.heights)
        wrong = values[~np.isfinite(values)] if values.dtype.kind in "iuf" else values
        require(len(wrong) == 0, "heights", wrong[:1].tolist(), "finite numbers")
        require_at_most("range of heights", float(np.ptp(values)), MAX_LENGTH, "m")
        super().__post_init__()

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        heights = np.asarray(self.heights, float)
        width = site.width if self.width == math.inf else self.width
        heights = heights + (site.z - heights[:, 0].mean())
        end = site.x + self.length
        return Placed((Grid(site.x, self.length, width, heights),), end, float(heights[:, -1].mean()))
