"""The field in which a robot ran, as the log describes it: ground, scanner and obstacles."""

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any, Final

import mujoco
import numpy as np
import rerun as rr

from experiments.common.traces import Traces
from experiments.recorder.model import send_geoms, send_paving
from experiments.recorder.ruts import Ruts, send_ruts
from experiments.recorder.sensing import OTHER_COLOUR
from experiments.recorder.stream import FIELD, Recording, about_vertical, paint, rgb
from trackslip.kinematics import Array
from trackslip.logs.runlog import MALFORMED

_FAR: Final = 3.0  # distance by which unbounded patches extend beyond everything else [m]
_PATCH: Final = 0.0005  # half the thickness of a patch on the ground [m]
_PATCH_COLOUR: Final = "#4f6f78"
_HEIGHT: Final = 1.0  # height of posts and walls [m]


def send_field(
    recording: Recording, traces: Traces, model: mujoco.MjModel, within: Array, ruts: Ruts
) -> None:
    """Send the ground around the points `within` (n, 2) with its ruts, and the scanner and
    obstacles of a run.
    """
    send_paving(recording, within, without=ruts.stones)
    send_ruts(recording, ruts)
    _send_scanner(recording, traces, model)
    metadata = traces.log.metadata
    with contextlib.suppress(*MALFORMED):
        patches = metadata["ground"].get("patches") or ()
        low = within.min(axis=0) - _FAR
        high = within.max(axis=0) + _FAR
        _send_patches(recording, patches, low, high)
    with contextlib.suppress(*MALFORMED):
        _send_obstacles(recording, metadata["obstacles"])


def _send_scanner(recording: Recording, traces: Traces, model: mujoco.MjModel) -> None:
    """Send the scanner where it is mounted, if the log has scans."""
    scans = traces.log.scans
    if scans is None:
        return
    x, y, _ = scans.scan.mount
    body = model.body("lrf")
    turn = about_vertical(scans.scan.mount[2:])[0]
    place = rr.Transform3D(translation=[x, y, body.pos[2]], quaternion=rr.Quaternion(xyzw=turn))
    recording.still(f"{FIELD}/scanner", place)
    send_geoms(recording, f"{FIELD}/scanner", model, body.id)


def _send_patches(
    recording: Recording, patches: Sequence[Mapping[str, Any]], low: Array, high: Array
) -> None:
    """Send the parts of patches with different friction that lie between the corners `low` and
    `high` (2,) [m].
    """
    for k, patch in enumerate(patches):
        edges = np.array([patch["x"], patch["y"]], float)  # None, now NaN, where it is unbounded
        begin = np.fmax(edges[:, 0], low)
        end = np.fmin(edges[:, 1], high)
        if (begin >= end).any():
            continue
        middle = (begin + end) / 2
        half = (end - begin) / 2
        friction = f"friction {patch['along']:g} along, {patch['across']:g} across"
        box = rr.Boxes3D(
            centers=[[*middle, _PATCH]],
            half_sizes=[[*half, _PATCH]],
            colors=[rgb(_PATCH_COLOUR)],
            fill_mode="solid",
            labels=[friction],
        )
        recording.still(f"{FIELD}/patches/{k}", box)


def _send_obstacles(recording: Recording, obstacles: Mapping[str, Any]) -> None:
    """Send the obstacles that the log describes."""
    posts = list(obstacles.get("posts") or ())
    walls = list(obstacles.get("walls") or ())
    if posts:
        circles = [(post["x"], post["y"], post["radius"]) for post in posts]
        recording.still(f"{FIELD}/posts", _cylinders(circles))
    if walls:
        outlines = [_outline(wall) for wall in walls]
        lines = rr.LineStrips3D(outlines, **paint(OTHER_COLOUR, 0.01))
        recording.still(f"{FIELD}/walls", lines)


def _outline(wall: Mapping[str, Any]) -> list[list[float]]:
    """The closed outline of an upright wall."""
    begin = [wall["x0"], wall["y0"]]
    end = [wall["x1"], wall["y1"]]
    return [[*begin, 0.0], [*end, 0.0], [*end, _HEIGHT], [*begin, _HEIGHT], [*begin, 0.0]]


def _cylinders(circles: list[tuple[float, float, float]]) -> rr.Cylinders3D:
    """Upright cylinders on the ground over circles (x, y, radius) [m]."""
    x, y, radii = np.transpose(circles)
    centres = np.column_stack([x, y, np.full(len(x), _HEIGHT / 2)])
    return rr.Cylinders3D(
        lengths=[_HEIGHT] * len(x),
        radii=radii,
        centers=centres,
        colors=[rgb(OTHER_COLOUR)],
        fill_mode="solid",
    )
