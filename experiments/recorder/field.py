"""The field in which a robot ran, as the log describes it: ground, scanner and obstacles."""

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from experiments.recorder.model import send_geoms, send_paving
from experiments.recorder.sensing import OTHER_COLOUR
from experiments.recorder.stream import FIELD, Recording, about_vertical, paint, rgb
from experiments.recorder.traces import Traces
from trackslip.kinematics import Array
from trackslip.logs.runlog import MALFORMED

_FAR = 3.0  # distance by which unbounded patches extend beyond everything else [m]
_PATCH, _PATCH_COLOUR = 0.0005, "#4f6f78"  # half the thickness of a patch on the ground [m]
_TALL = 1.0  # height of posts and walls [m]


def send_field(recording: Recording, traces: Traces, model: mujoco.MjModel, within: Array) -> None:
    """Send the ground around the points `within` (n, 2), and the scanner and obstacles of a run."""
    send_paving(recording, within)
    if traces.log.scans is not None:
        mount = traces.log.scans.scan.mount
        place, turn = (
            [*mount[:2], model.body("lrf").pos[2]],
            rr.Quaternion(xyzw=about_vertical(mount[2:])[0]),
        )
        recording.still(f"{FIELD}/scanner", rr.Transform3D(translation=place, quaternion=turn))
        send_geoms(recording, f"{FIELD}/scanner", model, model.body("lrf").id)
    metadata = traces.log.metadata
    with contextlib.suppress(*MALFORMED):
        patches = metadata["ground"].get("patches") or ()
        _send_patches(recording, patches, within.min(axis=0) - _FAR, within.max(axis=0) + _FAR)
    with contextlib.suppress(*MALFORMED):
        _send_obstacles(recording, metadata["obstacles"])


def _send_patches(
    recording: Recording, patches: Sequence[Mapping[str, Any]], low: Array, high: Array
) -> None:
    """Send the parts of patches with different friction that lie between the corners `low` and
    `high` (2,) [m].
    """
    for k, patch in enumerate(patches):
        edges = np.array([patch["x"], patch["y"]], float)
        # NaN where a patch is unbounded
        begin, end = np.fmax(edges[:, 0], low), np.fmin(edges[:, 1], high)
        if (begin < end).all():
            flat = rr.Boxes3D(
                centers=[[*(begin + end) / 2, _PATCH]],
                half_sizes=[[*(end - begin) / 2, _PATCH]],
                colors=[rgb(_PATCH_COLOUR)],
                fill_mode="solid",
                labels=[f"friction {patch['along']:g} along, {patch['across']:g} across"],
            )
            recording.still(f"{FIELD}/patches/{k}", flat)


def _send_obstacles(recording: Recording, obstacles: Mapping[str, Any]) -> None:
    """Send the obstacles that the log describes."""
    posts, walls = (list(obstacles.get(kind) or ()) for kind in ("posts", "walls"))
    if posts:
        recording.still(
            f"{FIELD}/posts", _cylinders([(p["x"], p["y"], p["radius"]) for p in posts])
        )
    if walls:
        ends = [([wall["x0"], wall["y0"]], [wall["x1"], wall["y1"]]) for wall in walls]
        around = [[[*a, 0.0], [*b, 0.0], [*b, _TALL], [*a, _TALL], [*a, 0.0]] for a, b in ends]
        recording.still(f"{FIELD}/walls", rr.LineStrips3D(around, **paint(OTHER_COLOUR, 0.01)))


def _cylinders(circles: list[tuple[float, float, float]]) -> rr.Cylinders3D:
    """Upright cylinders on the ground over circles (x, y, radius) [m]."""
    x, y, radii = np.transpose(circles)
    centres = np.column_stack([x, y, np.full(len(x), _TALL / 2)])
    return rr.Cylinders3D(
        lengths=[_TALL] * len(x),
        radii=radii,
        centers=centres,
        colors=[rgb(OTHER_COLOUR)],
        fill_mode="solid",
    )
