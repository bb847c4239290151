"""A MuJoCo model in a recording: each geom as a rerun shape, bodies that move, and tracks whose
belts turn.
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from experiments.recorder.stream import FIELD, Recording, at_height
from sim.robot.robot import SCANNED_GROUP, VISUAL_GROUP
from sim.tracks.drawing import BOX, CYLINDER, Pieces, TrackLook
from trackslip.kinematics import Array

ROBOT = "robot"
"""Entity with a robot's bodies, below the run's entity."""
GROUND = f"{FIELD}/ground"
_UNSET = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's colour for geoms that don't set a colour
_STONE, _THICK = 0.5, 0.01  # side and half the thickness of a paving stone [m]
_MARGIN = 3.0  # width of the paving around everything else [m]
_MAX_STONES = 100  # largest number of stones along one side
_TONES = ((92, 90, 86), (84, 82, 78))


def send_robot(
    recording: Recording,
    root: str,
    model: mujoco.MjModel,
    time: Array,  # (R,) [s]
    qpos: Array,  # (R, nq) positions of all joints
    tracks: Sequence[tuple[str, int, TrackLook]],  # name, body and looks of each of T tracks
    travel: Array,  # (R, T) distances travelled by the belts, or (1, T) for belts at rest [m]
) -> None:
    """Send all moving bodies of a model and the tracks on them, below the entity `root`."""
    carriers = {body for _, body, _ in tracks}
    bodies = [
        b
        for b in range(1, model.nbody)
        if model.body_weldid[b] and (b in carriers or drawn(model, b))
    ]
    entities = {
        body: f"{root}/{ROBOT}/{_path(model.body(body).name or str(body))}" for body in bodies
    }
    position, attitude = _poses(model, qpos, bodies)
    for k, (body, entity) in enumerate(entities.items()):
        recording.poses(entity, time, position[:, k], np.roll(attitude[:, k], -1, axis=-1))
        send_geoms(recording, f"{entity}/body", model, body)
    for (name, body, look), distance in zip(tracks, travel.T, strict=True):
        _send_track(recording, f"{entities[body]}/{_path(name)}", time, look.pieces(distance))


def _path(name: str) -> str:
    """A name in a model, which may contain slashes and blanks, as part of an entity's path."""
    return "/".join(rr.escape_entity_path_part(part) for part in name.split("/"))


def send_geoms(recording: Recording, entity: str, model: mujoco.MjModel, body: int) -> None:
    """Send the visible geoms of a body, in its frame; planes, which are infinite, are left out."""
    for i in drawn(model, body):
        recording.still(f"{entity}/{_path(model.geom(i).name or str(i))}", _shape(model, i))


def drawn(model: mujoco.MjModel, body: int) -> list[int]:
    """Indices of a body's visible geoms, except planes."""
    visible = np.isin(model.geom_group, (SCANNED_GROUP, VISUAL_GROUP))
    mine = (model.geom_bodyid == body) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    return [int(i) for i in np.flatnonzero(visible & mine)]


def send_paving(recording: Recording, within: Array, height: float = 0.0) -> None:
    """Send level ground at a height [m] around the points `within` (n, 2) [m]."""
    low = np.floor((within.min(axis=0) - _MARGIN) / _STONE).astype(int)
    high = np.minimum(
        np.ceil((within.max(axis=0) + _MARGIN) / _STONE).astype(int), low + _MAX_STONES
    )
    corner = np.stack(np.meshgrid(*map(np.arange, low, high)), axis=-1).reshape(-1, 2)
    stones = rr.Boxes3D(
        centers=at_height(_STONE * (corner + 0.5), height - _THICK),
        half_sizes=[[_STONE / 2, _STONE / 2, _THICK]],
        colors=np.array(_TONES, np.uint8)[corner.sum(axis=1) % 2],
        fill_mode="solid",
    )
    recording.still(GROUND, stones)


