"""The appearance of the compiled model: one mesh of coloured triangles per body, and the shoes of its tracks."""

import contextlib
import functools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.robot.parameters import RobotParameters
from sim.robot.robot import FIELD, SCANNED_GROUP, VISUAL_GROUP
from trackslip.errors import TrackslipError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

CHASSIS, SCANNER = "chassis", "lrf"
BELTS = ("left_belt", "right_belt")  # geoms that are a belt with its shoes, as one mesh
_SIDES = 20  # of a cylinder
_UNSET = (0.5, 0.5, 0.5, 1.0)  # colour of a geom that is given none
_LOOKS = (SCANNED_GROUP, VISUAL_GROUP)


@dataclass(frozen=True)
class Triangles:
    """A mesh whose triangles share no vertices, so that each is shaded flat."""

    vertices: Array  # (3 F, 3) [m]
    colours: np.ndarray  # (3 F, 4) uint8

    @property
    def normals(self) -> Array:
        """(3 F, 3) unit vectors."""
        corner = self.vertices.reshape(-1, 3, 3)
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.repeat(normal / np.where(length > 0, length, 1.0), 3, axis=0)


@dataclass(frozen=True)
class Belt:
    """The shoes of a track: identical, in a closed loop around the wheels."""

    shoe: Array  # (3 F, 3) vertices of one shoe about its middle, as it lies under the robot [m]
    place: Array  # (S, 3) middles of the shoes in the chassis frame, backwards under the robot, forwards above [m]
    angle: Array  # (S + 1,) rotation of each about the robot's y axis, unwrapped, the first one repeated [rad]
    pitch: float  # distance between shoes along the belt [m]

    def shoes(self, travel: Array) -> tuple[Array, Array]:
        """Middles (..., S, 3) [m] and xyzw quaternions (..., S, 4) of shoes after `travel` (...) [m], > 0 is ahead."""
        count = len(self.place)
        turns, index = np.divmod(np.arange(count) + (travel / self.pitch)[..., None], count)
        knots = np.arange(count + 1)
        closed = np.concatenate([self.place, self.place[:1]])
        place = np.stack([np.interp(index, knots, closed[:, k]) for k in range(3)], axis=-1)
        half = (np.interp(index, knots, self.angle) + turns * (self.angle[-1] - self.angle[0])) / 2
        zero = np.zeros_like(half)
        return place, np.stack([zero, np.sin(half), zero, np.cos(half)], axis=-1)


@functools.lru_cache(maxsize=8)
def looks(parameters: RobotParameters) -> mujoco.MjModel:
    """The compiled field with a robot of these parameters, visual geoms included."""
    spec = mujoco.MjSpec.from_file(str(FIELD))
    parameters.apply(spec)
    return spec.compile()


def parameters_of(log: RunLog) -> RobotParameters:
    """The parameters of the robot that drove a run, as far as its log has them; the shipped robot's for the rest."""
    known = log.metadata.get("robot") or log.metadata.get("geometry")
    names = RobotParameters.__dataclass_fields__
    with contextlib.suppress(TrackslipError, TypeError, ValueError):  # a robot of another kind
        if isinstance(known, Mapping):
            return RobotParameters(**{str(key): float(value) for key, value in known.items() if key in names})
    return RobotParameters()


def body(model: mujoco.MjModel, name: str, without: Collection[str] = ()) -> Triangles:
    """The visible geoms of a body, in its frame."""
    chosen = [i for i in drawn(model, model.body(name).id) if model.geom(i).name not in without]
    return joined([geom(model, i) for i in chosen])


def drawn(model: mujoco.MjModel, body: int) -> list[int]:
    """The visible geoms of a body."""
    return [int(i) for i in np.flatnonzero((model.geom_bodyid == body) & np.isin(model.geom_group, _LOOKS))]


def joined(parts: Sequence[Triangles]) -> Triangles:
    """All triangles of some parts, of which there is at least one."""
    return Triangles(np.concatenate([p.vertices for p in parts]), np.concatenate([p.colours for p in parts]))


