"""The field of a robot run as its log describes it: ground, scanner and obstacles, of which only people move."""

import contextlib
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from experiments.recorder.model import send_geoms, send_paving
from experiments.recorder.sensing import OTHER_COLOUR
from experiments.recorder.stream import FIELD, Recording, about_vertical, at_height, paint, rgb
from experiments.recorder.traces import Traces
from sim.scanner.obstacles import Walker
from trackslip.kinematics import Array
from trackslip.logs.runlog import MALFORMED

_FAR = 3.0  # to where patches without end are drawn around everything [m]
_PATCH, _PATCH_COLOUR = 0.0005, "#4f6f78"  # half the thickness of a patch on the ground [m]
_TALL = 1.0  # height of posts, walls and people [m]


def send_field(recording: Recording, traces: Traces, model: mujoco.MjModel, within: Array) -> None:
    """Send the ground around the points `within` (n, 2), and the scanner and obstacles that a run's log describes."""
    send_paving(recording, within)
    if (mount := traces.mount) is not None:
        place, turn = [*mount[:2], model.body("lrf").pos[2]], rr.Quaternion(xyzw=about_vertical(mount[2:])[0])
        recording.still(f"{FIELD}/scanner", rr.Transform3D(translation=place, quaternion=turn))
        send_geoms(recording, f"{FIELD}/scanner", model, model.body("lrf").id)
    metadata = traces.log.metadata
    with contextlib.suppress(*MALFORMED):
        _send_ground(recording, metadata["ground"], within.min(axis=0) - _FAR, within.max(axis=0) + _FAR)
    with contextlib.suppress(*MALFORMED):
        _send_obstacles(recording, metadata["obstacles"], traces)


def _send_ground(recording: Recording, ground: Mapping[str, Any], low: Array, high: Array) -> None:
    """Send patches with other friction as far as they lie between `low` and `high` (2,), and the uphill direction."""
    patches = ground.get("patches") or ()
    edges = np.array([[patch["x"], patch["y"]] for patch in patches], float).reshape(-1, 2, 2)
    ends = np.stack([low, high], axis=-1)
    edges = np.clip(np.where(np.isnan(edges), ends, edges), low[:, None], high[:, None])  # JSON has no infinity
    shown = np.flatnonzero((edges[..., 0] < edges[..., 1]).all(axis=1))
    if len(shown):
        flat = rr.Boxes3D(
            centers=at_height(edges[shown].mean(axis=-1), _PATCH),
            half_sizes=at_height(np.ptp(edges[shown], axis=-1) / 2, _PATCH),
            colors=[rgb(_PATCH_COLOUR)],
            fill_mode="solid",
            labels=[f"friction {patches[k]['along']:g} along, {patches[k]['across']:g} across" for k in shown],
        )
        recording.still(f"{FIELD}/patches", flat)
    slope, heading = (float(ground.get(key) or 0.0) for key in ("slope", "uphill"))
    if slope:
        uphill, corner = [np.cos(heading), np.sin(heading), 0.0], [*(low + _FAR - 1.0), 0.02]
        arrow = rr.Arrows3D(
            vectors=[uphill], origins=[corner], labels=[f"uphill, {slope:.3g} rad"], **paint(_PATCH_COLOUR, 0.02)
        )
        recording.still(f"{FIELD}/uphill", arrow)


def _send_obstacles(recording: Recording, obstacles: Mapping[str, Any], traces: Traces) -> None:
    """Send the obstacles that the log describes."""
    posts, walls, walkers = (list(obstacles.get(kind) or ()) for kind in ("posts", "walls", "walkers"))
    if posts:
        recording.still(f"{FIELD}/posts", _cylinders([(p["x"], p["y"], p["radius"]) for p in posts]))
    if walls:
        ends = [([wall["x0"], wall["y0"]], [wall["x1"], wall["y1"]]) for wall in walls]
        around = [[[*a, 0.0], [*b, 0.0], [*b, _TALL], [*a, _TALL], [*a, 0.0]] for a, b in ends]
        recording.still(f"{FIELD}/walls", rr.LineStrips3D(around, **paint(OTHER_COLOUR, 0.01)))
    for k, walker in enumerate(walkers):
        turns_after = np.inf if walker.get("turns_after") is None else walker["turns_after"]  # JSON has no infinity
        person, entity = Walker(**{**walker, "turns_after": turns_after}), f"{FIELD}/walkers/{k}"
        recording.still(entity, _cylinders([(0.0, 0.0, person.radius)]))
        recording.poses(entity, traces.time, at_height(person.place(traces.log.time), 0.0))


def _cylinders(circles: list[tuple[float, float, float]]) -> rr.Cylinders3D:
    """Upright cylinders on the ground over circles (x, y, radius) [m]."""
    x, y, radii = np.transpose(circles)
    centres = np.column_stack([x, y, np.full(len(x), _TALL / 2)])
    return rr.Cylinders3D(
        lengths=[_TALL] * len(x), radii=radii, centers=centres, colors=[rgb(OTHER_COLOUR)], fill_mode="solid"
    )
