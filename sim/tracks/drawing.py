"""Drawing of tracks: shoes and wheels that move with the belt but are not simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.tracks.belts import Belts
from sim.tracks.hull import Hull
from trackslip.errors import require_positive

Array = NDArray[np.float64]

BOX, CYLINDER = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_TYRE, _SHOE, _MARK = (0.10, 0.10, 0.11, 1.0), (0.15, 0.15, 0.17, 1.0), (0.93, 0.66, 0.07, 1.0)
_WHEEL, _BOLT = (0.22, 0.23, 0.26, 1.0), (0.80, 0.81, 0.83, 1.0)
_THICKNESS = 0.2  # thickness of a belt, relative to the smallest wheel's radius [-]
_PITCH = 0.034  # approximate distance between shoes [m]
_MARKED = 9  # every ninth shoe is painted to make the belt's motion visible
_BOLTS = 5
# of road wheels, radius / end wheels' radius and distance / own radius
_ROAD_WHEEL, _ROAD_GAP = 0.62, 2.6
_TURN_TO_Y = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # turns a cylinder's axis from z to -y


@dataclass(frozen=True)
class Pieces:
    """P boxes and lateral cylinders in a body's frame, all of them turned about the body's y axis
    only.
    """

    kind: NDArray[np.int64]  # (P,) BOX or CYLINDER
    size: Array  # (P, 3) half sizes of a box; radius, half width and 0 of a cylinder [m]
    rgba: Array  # (P, 4)
    position: Array  # (..., P, 3) [m]
    angle: Array  # (..., P) about y, positive with the nose down [rad]

    @property
    def rotation(self) -> Array:
        """Rotation matrices (..., P, 3, 3) of the pieces' geoms in the body's frame."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        zero, one = np.zeros_like(c), np.ones_like(c)
        rows = [np.stack(row, axis=-1) for row in ((c, zero, s), (zero, one, zero), (-s, zero, c))]
        turn = np.stack(rows, axis=-2)
        return np.where((self.kind == CYLINDER)[:, None, None], turn @ _TURN_TO_Y, turn)


