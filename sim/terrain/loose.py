"""Obstacles on level ground: beams across the course, pallets, and blocks at any position."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import MISSING, dataclass

import numpy as np

from sim.terrain.pieces import HEIGHT, LENGTH, MAX_LENGTH, MAX_NUMBER, NUMBER, Placed, Site
from sim.terrain.solids import STONE, WOOD, Box, Level, Solid
from trackslip.errors import Checked, checked, require, require_within

_MAX_YAW = 0.8  # [rad]
# a European pallet: its blocks, and the boards above and below them, form three solid bearers [m]
_WIDTH, _DEPTH, _HEIGHT, _BOARD = 1.2, 0.8, 0.144, 0.022
# x, width
_BOARDS = ((-0.3275, 0.145), (-0.1635, 0.1), (0.0, 0.145), (0.1635, 0.1), (0.3275, 0.145))
_BEARERS = ((-0.55, 0.1), (0.0, 0.145), (0.55, 0.1))  # y, width


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
        require(
            self.spacing > self.size,
            "spacing",
            self.spacing,
            f"greater than the beams' size, {self.size:g} m",
        )

    def place(self, site: Site) -> Placed:
        """Place the beams at `site`; see `Piece`."""
        half = self.size / 2
        # keeps beams off other pieces
        margin = self.spacing / 2 + site.width / 2 * math.sin(self.yaw)
        end = site.x + 2 * margin + (self.number - 1) * self.spacing
        yaw = site.rng.uniform(-self.yaw, self.yaw, self.number)
        size, x = (half, site.width / 2, half), site.x + margin
        beams = tuple(
            Box((x + k * self.spacing, 0.0, site.z + half), size, _turned(angle), WOOD)
            for k, angle in enumerate(yaw.tolist())
        )
        return Placed((Level(site.x, end, site.width / 2, site.z), *beams), end, site.z)


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
        require(
            1 <= len(self.blocks) <= MAX_NUMBER,
            "blocks",
            f"{len(self.blocks)} blocks",
            f"1 to {MAX_NUMBER}",
        )
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
        solids = (
            Box(
                (site.x + x, y, site.z + height / 2),
                (along / 2, across / 2, height / 2),
                _turned(yaw),
                STONE,
            )
            for x, y, along, across, height, yaw in self.blocks
        )
        return Placed((Level(site.x, end, site.width / 2, site.z), *solids), end, site.z)


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
        require(
            self.spacing > depth,
            "spacing",
            self.spacing,
            f"greater than the depth of a pallet, {depth:.3g} m",
        )

    @property
    def _reach(self) -> tuple[float, float]:
        """Largest extent of a turned pallet along and across the course [m]."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return _DEPTH * cos + _WIDTH * sin, _WIDTH * cos + _DEPTH * sin

    def place(self, site: Site) -> Placed:
        """Place the pallets at `site`; see `Piece`."""
        width = self._reach[1]
        beside = int((site.width / width - 1) / 2)  # to either side of the middle
        y = np.arange(-beside, beside + 1) * width
        x = site.x + (np.arange(self.number) + 0.5) * self.spacing
        yaw = site.rng.uniform(-self.yaw, self.yaw, (self.number, len(y)))
        end = site.x + self.number * self.spacing
        pallets = [
            part
            for row, column in np.ndindex(yaw.shape)
            for part in _pallet(float(x[row]), float(y[column]), site.z, float(yaw[row, column]))
        ]
        return Placed((Level(site.x, end, site.width / 2, site.z), *pallets), end, site.z)


def _pallet(x: float, y: float, z: float, yaw: float) -> Iterator[Solid]:
    cos, sin = math.cos(yaw), math.sin(yaw)
    under = _HEIGHT - _BOARD
    for along, across in _BOARDS:
        middle = x + along * cos, y + along * sin, z + under + _BOARD / 2
        yield Box(middle, (across / 2, _WIDTH / 2, _BOARD / 2), _turned(yaw), WOOD)
    for along, across in _BEARERS:
        middle = x - along * sin, y + along * cos, z + under / 2
        yield Box(middle, (_DEPTH / 2, across / 2, under / 2), _turned(yaw), WOOD)


def _turned(yaw: float) -> tuple[float, float, float, float]:
    return math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
