"""A MuJoCo model in a recording: each geom as a rerun shape, bodies that move, and tracks whose
belts turn.
"""

from collections.abc import Sequence
from typing import Any, Final

import mujoco
import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from experiments.recorder.stream import FIELD, Recording, at_height
from sim.robot.robot import SCANNED_GROUP, VISUAL_GROUP
from sim.tracks.drawing import BOX, CYLINDER, Pieces, TrackLook
from trackslip.kinematics import Array

ROBOT: Final = "robot"
"""Entity with a robot's bodies, below the run's entity."""
GROUND: Final = f"{FIELD}/ground"
HIDDEN_GROUP: Final = 5
"""Group of geoms that aren't drawn."""
STONE: Final = 0.5
"""Side of a paving stone [m]."""
MAX_STONES: Final = 100
"""Largest number of stones along one side."""
TONES: Final = ((92, 90, 86), (84, 82, 78))
"""Colours of the stones, as on a chessboard."""
_UNSET: Final = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's colour for geoms that don't set a colour
_THICKNESS: Final = 0.01  # half the thickness of a paving stone [m]
_MARGIN: Final = 3.0  # width of the paving around everything else [m]


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
    bodies = _moving_bodies(model, [body for _, body, _ in tracks])
    entities = {body: f"{root}/{ROBOT}/{_body_path(model, body)}" for body in bodies}
    position, attitude = _poses(model, qpos, bodies)
    for k, (body, entity) in enumerate(entities.items()):
        scalar_last = np.roll(attitude[:, k], -1, axis=-1)
        recording.poses(entity, time, position[:, k], scalar_last)
        send_geoms(recording, f"{entity}/body", model, body)
    for (name, body, look), distance in zip(tracks, travel.T, strict=True):
        entity = f"{entities[body]}/{_path(name)}"
        _send_track(recording, entity, time, look.pieces(distance))


def _moving_bodies(model: mujoco.MjModel, carriers: Sequence[int]) -> list[int]:
    """Bodies that can move, and are visible or carry a track."""
    # bodies welded to the world have 0 here
    moving = [body for body in range(1, model.nbody) if model.body_weldid[body]]
    return [body for body in moving if body in carriers or drawn(model, body)]


def _body_path(model: mujoco.MjModel, body: int) -> str:
    """A body's name, or its number if it has no name, as part of an entity's path."""
    return _path(model.body(body).name or str(body))


def _path(name: str) -> str:
    """A name in a model, which may contain slashes and blanks, as part of an entity's path."""
    return "/".join(rr.escape_entity_path_part(part) for part in name.split("/"))


def send_geoms(recording: Recording, entity: str, model: mujoco.MjModel, body: int) -> None:
    """Send the visible geoms of a body, in its frame; planes, which are infinite, are left out."""
    for i in drawn(model, body):
        name = _path(model.geom(i).name or str(i))
        recording.still(f"{entity}/{name}", _shape(model, i))


def drawn(model: mujoco.MjModel, body: int) -> list[int]:
    """Indices of a body's visible geoms, except planes."""
    visible = np.isin(model.geom_group, (SCANNED_GROUP, VISUAL_GROUP))
    mine = (model.geom_bodyid == body) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    return [int(i) for i in np.flatnonzero(visible & mine)]


def send_paving(
    recording: Recording,
    within: Array,
    height: float = 0.0,
    without: Sequence[tuple[int, int]] = (),
) -> None:
    """Send level ground at a height [m] around the points `within` (n, 2) [m], `without` the stones
    in these columns and rows.
    """
    # corners of the paving, in stones
    begin = (within.min(axis=0) - _MARGIN) / STONE
    end = (within.max(axis=0) + _MARGIN) / STONE
    low = np.floor(begin).astype(int)
    high = np.minimum(np.ceil(end).astype(int), low + MAX_STONES)

    columns = np.arange(low[0], high[0])
    rows = np.arange(low[1], high[1])
    corner = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    left_out = set(without)
    corner = np.array([stone for stone in corner.tolist() if tuple(stone) not in left_out])
    middle = STONE * (corner + 0.5)
    is_odd = corner.sum(axis=1) % 2
    stones = rr.Boxes3D(
        centers=at_height(middle, height - _THICKNESS),
        half_sizes=[[STONE / 2, STONE / 2, _THICKNESS]],
        colors=np.array(TONES, np.uint8)[is_odd],
        fill_mode="solid",
    )
    recording.still(GROUND, stones)


