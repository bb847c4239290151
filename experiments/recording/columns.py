"""Send runs to rerun by columns: one call per quantity, not per row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr

from experiments.recording import geometry
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


def mesh(triangles: geometry.Triangles) -> rr.Mesh3D:
    """Triangles as a mesh."""
    return rr.Mesh3D(
        vertex_positions=triangles.vertices, vertex_normals=triangles.normals, vertex_colors=triangles.colours
    )


def send_series(stream: rr.RecordingStream, entity: str, time: Array, series: Sequence[Series]) -> None:
    """Send lines over time with their names and colours."""
    for line in series:
        style = rr.SeriesLines(
            names=list(line.names),
            colors=[rgb(colour) for colour in line.colours],
            widths=[line.width] * len(line.names),
        )
        stream.log(f"{entity}/{line.entity}", style, static=True)
        count = line.values.shape[1]
        columns = rr.Scalars.columns(scalars=line.values.ravel())
        send(stream, f"{entity}/{line.entity}", time, columns.partition(np.full(len(time), count)))


def send_properties(stream: rr.RecordingStream, name: str, metadata: Mapping[str, Any]) -> None:
    """Send a run's metadata as properties of the recording."""
    flat = _flat(metadata)
    if flat:
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
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
