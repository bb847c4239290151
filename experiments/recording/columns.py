"""Send runs to rerun by columns: one call per quantity, not per row."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr

from experiments.recording import robot_mesh
from experiments.recording.series import Series
from trackslip.kinematics import Array

TIMELINE = "time"


def send(stream: rr.RecordingStream, entity: str, time: Array, columns: Any) -> None:
    """Send columns of T rows at times (T,) [s] since the start of the run."""
    nanoseconds = np.rint(1e9 * time).astype("timedelta64[ns]")
    stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=nanoseconds)], columns)


def quaternion(heading: Array) -> Array:
    """Quaternions (T, 4), xyzw, of rotations about the vertical by `heading` (T,) [rad]."""
    zero = np.zeros_like(heading)
    return np.stack([zero, zero, np.sin(heading / 2), np.cos(heading / 2)], axis=-1)


def at_height(pose: Array, height: float = 0.0) -> Array:
    """Positions (T, 3) of poses (T, 3) at a height above the ground [m]."""
    return np.column_stack([pose[:, :2], np.full(len(pose), height)])


def send_poses(stream: rr.RecordingStream, entity: str, time: Array, pose: Array, height: float = 0.0) -> None:
    """Send poses (T, 3) of an entity at a height above the ground [m]."""
    columns = rr.Transform3D.columns(translation=at_height(pose, height), quaternion=quaternion(pose[:, 2]))
    send(stream, entity, time, columns)


def mesh(triangles: robot_mesh.Triangles) -> rr.Mesh3D:
    """Triangles as a mesh."""
    corners, normals, colours = triangles.vertices, triangles.normals, triangles.colours
    return rr.Mesh3D(vertex_positions=corners, vertex_normals=normals, vertex_colors=colours)


def send_series(stream: rr.RecordingStream, root: str, time: Array, series: Sequence[Series]) -> list[str]:
    """Send lines over time with their names and colours; returns their entities, below `root`."""
    sent = [f"{root}/{line.entity}" for line in series]
    for entity, line in zip(sent, series, strict=True):
        count = line.values.shape[1]
        colours = [rgb(colour) for colour in line.colours]
        stream.log(entity, rr.SeriesLines(names=line.names, colors=colours, widths=[line.width] * count), static=True)
        columns = rr.Scalars.columns(scalars=line.values.ravel())
        send(stream, entity, time, columns.partition(np.full(len(time), count)))
    return sent


def send_properties(stream: rr.RecordingStream, name: str, metadata: Mapping[str, Any]) -> None:
    """Send a run's metadata as properties of the recording."""
    if flat := _flat(metadata):
        stream.send_property(name, rr.AnyValues(**flat))


def _flat(metadata: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Flatten nested mappings, joining names by underscores; anything but numbers and text becomes text."""
    found: dict[str, Any] = {}
    for key, value in metadata.items():
        name = f"{before}{key}".replace(" ", "_")
        if isinstance(value, Mapping):
            found |= _flat(value, f"{name}_")
        elif value is not None:
            found[name] = value if isinstance(value, bool | int | float | str) else str(value)
    return found


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of '#rrggbb'."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