def _send_track(recording: Recording, entity: str, time: Array, pieces: Pieces) -> None:
    """Send the boxes and cylinders of a track, only once if the track is at rest."""
    matrices = pieces.rotation.reshape(-1, 3, 3)
    quaternions = Rotation.from_matrix(matrices).as_quat()
    turn = quaternions.reshape(*pieces.angle.shape, 4)
    colours = _bytes(pieces.rgba)
    for kind, name in ((BOX, "boxes"), (CYLINDER, "wheels")):
        mine = pieces.kind == kind
        place = pieces.position[:, mine]
        turned = turn[:, mine]
        solid = _solid(kind, pieces.size[mine], place[0], turned[0], colours[mine])
        if len(place) == 1:
            recording.still(f"{entity}/{name}", solid)
            continue
        counts = np.full(len(time), mine.sum())
        centres = place.reshape(-1, 3)
        turns = turned.reshape(-1, 4)
        recording.shapes(
            f"{entity}/{name}", time, counts, solid, centers=centres, quaternions=turns
        )


def _bytes(rgba: Array) -> np.ndarray:
    """Colours (..., 4) from 0 to 1 as bytes from 0 to 255."""
    return np.rint(255 * rgba).astype(np.uint8)


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
    kind = mujoco.mjtGeom(int(model.geom_type[i]))
    place = model.geom_pos[i]
    turn = np.roll(model.geom_quat[i], -1)  # rerun has w last
    colour = _bytes(_rgba(model, i))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        triangles = _mesh(model, model.geom_dataid[i])
    elif kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        triangles = _height_field(model, int(model.geom_dataid[i]))
    else:
        return _solid(kind, model.geom_size[i][None], place[None], turn[None], colour[None])
    vertices = Rotation.from_quat(turn).apply(triangles.reshape(-1, 3)) + place
    return _flat_mesh(vertices, colour)


def _rgba(model: mujoco.MjModel, i: int) -> Array:
    """A geom's colour (4,), as MuJoCo draws it: the material's, unless the geom sets its own."""
    material = model.geom_matid[i]
    own = model.geom_rgba[i]
    is_own = (own != _UNSET).any()
    return own if material < 0 or is_own else model.mat_rgba[material]


def _mesh(model: mujoco.MjModel, mesh: int) -> Array:
    """Triangles (F, 3, 3) of a mesh."""
    first = model.mesh_faceadr[mesh]
    faces = model.mesh_face[first : first + model.mesh_facenum[mesh]]
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] :]
    return np.asarray(vertices[faces])


def _flat_mesh(vertices: Array, colour: np.ndarray) -> rr.Mesh3D:
    """Triangles with vertices (3 F, 3), each shaded flat."""
    edge = np.diff(vertices.reshape(-1, 3, 3), axis=1)
    normal = np.cross(edge[:, 0], edge[:, 1])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= np.maximum(length, 1e-12)
    normals = np.repeat(normal, 3, axis=0)
    return rr.Mesh3D(vertex_positions=vertices, vertex_normals=normals, albedo_factor=colour)


def _height_field(model: mujoco.MjModel, field: int) -> Array:
    """Triangles (F, 3, 3) on a height field's surface, the same as MuJoCo's: each cell is divided
    by the diagonal from its corner at the smallest x and y.
    """
    rows = model.hfield_nrow[field]
    columns = model.hfield_ncol[field]
    first = model.hfield_adr[field]
    length, width, high, _ = model.hfield_size[field]

    x = np.linspace(-length, length, columns)
    y = np.linspace(-width, width, rows)
    heights = model.hfield_data[first : first + rows * columns]
    z = high * heights.reshape(rows, columns)
    points = np.stack([*np.meshgrid(x, y), z], axis=-1)

    near = points[:-1, :-1]
    along_x = points[:-1, 1:]
    far = points[1:, 1:]
    along_y = points[1:, :-1]
    corners = np.stack([near, along_x, far, near, far, along_y], axis=2)
    return corners.reshape(-1, 3, 3)


def _poses(model: mujoco.MjModel, qpos: Array, bodies: Sequence[int]) -> tuple[Array, Array]:
    """Positions (R, B, 3) and attitudes (R, B, 4), w first, of bodies in states qpos (R, nq)."""
    data = mujoco.MjData(model)
    position = np.empty((len(qpos), len(bodies), 3))
    attitude = np.empty((len(qpos), len(bodies), 4))
    for k in range(len(qpos)):
        data.qpos[:] = qpos[k]
        mujoco.mj_kinematics(model, data)
        position[k] = data.xpos[bodies]
        attitude[k] = data.xquat[bodies]
    return position, attitude