def _send_track(recording: Recording, entity: str, time: Array, pieces: Pieces) -> None:
    """Send the boxes and cylinders of a track, only once if the track is at rest."""
    turn = (
        Rotation.from_matrix(pieces.rotation.reshape(-1, 3, 3))
        .as_quat()
        .reshape(*pieces.angle.shape, 4)
    )
    colours = np.rint(255 * pieces.rgba).astype(np.uint8)
    for kind, name in ((BOX, "boxes"), (CYLINDER, "wheels")):
        mine = pieces.kind == kind
        place, turned = pieces.position[:, mine], turn[:, mine]
        solid = _solid(kind, pieces.size[mine], place[0], turned[0], colours[mine])
        if len(place) == 1:
            recording.still(f"{entity}/{name}", solid)
        else:
            columns = {"centers": place.reshape(-1, 3), "quaternions": turned.reshape(-1, 4)}
            recording.shapes(
                f"{entity}/{name}", time, np.full(len(time), mine.sum()), solid, **columns
            )


def _solid(kind: int, size: Array, place: Array, turn: Array, colours: np.ndarray) -> Any:
    """Shapes for one kind of geom: MuJoCo's sizes (n, 3) [m], positions (n, 3) [m] and quaternions
    xyzw (n, 4).
    """
    style: dict[str, Any] = {"quaternions": turn, "colors": colours, "fill_mode": "solid"}
    geom = mujoco.mjtGeom
    if kind == geom.mjGEOM_BOX:
        return rr.Boxes3D(half_sizes=size, centers=place, **style)
    if kind in (geom.mjGEOM_CYLINDER, geom.mjGEOM_CAPSULE):  # a capsule's round ends are left out
        return rr.Cylinders3D(radii=size[:, 0], lengths=2 * size[:, 1], centers=place, **style)
    half = np.repeat(size[:, :1], 3, axis=1) if kind == geom.mjGEOM_SPHERE else size
    return rr.Ellipsoids3D(half_sizes=half, centers=place, **style)


def _shape(model: mujoco.MjModel, i: int) -> Any:
    """A geom as a rerun shape in the frame of its body."""
    kind, place, turn = model.geom_type[i], model.geom_pos[i], np.roll(model.geom_quat[i], -1)
    material, rgba = model.geom_matid[i], model.geom_rgba[i]
    if material >= 0 and (rgba == _UNSET).all():  # as MuJoCo draws it
        rgba = model.mat_rgba[material]
    colour = np.rint(255 * rgba).astype(np.uint8)
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[i]
        first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        corners = model.mesh_vert[model.mesh_vertadr[mesh] :][
            model.mesh_face[first : first + count]
        ]
    elif kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        corners = _height_field(model, int(model.geom_dataid[i]))
    else:
        return _solid(kind, model.geom_size[i][None], place[None], turn[None], colour[None])
    vertices = Rotation.from_quat(turn).apply(corners.reshape(-1, 3)) + place
    edge = np.diff(vertices.reshape(-1, 3, 3), axis=1)
    normal = np.cross(edge[:, 0], edge[:, 1])  # each triangle is shaded flat
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return rr.Mesh3D(
        vertex_positions=vertices, vertex_normals=np.repeat(normal, 3, axis=0), albedo_factor=colour
    )


def _height_field(model: mujoco.MjModel, field: int) -> Array:
    """Triangles (F, 3, 3) on a height field's surface, the same as MuJoCo's."""
    rows, columns, first = (
        model.hfield_nrow[field],
        model.hfield_ncol[field],
        model.hfield_adr[field],
    )
    length, width, high, _ = model.hfield_size[field]
    x, y = np.meshgrid(np.linspace(-length, length, columns), np.linspace(-width, width, rows))
    z = high * model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    points = np.stack([x, y, z], axis=-1)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    return np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 3)


def _poses(model: mujoco.MjModel, qpos: Array, bodies: Sequence[int]) -> tuple[Array, Array]:
    """Positions (R, B, 3) and attitudes (R, B, 4), w first, of bodies in states qpos (R, nq)."""
    data = mujoco.MjData(model)
    position, attitude = (
        np.empty((len(qpos), len(bodies), 3)),
        np.empty((len(qpos), len(bodies), 4)),
    )
    for k in range(len(qpos)):
        data.qpos[:] = qpos[k]
        mujoco.mj_kinematics(model, data)
        position[k], attitude[k] = data.xpos[bodies], data.xquat[bodies]
    return position, attitude