def belt(model: mujoco.MjModel, name: str) -> tuple[Triangles, Belt | None]:
    """Split a belt geom into its band and its shoes; None instead of shoes that cannot be separated."""
    whole = geom(model, model.geom(name).id)
    corner = whole.vertices.reshape(-1, 3, 3)
    label = _connected(corner)
    count = np.bincount(label)
    size, often = np.unique(count, return_counts=True)
    shoes = np.flatnonzero(count == size[np.argmax(often)])
    if len(shoes) < 3:
        return whole, None
    stays = ~np.isin(label, shoes)
    band = Triangles(corner[stays].reshape(-1, 3), whole.colours[np.repeat(stays, 3)])
    place = np.array([corner[label == k].reshape(-1, 3).mean(axis=0) for k in shoes])
    around = place - place.mean(axis=0)
    order = np.argsort(np.arctan2(around[:, 2], -around[:, 0]))  # backwards below, then up and forwards above
    order = np.roll(order, -np.argmin(np.hypot(place[order, 0], place[order, 2])))  # from the lowest one on
    place, shoes = place[order], shoes[order]
    after = np.roll(place, -1, axis=0)
    ahead = after - np.roll(place, 1, axis=0)
    angle = np.unwrap(np.arctan2(ahead[:, 2], -ahead[:, 0]))
    angle -= angle[0]
    shoe = corner[label == shoes[0]].reshape(-1, 3) - place[0]
    angle = np.append(angle, 2 * np.pi * np.sign(angle[-1]))
    return band, Belt(shoe, place, angle, float(np.linalg.norm(after - place, axis=1).mean()))


def _connected(corner: Array) -> np.ndarray:
    """The piece (F,) that each of F triangles (F, 3, 3) belongs to; triangles of a piece share corners."""
    _, vertex = np.unique(np.round(corner.reshape(-1, 3), 6), axis=0, return_inverse=True)
    face = vertex.reshape(-1, 3)
    lowest = np.arange(face.max() + 1)  # a corner known to be in the same piece
    while np.ptp(lowest[face], axis=1).any():
        np.minimum.at(lowest, face, lowest[face].min(axis=1, keepdims=True))
        lowest = lowest[lowest]
    return np.unique(lowest[face[:, 0]], return_inverse=True)[1]


def geom(model: mujoco.MjModel, i: int) -> Triangles:
    """A geom in the frame of its body; not a plane, which has no end."""
    kind, size = model.geom_type[i], model.geom_size[i]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[i]
        first, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        corners = model.mesh_vert[model.mesh_vertadr[mesh] :][model.mesh_face[first : first + faces]].reshape(-1, 3)
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        corners = box(size)
    elif kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        corners = _field(model, int(model.geom_dataid[i]))
    elif kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        corners = _ball() * (size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[0])
    else:  # a cylinder, or a capsule without its round ends
        corners = _cylinder(size[0], size[1])
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[i])
    vertices = corners @ rotation.reshape(3, 3).T + model.geom_pos[i]
    material, rgba = model.geom_matid[i], model.geom_rgba[i]
    if material >= 0 and (rgba == _UNSET).all():  # as the engine draws it
        rgba = model.mat_rgba[material]
    return Triangles(vertices, np.tile(np.rint(255 * rgba).astype(np.uint8), (len(vertices), 1)))


def box(size: Array) -> Array:
    """The corners (3 F, 3) of a box of half sizes (3,) [m]."""
    return _prism(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size[:2], size[2])


def wheel(radius: float, half_width: float) -> Array:
    """The corners (3 F, 3) of a wheel whose axis is y [m]."""
    return _cylinder(radius, half_width)[:, [0, 2, 1]] * [1, -1, 1]


def _cylinder(radius: float, half_height: float) -> Array:
    """The corners (3 F, 3) of an upright cylinder [m]."""
    angle = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    return _prism(radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1), half_height)


def _field(model: mujoco.MjModel, field: int) -> Array:
    """The corners (3 F, 3) of the surface of a height field, cut into triangles as the engine does."""
    rows, columns, first = model.hfield_nrow[field], model.hfield_ncol[field], model.hfield_adr[field]
    length, width, high, _ = model.hfield_size[field]
    x, y = np.meshgrid(np.linspace(-length, length, columns), np.linspace(-width, width, rows))
    z = high * model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    return _surface(np.stack([x, y, z], axis=-1))


def _ball() -> Array:
    """The corners (3 F, 3) of a sphere of radius 1."""
    turn, rise = np.meshgrid(np.linspace(0, 2 * np.pi, _SIDES + 1), np.linspace(-np.pi / 2, np.pi / 2, _SIDES // 2 + 1))
    return _surface(np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=-1))


def _surface(points: Array) -> Array:
    """Two triangles (3 F, 3) for each cell of a grid of points (R, C, 3)."""
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    return np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3)


def _prism(section: Array, half_height: float) -> Array:
    """The corners (3 F, 3) of an upright prism over a convex section (K, 2), counter-clockwise."""
    count = len(section)
    low = np.column_stack([section, np.full(count, -half_height)])
    high = low * [1, 1, -1]
    low_after, high_after = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    sides = np.stack([low, low_after, high_after, low, high_after, high], axis=1)
    k = np.arange(1, count - 1)
    fan = np.stack([np.zeros_like(k), k, k + 1], axis=1)
    return np.concatenate([sides.reshape(-1, 3), high[fan].reshape(-1, 3), low[fan[:, ::-1]].reshape(-1, 3)])
