"""The field: ground, scanner and obstacles, of which only people move."""

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from experiments.recording import robot_mesh
from experiments.recording.columns import at_height, mesh, quaternion, rgb, send
from experiments.recording.sensing import OTHER_COLOUR
from experiments.recording.traces import Traces
from sim.scanner.obstacles import Walker
from trackslip.kinematics import Array

FIELD = "field"
_STONE = 0.5  # side of a paving stone [m]
_MARGIN = 3.0  # ground around everything [m]
_MAX_STONES = 100  # along one side
_TONES = ((92, 90, 86, 255), (84, 82, 78, 255))
_PATCH, _PATCH_COLOUR = 0.0005, "#4f6f78"  # half the thickness of a patch on the ground [m]
_TALL = 1.0  # height of posts, walls and people [m]


def send_field(stream: rr.RecordingStream, traces: Traces, model: mujoco.MjModel, within: Array) -> None:
    """Send the ground around the points `within` (n, 2), and the scanner and obstacles that a run's log describes."""
    stream.log(f"{FIELD}/ground", mesh(_paving(within)), static=True)
    if (mount := mount_of(traces)) is not None:
        turn = rr.Quaternion(xyzw=quaternion(mount[2:])[0])
        pose = rr.Transform3D(translation=[mount[0], mount[1], scan_height(model)], quaternion=turn)
        stream.log(f"{FIELD}/scanner", pose, mesh(robot_mesh.body(model, robot_mesh.SCANNER)), static=True)
    _send_ground(stream, traces, within)
    _send_obstacles(stream, traces)


def mount_of(traces: Traces) -> Array | None:
    """The scanner's pose (3,), if the log has it."""
    if traces.log.scans is not None:
        return traces.log.scans.scan.mount
    scanner = traces.log.metadata.get("lrf")
    mount = scanner.get("mount") if isinstance(scanner, Mapping) else None
    return np.array(mount, float) if isinstance(mount, list | tuple) and len(mount) == 3 else None


def scan_height(model: mujoco.MjModel) -> float:
    """Height of the scan plane [m]."""
    return float(model.body(robot_mesh.SCANNER).pos[2])


def _paving(within: Array) -> robot_mesh.Triangles:
    low = np.floor((within.min(axis=0) - _MARGIN) / _STONE).astype(int)
    high = np.ceil((within.max(axis=0) + _MARGIN) / _STONE).astype(int)
    high = np.minimum(high, low + _MAX_STONES)
    i, j = (grid.ravel() for grid in np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high, strict=True))))
    corner = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]])
    flat = _STONE * (np.stack([i, j], axis=-1)[:, None] + corner).reshape(-1, 2)
    tone = np.repeat((i + j) % 2, len(corner))
    return robot_mesh.Triangles(np.column_stack([flat, np.zeros(len(flat))]), np.array(_TONES, np.uint8)[tone])


def _send_ground(stream: rr.RecordingStream, traces: Traces, within: Array) -> None:
    """Send patches with other friction and the uphill direction, if the log has them."""
    ground = traces.log.metadata.get("ground")
    if not isinstance(ground, Mapping):
        return
    low, high = within.min(axis=0) - _MARGIN, within.max(axis=0) + _MARGIN
    patches = [(_ends(patch, low, high), patch) for patch in ground.get("patches") or ()]
    patches = [(ends, patch) for ends, patch in patches if (ends[0] < ends[1]).all()]
    if patches:
        boxes = [ends for ends, _ in patches]
        thickness = np.full(len(boxes), _PATCH)
        flat = rr.Boxes3D(
            centers=np.column_stack([np.mean(boxes, axis=1), thickness]),
            half_sizes=np.column_stack([np.ptp(boxes, axis=1) / 2, thickness]),
            colors=[rgb(_PATCH_COLOUR)],
            fill_mode="solid",
            labels=[f"friction {patch['along']:g} along, {patch['across']:g} across" for _, patch in patches],
        )
        stream.log(f"{FIELD}/patches", flat, static=True)
    slope, heading = (float(ground.get(key) or 0.0) for key in ("slope", "uphill"))
    if slope:
        uphill, begin = [np.cos(heading), np.sin(heading), 0.0], [*(within.min(axis=0) - 1.0), 0.02]
        style: dict[str, Any] = {"colors": [rgb(_PATCH_COLOUR)], "radii": [0.02]}
        arrow = rr.Arrows3D(vectors=[uphill], origins=[begin], labels=[f"uphill, {slope:.3g} rad"], **style)
        stream.log(f"{FIELD}/uphill", arrow, static=True)


def _ends(patch: Mapping[str, Any], low: Array, high: Array) -> Array:
    """The smallest and the largest corner (2, 2) of a patch, between `low` and `high` (2,); JSON has no infinity."""
    ends = np.array([patch["x"], patch["y"]], float).T
    return np.clip(np.where(np.isnan(ends), [[-np.inf], [np.inf]], ends), low, high)


def _send_obstacles(stream: rr.RecordingStream, traces: Traces) -> None:
    """Send the obstacles that the log describes."""
    known = traces.log.metadata.get("obstacles")
    if not isinstance(known, Mapping):
        return
    posts, walls, walkers = (list(known.get(kind) or ()) for kind in ("posts", "walls", "walkers"))
    if posts:
        centres = [[post["x"], post["y"], _TALL / 2] for post in posts]
        stream.log(f"{FIELD}/posts", _cylinders(centres, [post["radius"] for post in posts]), static=True)
    if walls:
        strips = [_around([wall["x0"], wall["y0"]], [wall["x1"], wall["y1"]]) for wall in walls]
        stream.log(f"{FIELD}/walls", rr.LineStrips3D(strips, colors=[rgb(OTHER_COLOUR)], radii=[0.01]), static=True)
    for k, walker in enumerate(walkers):
        turns_after = np.inf if walker.get("turns_after") is None else walker["turns_after"]  # JSON has no infinity
        person = Walker(**{**walker, "turns_after": turns_after})
        entity = f"{FIELD}/walkers/{k}"
        stream.log(entity, _cylinders([[0, 0, _TALL / 2]], [person.radius]), static=True)
        place = rr.Transform3D.columns(translation=at_height(person.place(traces.log.time)))
        send(stream, entity, traces.time, place)


def _around(begin: Sequence[float], end: Sequence[float]) -> list[list[float]]:
    """The corners of an upright wall between two points (2,), once around."""
    return [[*begin, 0.0], [*end, 0.0], [*end, _TALL], [*begin, _TALL], [*begin, 0.0]]


def _cylinders(centres: Any, radii: Sequence[float]) -> rr.Cylinders3D:
    style: dict[str, Any] = {"colors": [rgb(OTHER_COLOUR)], "fill_mode": "solid"}
    return rr.Cylinders3D(lengths=[_TALL] * len(radii), radii=radii, centers=centres, **style)
