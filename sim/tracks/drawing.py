"""Drawing of tracks: shoes and wheels that move with the belt but are not simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.tracks.belts import Belts
from sim.tracks.hull import Hull
from trackslip.errors import require_positive

Array = NDArray[np.float64]

BOX: Final = int(mujoco.mjtGeom.mjGEOM_BOX)
CYLINDER: Final = int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_TYRE: Final = (0.10, 0.10, 0.11, 1.0)
_SHOE: Final = (0.15, 0.15, 0.17, 1.0)
_MARK: Final = (0.93, 0.66, 0.07, 1.0)
_WHEEL: Final = (0.22, 0.23, 0.26, 1.0)
_BOLT: Final = (0.80, 0.81, 0.83, 1.0)
_THICKNESS = 0.2  # thickness of a belt, relative to the smallest wheel's radius [-]
_PITCH = 0.034  # approximate distance between shoes [m]
_MARKED = 9  # every ninth shoe is painted to make the belt's motion visible
_BOLTS = 5
# of bolts, radius and distance from the wheel's middle / the wheel's radius
_BOLT_RADIUS, _BOLT_CIRCLE = 0.13, 0.62
_BOLT_HEIGHT = 0.003  # above the disc [m]
_DISC_WIDTH = 0.46  # half the width of a disc, relative to the belt's width [-]
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
        turn = np.zeros((*self.angle.shape, 3, 3))
        cos = np.cos(self.angle)
        sin = np.sin(self.angle)
        turn[..., 0, 0] = cos
        turn[..., 0, 2] = sin
        turn[..., 1, 1] = 1.0
        turn[..., 2, 0] = -sin
        turn[..., 2, 2] = cos
        is_cylinder = (self.kind == CYLINDER)[:, None, None]
        return np.where(is_cylinder, turn @ _TURN_TO_Y, turn)


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
        lower = min(range(len(hull.runs)), key=lambda k: hull.runs[k].along[0])
        run = hull.runs[lower]  # the one that leads backwards most
        first = hull.wheels[lower, 2]
        last = hull.wheels[(lower + 1) % len(hull.wheels), 2]

        # road wheels between the two end wheels
        radius = _ROAD_WHEEL * min(first, last)
        room = run.length - first - last
        count = max(0, int(room // (_ROAD_GAP * radius)))
        along = first + (np.arange(count) + 0.5) * room / max(count, 1)
        where = run.start + along[:, None] * run.along - radius * run.outwards
        road_wheels = np.column_stack([where, np.full(count, radius)])
        return np.concatenate([hull.wheels, road_wheels])

    def _shoes(self, travel: Array) -> Pieces:
        belt = self._inside(self._thickness / 2)
        length = float(belt.ends[-1])
        count = max(3, round(length / _PITCH))
        pitch = length / count
        number = np.arange(count)
        place, heading = belt.place(number * pitch + travel[..., None])
        half_size = [pitch / 2, self.width / 2, self._thickness / 2]
        is_marked = (number % _MARKED == 0)[:, None]
        y = np.full_like(heading, self.y)
        return Pieces(
            kind=np.full(count, BOX),
            size=np.tile(half_size, (count, 1)),
            rgba=np.where(is_marked, _MARK, _SHOE),
            position=np.stack([place[..., 0], y, place[..., 1]], axis=-1),
            angle=-heading,
        )

    def _wheel(self, wheel: Array, travel: Array, rgba: tuple[float, ...]) -> Pieces:
        """The pieces of a wheel: a disc, and bolts that turn with the disc."""
        x, z, radius = wheel
        count = 1 + _BOLTS
        phases = np.append(0.0, 2 * np.pi * np.arange(_BOLTS) / _BOLTS)
        away = np.append(0.0, np.full(_BOLTS, _BOLT_CIRCLE * radius))
        angle = travel[..., None] / radius + phases
        half_width = _DISC_WIDTH * self.width
        disc = [radius, half_width, 0.0]
        bolt = [_BOLT_RADIUS * radius, half_width + _BOLT_HEIGHT, 0.0]
        ahead = x + away * np.sin(angle)
        up = z + away * np.cos(angle)
        return Pieces(
            kind=np.full(count, CYLINDER),
            size=np.array([disc, *[bolt] * _BOLTS]),
            rgba=np.array([rgba, *[_BOLT] * _BOLTS]),
            position=np.stack([ahead, np.full_like(angle, self.y), up], axis=-1),
            angle=angle,
        )


def _joined(parts: Sequence[Pieces]) -> Pieces:
    return Pieces(
        kind=np.concatenate([part.kind for part in parts]),
        size=np.concatenate([part.size for part in parts]),
        rgba=np.concatenate([part.rgba for part in parts]),
        position=np.concatenate([part.position for part in parts], axis=-2),
        angle=np.concatenate([part.angle for part in parts], axis=-1),
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
        self._belts = belts
        self._looks = [TrackLook(hull.wheels, 0.0, width) for hull in belts.hulls]
        self._travel = np.zeros(len(belts.names))
        self._time = 0.0

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