@dataclass(frozen=True)
class TrackLook:
    """The looks of a single track: its hull, position and drawn width."""

    hull: Array  # (W, 3) x, z and radius of the wheels in the body's frame [m]
    y: float  # lateral position of the track in the body's frame [m]
    width: float  # width of the belt, or of the tyres [m]
    belted: bool = True  # false for wheels without a belt, which turn at the same speed

    def pieces(self, travel: Array | float) -> Pieces:
        """Pieces to draw after the belt has travelled `travel` (...) [m] forwards."""
        travel = np.asarray(travel, float)
        if not self.belted:
            return _joined([self._wheel(wheel, travel, _TYRE) for wheel in self.hull])
        return _joined(
            [self._shoes(travel), *(self._wheel(wheel, travel, _WHEEL) for wheel in self._wheels())]
        )

    @property
    def _thickness(self) -> float:
        return _THICKNESS * float(np.min(np.asarray(self.hull)[:, 2]))

    def _inside(self, depth: float) -> Hull:
        """The hull that lies inside the track's by a `depth` [m] below the belt's surface."""
        return Hull.from_wheels((np.asarray(self.hull, float) - [0.0, 0.0, depth]).tolist())

    def _wheels(self) -> Array:
        """Wheels to draw (W', 3): those of the hull, shrunk to fit the belt, and road wheels along
        the lower run.
        """
        hull = self._inside(self._thickness)
        k = min(range(len(hull.runs)), key=lambda k: hull.runs[k].along[0])  # the most backward run
        low, first, last = (
            hull.runs[k],
            hull.wheels[k, 2],
            hull.wheels[(k + 1) % len(hull.wheels), 2],
        )
        radius = _ROAD_WHEEL * min(first, last)
        room = low.length - first - last
        count = max(0, int(room // (_ROAD_GAP * radius)))
        along = first + (np.arange(count) + 0.5) * room / max(count, 1)
        where = low.start + along[:, None] * low.along - radius * low.outwards
        return np.concatenate([hull.wheels, np.column_stack([where, np.full(count, radius)])])

    def _shoes(self, travel: Array) -> Pieces:
        belt = self._inside(self._thickness / 2)
        length = float(belt.ends[-1])
        count = max(3, round(length / _PITCH))
        pitch = length / count
        place, heading = belt.place(np.arange(count) * pitch + travel[..., None])
        size = np.tile([pitch / 2, self.width / 2, self._thickness / 2], (count, 1))
        rgba = np.where((np.arange(count) % _MARKED == 0)[:, None], _MARK, _SHOE)
        position = np.stack([place[..., 0], np.full_like(heading, self.y), place[..., 1]], axis=-1)
        return Pieces(np.full(count, BOX), size, rgba, position, -heading)

    def _wheel(self, wheel: Array, travel: Array, rgba: tuple[float, ...]) -> Pieces:
        """The pieces of a wheel: a disc, and bolts that turn with the disc."""
        x, z, radius = wheel
        angle = travel[..., None] / radius + np.append(0.0, 2 * np.pi * np.arange(_BOLTS) / _BOLTS)
        away = np.append(0.0, np.full(_BOLTS, 0.62 * radius))
        half = 0.46 * self.width
        size = np.array([[radius, half, 0.0], *[[0.13 * radius, half + 0.003, 0.0]] * _BOLTS])
        place = [x + away * np.sin(angle), np.full_like(angle, self.y), z + away * np.cos(angle)]
        count = 1 + _BOLTS
        rgba_of_each = np.array([rgba, *[_BOLT] * _BOLTS])
        return Pieces(np.full(count, CYLINDER), size, rgba_of_each, np.stack(place, axis=-1), angle)


def _joined(parts: Sequence[Pieces]) -> Pieces:
    kind, size, rgba = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("kind", "size", "rgba")
    )
    position = np.concatenate([part.position for part in parts], axis=-2)
    return Pieces(
        kind, size, rgba, position, np.concatenate([part.angle for part in parts], axis=-1)
    )


def draw(scene: mujoco.MjvScene, pieces: Pieces, position: Array, rotation: Array) -> None:
    """Append the pieces on a body at `position` (3,) with `rotation` (3, 3) to a scene, until the
    scene is full.
    """
    where = position + pieces.position @ rotation.T
    turn = (rotation @ pieces.rotation).reshape(-1, 9)
    colour = pieces.rgba.astype(np.float32)
    for kind, size, at, matrix, rgba in zip(
        pieces.kind, pieces.size, where, turn, colour, strict=True
    ):
        if scene.ngeom == scene.maxgeom:
            return
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, int(kind), size, at, matrix, rgba)
        geom.category = mujoco.mjtCatBit.mjCAT_DYNAMIC  # decoration would have no shadow
        scene.ngeom += 1


class DrawnTracks:
    """Drawing of a compiled model's tracks with moving belts and wheels; the colliding geoms are
    hidden in group 3.

    In a loop with MuJoCo's viewer, after each step:

        viewer.user_scn.ngeom = 0
        drawn.draw(viewer.user_scn, data)
        viewer.sync()
    """

    def __init__(self, belts: Belts, width: float = 0.08) -> None:
        """Prepare to draw belts with a `width` [m]; raises InvalidValueError unless the width is
        positive.
        """
        require_positive("width", width)
        self._belts, self._looks = (
            belts,
            [TrackLook(hull.wheels, 0.0, width) for hull in belts.hulls],
        )
        self._travel, self._time = np.zeros(len(belts.names)), 0.0

    def draw(self, scene: mujoco.MjvScene, data: mujoco.MjData) -> None:
        """Append the tracks to a scene; the belts are assumed to have kept their current speeds
        since the last call.
        """
        passed = data.time - self._time
        if passed < 0:  # the simulation was reset
            self._travel[:] = passed = 0.0
        self._time = data.time
        self._travel += self._belts.speeds() * passed
        for body, look, way in zip(self._belts.bodies, self._looks, self._travel, strict=True):
            draw(scene, look.pieces(way), data.xpos[body], data.xmat[body].reshape(3, 3))
