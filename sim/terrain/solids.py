"""Solids of a course: level blocks, boxes in any attitude and height fields, as geoms and as exact
surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackslip.kinematics import Array

Colour = tuple[float, float, float, float]
EDGE: Final = 1e-12
"""Tolerance for points that are just outside a solid due to rounding [m]."""
STONE: Final[Colour] = (0.62, 0.64, 0.66, 1.0)
SLATE: Final[Colour] = (0.40, 0.43, 0.47, 1.0)
WOOD: Final[Colour] = (0.72, 0.55, 0.35, 1.0)
EARTH: Final[Colour] = (0.55, 0.47, 0.37, 1.0)
LINES: Final = "course/lines"
"""Name of the material that all geoms of a course have."""
# torsional and rolling friction: MuJoCo's defaults, ignored for condim 3 [m]
_NO_TURNING: Final = (0.005, 0.0001)


@dataclass(frozen=True)
class Base:
    """Properties that all geoms of a course share."""

    floor: float  # height of the floor under the course [m]
    friction: float  # coefficient of sliding friction [-]
    looks: bool = True  # whether to draw the supports of slopes


class Solid(Protocol):
    """A part of a course."""

    @property
    def bounds(self) -> Array:
        """Opposite corners (2, 3) of an upright box around the solid's upper surface [m]."""

    def height(self, x: Array, y: Array) -> Array:
        """Heights (P,) of the solid's upper surface at points x, y (P,), -inf outside the solid
        [m].
        """

    def add_to(self, spec: mujoco.MjSpec, name: str, base: Base) -> None:
        """Add the solid to the world body in `spec` as a geom called `name`."""


@dataclass(frozen=True)
class Level:
    """A block with a level top that stands on the floor."""

    x0: float  # start along the course [m]
    x1: float  # end along the course [m]
    half_width: float  # half of the width, centred on the x axis [m]
    z: float  # height of the top [m]
    colour: Colour = STONE

    @property
    def bounds(self) -> Array:
        """Corners (2, 3) of a box around the top; see `Solid`."""
        return np.array([[self.x0, -self.half_width, self.z], [self.x1, self.half_width, self.z]])

    def height(self, x: Array, y: Array) -> Array:
        """Heights (P,) of the top; see `Solid`."""
        is_along = (x >= self.x0 - EDGE) & (x <= self.x1 + EDGE)
        is_across = np.abs(y) <= self.half_width + EDGE
        return np.where(is_along & is_across, self.z, -np.inf)

    def continues(self, behind: Level) -> bool:
        """Whether the block `behind` continues this block without an edge."""
        return (self.x1, self.z, self.half_width) == (behind.x0, behind.z, behind.half_width)

    def add_to(self, spec: mujoco.MjSpec, name: str, base: Base) -> None:
        """Add the block to `spec`; see `Solid`."""
        half_length = (self.x1 - self.x0) / 2
        half_height = (self.z - base.floor) / 2
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[half_length, self.half_width, half_height],
            pos=[(self.x0 + self.x1) / 2, 0.0, self.z - half_height],
            **look(self.colour, base),
        )


@dataclass(frozen=True)
class Box:
    """A box in any attitude."""

    centre: tuple[float, float, float]  # position of the box [m]
    half: tuple[float, float, float]  # half of length, width and height [m]
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)  # attitude w, x, y, z
    colour: Colour = STONE

    @cached_property
    def rotation(self) -> Array:
        """Matrix (3, 3) whose columns are the box's axes."""
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, np.array(self.quaternion))
        return matrix.reshape(3, 3)

    @property
    def bounds(self) -> Array:
        """Corners (2, 3) of an upright box around this box; see `Solid`."""
        reach = np.abs(self.rotation) @ np.array(self.half)
        return np.array(self.centre) + np.array([[-1.0], [1.0]]) * reach

    def height(self, x: Array, y: Array) -> Array:
        """Heights (P,), see `Solid`: where vertical lines first leave any of the slabs between
        opposite faces.

        In the box's frame, the vertical line through a point begins at `start` at the height of the
        centre, and moves along an axis of the box by `rise` per height. It is within the slab
        across this axis from a height `reach` below the `middle` to as much above it.
        """
        centre = np.array(self.centre)
        half = np.array(self.half) + EDGE
        beside = np.stack([x - centre[0], y - centre[1], np.zeros(len(x))])
        start = self.rotation.T @ beside  # (3, P)
        enters = np.full(len(x), -np.inf)
        leaves = np.full(len(x), np.inf)
        for axis, rise in enumerate(self.rotation[2]):
            if rise == 0:  # the line is parallel to the slab
                leaves[np.abs(start[axis]) > half[axis]] = -np.inf
                continue
            middle = -start[axis] / rise
            reach = half[axis] / abs(rise)
            np.maximum(enters, middle - reach, out=enters)
            np.minimum(leaves, middle + reach, out=leaves)
        return np.where(enters <= leaves, centre[2] + leaves, -np.inf)

    def add_to(self, spec: mujoco.MjSpec, name: str, base: Base) -> None:
        """Add the box to `spec`; see `Solid`."""
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=list(self.half),
            pos=list(self.centre),
            quat=list(self.quaternion),
            **look(self.colour, base),
        )
        if base.looks and self.rotation[2, 2] < 1:
            self._add_skirt(spec, f"{name}/skirt", base)

    def _add_skirt(self, spec: mujoco.MjSpec, name: str, base: Base) -> None:
        """Draw the support of a sloping box, from its lower face down to the floor; the support
        doesn't collide.
        """
        length, width, height = self.half
        corners = [
            (-length, -width, -height),
            (-length, width, -height),
            (length, -width, -height),
            (length, width, -height),
        ]
        lower = self.centre + np.array(corners) @ self.rotation.T  # (4, 3)
        on_floor = np.column_stack([lower[:, :2], np.full(4, base.floor)])
        spec.add_mesh(name=name, uservert=np.concatenate([lower, on_floor]).ravel())
        seen = look(self.colour, base) | {"contype": 0, "conaffinity": 0}
        spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **seen)


