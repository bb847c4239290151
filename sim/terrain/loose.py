"""Obstacles on level ground: beams across the course, pallets, and blocks at any position."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import MISSING, dataclass
from typing import Final

import numpy as np

from sim.terrain.pieces import HEIGHT, LENGTH, MAX_LENGTH, MAX_NUMBER, NUMBER, Placed, Site
from sim.terrain.solids import STONE, WOOD, Box, Level, Solid
from trackslip.errors import Checked, checked, require, require_within

_MAX_YAW: Final = 0.8  # [rad]
# a European pallet: its blocks, and the boards above and below them, form three solid bearers [m]
_WIDTH: Final = 1.2
_DEPTH: Final = 0.8
_HEIGHT: Final = 0.144
_BOARD: Final = 0.022  # thickness of a board
# x, width
_BOARDS: Final = ((-0.3275, 0.145), (-0.1635, 0.1), (0.0, 0.145), (0.1635, 0.1), (0.3275, 0.145))
_BEARERS: Final = ((-0.55, 0.1), (0.0, 0.145), (0.55, 0.1))  # y, width


@dataclass(frozen=True)
class Beams(Checked):
    """Square beams on level ground, across the course."""

    size: float = checked(0.1, *HEIGHT)
    """Height and thickness of each beam [m]."""
    spacing: float = checked(0.6, *LENGTH)
    """Distance between the centres of adjacent beams [m]."""
    number: int = checked(6, *NUMBER)
    """Number of beams."""
    yaw: float = checked(0.0, require_within, 0.0, _MAX_YAW, "rad")
    """Largest angle by which a beam is turned to either side, drawn uniformly [rad]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        allowed = f"greater than the beams' size, {self.size:g} m"
        require(self.spacing > self.size, "spacing", self.spacing, allowed)

    def place(self, site: Site) -> Placed:
        """Place the beams at `site`; see `Piece`."""
        half = self.size / 2
        # keeps beams off other pieces
        margin = self.spacing / 2 + site.width / 2 * math.sin(self.yaw)
        end = site.x + 2 * margin + (self.number - 1) * self.spacing
        yaw = site.rng.uniform(-self.yaw, self.yaw, self.number)
        size = (half, site.width / 2, half)
        first = site.x + margin
        solids: list[Solid] = [Level(site.x, end, site.width / 2, site.z)]
        for k, angle in enumerate(yaw.tolist()):
            centre = (first + k * self.spacing, 0.0, site.z + half)
            solids.append(Box(centre, size, _turned(angle), WOOD))
        return Placed(tuple(solids), end, site.z)


@dataclass(frozen=True)
class Blocks(Checked):
    """Blocks on level ground, such as rails, piles or a kerb under one of the tracks."""

    blocks: tuple[tuple[float, float, float, float, float, float], ...]
    """Numbers for each block: x of its centre from the piece's start, y to the left of the course's
    centre line, length and width before turning, height [m], yaw [rad].
    """
    length: float = checked(MISSING, *LENGTH)
    """Length of the piece [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.blocks)
        require(1 <= count <= MAX_NUMBER, "blocks", f"{count} blocks", f"1 to {MAX_NUMBER}")
        for block in self.blocks:
            require(np.shape(block) == (6,), "blocks", block, "x, y, length, width, height and yaw")
            x, y, along, across, height, yaw = block
            require_within("x of a block", x, 0.0, self.length, "m")
            require_within("y of a block", y, -MAX_LENGTH, MAX_LENGTH, "m")
            require_within("length of a block", along, *LENGTH[1:])
            require_within("width of a block", across, *LENGTH[1:])
            require_within("height of a block", height, *HEIGHT[1:])
            require_within("yaw of a block", yaw, -math.pi, math.pi, "rad")

    def place(self, site: Site) -> Placed:
        """Place the blocks at `site`; see `Piece`."""
        end = site.x + self.length
        solids: list[Solid] = [Level(site.x, end, site.width / 2, site.z)]
        for x, y, along, across, height, yaw in self.blocks:
            centre = (site.x + x, y, site.z + height / 2)
            half = (along / 2, across / 2, height / 2)
            solids.append(Box(centre, half, _turned(yaw), STONE))
        return Placed(tuple(solids), end, site.z)


@dataclass(frozen=True)
class Pallets(Checked):
    """Pallets of 0.8 x 1.2 m on level ground: five boards across, on three bearers.

    Each row has the largest odd number of pallets that fit side by side, so that one of them is in
    the middle.
    """

    number: int = checked(3, *NUMBER)
    """Number of rows of pallets, which follow each other along the course."""
    spacing: float = checked(1.6, *LENGTH)
    """Distance between the centres of adjacent rows [m]."""
    yaw: float = checked(0.0, require_within, 0.0, _MAX_YAW, "rad")
    """Largest angle by which a pallet is turned to either side, drawn uniformly [rad]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        depth, _ = self._reach
        allowed = f"greater than the depth of a pallet, {depth:.3g} m"
        require(self.spacing > depth, "spacing", self.spacing, allowed)

    @property
    def _reach(self) -> tuple[float, float]:
        """Largest extent of a turned pallet along and across the course [m]."""
        cos = math.cos(self.yaw)
        sin = math.sin(self.yaw)
        return _DEPTH * cos + _WIDTH * sin, _WIDTH * cos + _DEPTH * sin

    def place(self, site: Site) -> Placed:
        """Place the pallets at `site`; see `Piece`."""
        _, width = self._reach
        beside = int((site.width / width - 1) / 2)  # to either side of the middle
        y = np.arange(-beside, beside + 1) * width
        x = site.x + (np.arange(self.number) + 0.5) * self.spacing
        yaw = site.rng.uniform(-self.yaw, self.yaw, (self.number, len(y)))
        end = site.x + self.number * self.spacing
        solids: list[Solid] = [Level(site.x, end, site.width / 2, site.z)]
        for row, column in np.ndindex(yaw.shape):
            angle = float(yaw[row, column])
            solids += _pallet(float(x[row]), float(y[column]), site.z, angle)
        return Placed(tuple(solids), end, site.z)


def _pallet(x: float, y: float, z: float, yaw: float) -> Iterator[Solid]:
    """The boards and bearers of a pallet with its centre at x, y on ground at the height z [m]."""
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    turned = _turned(yaw)
    under = _HEIGHT - _BOARD
    for along, width in _BOARDS:
        centre = (x + along * cos, y + along * sin, z + under + _BOARD / 2)
        yield Box(centre, (width / 2, _WIDTH / 2, _BOARD / 2), turned, WOOD)
    for across, width in _BEARERS:
        centre = (x - across * sin, y + across * cos, z + under / 2)
        yield Box(centre, (_DEPTH / 2, width / 2, under / 2), turned, WOOD)


def _turned(yaw: float) -> tuple[float, float, float, float]:
    return math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
