"""Solids of a course: level blocks, boxes in any attitude and height fields."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import mujoco
import numpy as np
from mujoco import batch

from trackslip.kinematics import Array

Colour = tuple[float, float, float, float]
_ASIDE = 1e-12  # [m]
STONE: Colour = (0.62, 0.64, 0.66, 1.0)
SLATE: Colour = (0.40, 0.43, 0.47, 1.0)
WOOD: Colour = (0.72, 0.55, 0.35, 1.0)
EARTH: Colour = (0.55, 0.47, 0.37, 1.0)
_NO_TURNING = 0.005, 0.0001  # torsional and rolling friction, MuJoCo's defaults, without effect in three dimensions [m]


@dataclass(frozen=True)
class Base:
    """Properties shared by the geoms of a course."""

    floor: float
    """Height of the floor below the course [m]."""
    friction: float
    """Coefficient of sliding friction."""
    x: float = 0.0
    """Place of the course's origin in the world [m]."""
    y: float = 0.0
    """Place of the course's origin in the world [m]."""
    name: str = "course"
    """Prefix of the names of everything the course adds to the model."""
    looks: bool = True
    """Draw the supports of slopes."""


class Solid(Protocol):
    """A part of a course."""

    @property
    def bounds(self) -> Array:
        """Corners of an upright box around the upper surface, (2, 3) [m]."""

    def add_to(self, spec: mujoco.MjSpec, name: str, base: Base) -> None:
        """Add the solid to the world body as a geom called `name`."""


@dataclass(frozen=True)
class Level:
    """A block that stands on the floor, with a level top."""

    x0: float
    """Beginning along the course [m]."""
    x1: float
    """End along the course [m]."""
    half_width: float
    """Half of its width; it is centred on the x axis [m]."""
    z: float
    """Height of its top [m]."""
    colour: Colour = STONE

    @property
    def bounds(self) -> Array:
        """See `Solid`."""
        return np.array([[self.x0, -self.half_width, self.z], [self.x1, self.half_width, self.z]])

    def continues(self, behind: Level) -> bool:
        """True if the block `behind` continues this one without an edge."""
        return (self.x1, self.z, self.half_width) == (behind.x0, behind.z, behind.half_width)

    def add_to(self, spec: mujoco.MjSpec, name: str, base: Base) -> None:
        """See `Solid`."""
        half_height = (self.z - base.floor) / 2
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[(self.x1 - self.x0) / 2, self.half_width, half_height],
            pos=[base.x + (self.x0 + self.x1) / 2, base.y, self.z - half_height],
            **look(self.colour, base),
        )


@dataclass(frozen=True)
class Box:
    """A box in any attitude."""

    centre: tuple[float, float, float]
    """Its centre [m]."""
    half: tuple[float, float, float]
    """Half of its length, width and height [m]."""
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Its attitude: w, x, y, z."""
    colour: Colour = STONE

    @cached_property
    def rotation(self) -> Array:
        """Its axes, as the columns of a matrix (3, 3)."""
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, np.array(self.quaternion))
        return matrix.reshape(3, 3)

    @property
    def bounds(self) -> Array:
        """See `Solid`."""
        reach = np.abs(self.rotation) @ np.array(self.half)
        return np.array(self.centre) + np.array([[-1.0], [1.0]]) * reach

    def add_to(self, spec: mujoco.MjSpec, name: str, base: Base) -> None:
        """See `Solid`."""
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=list(self.half),
            pos=[base.x + self.centre[0], base.y + self.centre[1], self.centre[2]],
            quat=list(self.quaternion),
            **look(self.colour, base),
        )
        if base.looks and self.rotation[2, 2] < 1:
            self._add_skirt(spec, f"{name}/skirt", base)

    def _add_skirt(self, spec: mujoco.MjSpec, name: str, base: Base) -> None:
        """Draw the support of a sloping box, from its lower face to the floor; it doesn't collide."""
        signs = np.array([[i, j, -1.0] for i in (-1, 1) for j in (-1, 1)])
        lower = self.centre + signs * self.half @ self.rotation.T + [base.x, base.y, 0.0]  # (4, 3)
        below = np.column_stack([lower[:, :2], np.full(4, base.floor)])
        spec.add_mesh(name=name, uservert=np.concatenate([lower, below]).ravel())
        seen = look(self.colour, base) | {"contype": 0, "conaffinity": 0}
        spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **seen)


@dataclass(frozen=True, eq=False)
class Grid:
    """A height field: heights at the corners of rectangles, each of which is two triangles."""

    x0: float
    """Beginning along the course [m]."""
    length: float
    """Its length along x [m]."""
    width: float
    """Its width; it is centred on the x axis [m]."""
    heights: Array
    """Heights (rows, columns) [m]: rows along y, columns along x, each in ascending order."""
    colour: Colour = EARTH

    @property
    def bounds(self) -> Array:
        """See `Solid`."""
        low = [self.x0, -self.width / 2, self.heights.min()]
        return np.array([low, [self.x0 + self.length, self.width / 2, self.heights.max()]])

    def add_to(self, spec: mujoco.MjSpec, name: str, base: Base) -> None:
        """See `Solid`."""
        rows, columns = self.heights.shape
        low, high = float(self.heights.min()), float(self.heights.max())
        span = (high - low) or 1.0
        size, shares = [self.length / 2, self.width / 2, span, low - base.floor], (self.heights - low) / span
        spec.add_hfield(name=name, nrow=rows, ncol=columns, size=size, userdata=shares.astype(np.float32).ravel())
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_HFIELD,
            hfieldname=name,
            pos=[base.x + self.x0 + self.length / 2, base.y, low],
            **look(self.colour, base),
        )


def look(colour: Colour, base: Base) -> dict[str, Any]:
    """Arguments of `add_geom` common to all geoms of a course, overriding the model's defaults."""
    return {
        "rgba": list(colour),
        "material": f"{base.name}/lines",
        "friction": [base.friction, *_NO_TURNING],
        "condim": 3,
        "contype": 1,
        "conaffinity": 1,
        "group": 0,
    }


def seen_from_above(model: mujoco.MjModel, points: Array, above: float) -> tuple[Array, Array]:
    """Heights (P,) [m] and unit normals (P, 3) of the highest surface at `points` (P, 2), by rays down from `above`.

    Each point is looked at a trifle aside, in four directions, so that edges belong to the solids that end there. The
    height is -inf where there is nothing.
    """
    sides = np.array([*itertools.product((-_ASIDE, _ASIDE), repeat=2)])
    beside = (points + sides[:, None]).reshape(-1, 2)
    origin = np.column_stack([beside, np.full(len(beside), above)])
    distance, _, normal = batch.Batch(model, 1, nthread=1).ray(origin, np.array([0.0, 0.0, -1.0]), normal=True)
    seen = np.where(distance[0] >= 0, above - distance[0], -np.inf).reshape(len(sides), -1)
    side, point = seen.argmax(axis=0), np.arange(len(points))
    height = seen[side, point]
    upward = np.where(np.isfinite(height)[:, None], normal[0].reshape(len(sides), -1, 3)[side, point], 0.0)
    return height, upward