@dataclass(frozen=True, eq=False)
class Grid:
    """A height field: heights at the corners of rectangles, which consist of two triangles each."""

    x0: float  # start along the course [m]
    length: float  # length along x [m]
    width: float  # width, centred on the x axis [m]
    heights: Array  # heights (rows, columns) [m]: rows along y, columns along x, both ascending
    colour: Colour = EARTH

    @property
    def bounds(self) -> Array:
        """Corners (2, 3) of a box around the surface; see `Solid`."""
        low = [self.x0, -self.width / 2, self.heights.min()]
        high = [self.x0 + self.length, self.width / 2, self.heights.max()]
        return np.array([low, high])

    @cached_property
    def _stored(self) -> tuple[float, float, NDArray[np.float32]]:
        """Lowest height, range of the heights [m], and heights scaled to 0 to 1, in the form that
        MuJoCo stores.
        """
        low = float(self.heights.min())
        high = float(self.heights.max())
        span = (high - low) or 1.0
        return low, span, ((self.heights - low) / span).astype(np.float32)

    def height(self, x: Array, y: Array) -> Array:
        """Heights (P,), see `Solid`; rectangles are cut from the first to the last corner, as in
        MuJoCo's ray casts.

        Within a rectangle, u and v go from 0 to 1 along x and y. To the right of the cut, u > v,
        the surface goes from the first corner along x to the corner between, and on along y to the
        last one; to its left, the other way round.
        """
        low, span, shares = self._stored
        heights = low + span * shares.astype(float)
        rows, columns = shares.shape
        u = (x - self.x0) / (self.length / (columns - 1))
        v = (y + self.width / 2) / (self.width / (rows - 1))
        column = np.clip(u.astype(int), 0, columns - 2)
        row = np.clip(v.astype(int), 0, rows - 2)
        u = u - column
        v = v - row

        first = heights[row, column]
        last = heights[row + 1, column + 1]
        is_right = u > v
        between = np.where(is_right, heights[row, column + 1], heights[row + 1, column])
        along_x = np.where(is_right, between - first, last - between)
        along_y = np.where(is_right, last - between, between - first)
        height = first + u * along_x + v * along_y

        from_middle = np.abs(x - self.x0 - self.length / 2)
        is_beyond = from_middle > self.length / 2 + EDGE
        is_beside = np.abs(y) > self.width / 2 + EDGE
        return np.where(is_beyond | is_beside, -np.inf, height)

    def add_to(self, spec: mujoco.MjSpec, name: str, base: Base) -> None:
        """Add the height field to `spec`; see `Solid`."""
        low, span, shares = self._stored
        rows, columns = self.heights.shape
        size = [self.length / 2, self.width / 2, span, low - base.floor]
        spec.add_hfield(name=name, nrow=rows, ncol=columns, size=size, userdata=shares.ravel())
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_HFIELD,
            hfieldname=name,
            pos=[self.x0 + self.length / 2, 0.0, low],
            **look(self.colour, base),
        )


def look(colour: Colour, base: Base) -> dict[str, Any]:
    """Arguments for `add_geom` that all geoms of a course share and that override the model's
    defaults.
    """
    return {
        "rgba": list(colour),
        "material": LINES,
        "friction": [base.friction, *_NO_TURNING],
        "condim": 3,
        "contype": 1,
        "conaffinity": 1,
        "group": 0,
    }
