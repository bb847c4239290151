"""The field of a robot run as its log describes it: ground, scanner and obstacles, of which only people move."""

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from experiments.recorder.model import send_geoms, send_paving
from experiments.recorder.sensing import OTHER_COLOUR
from experiments.recorder.stream import FIELD, at_height, quaternion, rgb, send
from experiments.recorder.traces import Traces
from sim.scanner.obstacles import Walker
from trackslip.kinematics import Array
from trackslip.logs.runlog import MALFORMED

_FAR = 3.0  # to where patches without end are drawn around everything [m]
_PATCH, _PATCH_COLOUR = 0.0005, "#4f6f78"  # half the thickness of a patch on the ground [m]
_TALL = 1.0  # height of posts, walls and people [m]


def send_field(stream: rr.RecordingStream, traces: Traces, model: mujoco.MjModel, within: Array) -> None:
    """Send the ground around the points `within` (n, 2), and the scanner and obstacles that a run's log describes."""
    send_paving(stream, within)
    if (mount := mount_of(traces)) is not None:
        turn = rr.Quaternion(xyzw=quaternion(mount[2:])[0])
        pose = rr.Transform3D(translation=[mount[0], mount[1], model.body("lrf").pos[2]], quaternion=turn)
        stream.log(f"{FIELD}/scanner", pose, static=True)
        send_geoms(stream, f"{FIELD}/scanner", model, model.body("lrf").id)
    with contextlib.suppress(*MALFORMED):
        _send_ground(stream, traces.log.metadata["ground"], within.min(axis=0) - _FAR, within.max(axis=0) + _FAR)
    with contextlib.suppress(*MALFORMED):
        _send_obstacles(stream, traces.log.metadata["obstacles"], traces)


def mount_of(traces: Traces) -> Array | None:
    """The scanner's pose (3,), if the log has it."""
    if traces.log.scans is not None:
        return traces.log.scans.scan.mount
    with contextlib.suppress(*MALFORMED):
        mount = np.array(traces.log.metadata["lrf"]["mount"], float)
        return mount if mount.shape == (3,) and np.isfinite(mount).all() else None
    return None


def _send_ground(stream: rr.RecordingStream, ground: Mapping[str, Any], low: Array, high: Array) -> None:
    """Send patches with other friction as far as they lie between `low` and `high` (2,), and the uphill direction."""
    patches = ground.get("patches") or ()
    corners = np.array([[patch["x"], patch["y"]] for patch in patches], float).reshape(-1, 2, 2).transpose(0, 2, 1)
    corners = np.clip(np.where(np.isnan(corners), [[-np.inf], [np.inf]], corners), low, high)  # JSON has no infinity
    shown = np.flatnonzero((corners[:, 0] < corners[:, 1]).all(axis=1))
    if len(shown):
        flat = rr.Boxes3D(
            centers=at_height(corners[shown].mean(axis=1), _PATCH),
            half_sizes=at_height(np.ptp(corners[shown], axis=1) / 2, _PATCH),
            colors=[rgb(_PATCH_COLOUR)],
            fill_mode="solid",
            labels=[f"friction {patches[k]['along']:g} along, {patches[k]['across']:g} across" for k in shown],
        )
        stream.log(f"{FIELD}/patches", flat, static=True)
    slope, heading = (float(ground.get(key) or 0.0) for key in ("slope", "uphill"))
    if slope and np.isfinite([slope, heading]).all():
        arrow = rr.Arrows3D(
            vectors=[[np.cos(heading), np.sin(heading), 0.0]],
            origins=[[*(low + _FAR - 1.0), 0.02]],
            labels=[f"uphill, {slope:.3g} rad"],
            colors=[rgb(_PATCH_COLOUR)],
            radii=[0.02],
        )
        stream.log(f"{FIELD}/uphill", arrow, static=True)


def _send_obstacles(stream: rr.RecordingStream, known: Mapping[str, Any], traces: Traces) -> None:
    """Send the obstacles that the log describes."""
    posts, walls, walkers = (list(known.get(kind) or ()) for kind in ("posts", "walls", "walkers"))
    if posts:
        centres = [[post["x"], post["y"], _TALL / 2] for post in posts]
        stream.log(f"{FIELD}/posts", _cylinders(centres, [post["radius"] for post in posts]), static=True)
    if walls:
        ends = [([wall["x0"], wall["y0"]], [wall["x1"], wall["y1"]]) for wall in walls]
        around = [[[*a, 0.0], [*b, 0.0], [*b, _TALL], [*a, _TALL], [*a, 0.0]] for a, b in ends]
        stream.log(f"{FIELD}/walls", rr.LineStrips3D(around, colors=[rgb(OTHER_COLOUR)], radii=[0.01]), static=True)
    for k, walker in enumerate(walkers):
        turns_after = np.inf if walker.get("turns_after") is None else walker["turns_after"]  # JSON has no infinity
        person = Walker(**{**walker, "turns_after": turns_after})
        entity = f"{FIELD}/walkers/{k}"
        stream.log(entity, _cylinders([[0, 0, _TALL / 2]], [person.radius]), static=True)
        place = at_height(person.place(traces.log.time), 0.0)
        send(stream, entity, traces.time, rr.Transform3D.columns(translation=place))


def _cylinders(centres: Sequence[Sequence[float]], radii: Sequence[float]) -> rr.Cylinders3D:
    style: dict[str, Any] = {"colors": [rgb(OTHER_COLOUR)], "fill_mode": "solid"}
    return rr.Cylinders3D(lengths=[_TALL] * len(radii), radii=radii, centers=centres, **style)
