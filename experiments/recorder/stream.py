"""Files of recordings, and the columns of rows over time that they consist of."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import rerun as rr

from experiments.common.results import write_output
from trackslip.errors import OutputError, first_line
from trackslip.kinematics import Array

TIMELINE = "time"
RUN, FIELD, CAMERA = "run", "field", "camera"
"""Entities: the run, or several runs below it; what stands still; and what the eye of the viewer follows."""


def write_recording(file: Path, title: str, send: Callable[[rr.RecordingStream], None]) -> None:
    """Write what `send` sends as a .rrd file, complete or not at all; OutputError if it can't be written."""

    def write(draft: Path) -> None:
        draft.touch()  # fails as files do
        with rr.RecordingStream("trackslip", recording_id=uuid4()) as stream:
            stream.send_recording_name(title)
            stream.save(draft)
            send(stream)
            stream.flush()
            stream.disconnect()

    try:
        write_output(file, write)
    except RuntimeError as error:  # rerun writes in a thread of its own, which ends where a disk is full
        raise OutputError(f"{file}: can't be written ({first_line(error)})") from error


def send(stream: rr.RecordingStream, entity: str, time: Array, columns: Any) -> None:
    """Send columns of T rows at times (T,) [s] since the start of the run."""
    nanoseconds = np.rint(1e9 * time).astype("timedelta64[ns]")
    stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=nanoseconds)], columns)


def send_poses(stream: rr.RecordingStream, entity: str, time: Array, pose: Array, height: float = 0.0) -> None:
    """Send poses (T, 3) of an entity at a height above the ground [m]."""
    columns = rr.Transform3D.columns(translation=at_height(pose, height), quaternion=quaternion(pose[:, 2]))
    send(stream, entity, time, columns)


def send_shapes(
    stream: rr.RecordingStream,
    entity: str,
    time: Array,
    counts: np.ndarray,
    archetype: Any,
    style: Mapping[str, Any],
    **columns: Array,
) -> None:
    """Send shapes of an archetype of rerun's, `counts` (T,) of them a row; `style` is that of all, `columns` differ."""
    if counts.any():
        stream.log(entity, archetype.from_fields(**style), static=True)
        send(stream, entity, time, archetype.columns(**columns).partition(counts))


def send_line(stream: rr.RecordingStream, entity: str, points: Array, colour: str, radius: float) -> None:
    """Send a line through points (n, 3) that stays; radius in [m]."""
    if len(points):
        stream.log(entity, rr.LineStrips3D([points], colors=[rgb(colour)], radii=[radius]), static=True)


def send_properties(stream: rr.RecordingStream, name: str, metadata: Mapping[str, Any]) -> None:
    """Send a run's metadata as properties of the recording; anything but numbers and text becomes text."""
    flat: dict[str, Any] = {
        key.replace(" ", "_"): value if isinstance(value, bool | int | float | str) else str(value)
        for key, value in metadata.items()
        if value is not None
    }
    if flat:
        stream.send_property(name, rr.AnyValues(**flat))


def quaternion(heading: Array) -> Array:
    """Quaternions (T, 4), xyzw, of rotations about the vertical by `heading` (T,) [rad]."""
    zero = np.zeros_like(heading)
    return np.stack([zero, zero, np.sin(heading / 2), np.cos(heading / 2)], axis=-1)


def at_height(pose: Array, height: float) -> Array:
    """Positions (T, 3) of poses (T, 2 or 3) at a height above the ground [m]."""
    return np.column_stack([pose[:, :2], np.full(len(pose), height)])


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of '#rrggbb'."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
