"""Recordings: static shapes, rows over time, and plot lines, written to a file for the rerun
viewer.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from uuid import uuid4

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from experiments.common.results import write_output
from trackslip.kinematics import Array
from trackslip.metrics import TRANSIENT

TIMELINE: Final = "time"
RUN: Final = "run"
"""Entity of the run, or of several runs below it."""
FIELD: Final = "field"
"""Entity of everything static."""
CAMERA: Final = "camera"
"""Entity of the point that the viewer's camera follows."""


@dataclass(frozen=True)
class Series:
    """Lines in a plot over time."""

    entity: str
    values: Array  # (T, n), NaN for a gap
    names: Sequence[str]  # (n,)
    colours: Sequence[str]  # (n,) or more
    width: float = 1.5  # [px]


class Recording:
    """A recording that is being written. Rows are at times (T,) since the start of the run [s]."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self.stream = stream
        self.plotted: dict[str, Array] = {}
        """Values of the plot lines after the transient, by entity."""
        self.duration = 0.0
        """Duration of the plot lines [s]."""

    def still(self, entity: str, archetype: Any) -> None:
        """Add a static shape."""
        self.stream.log(entity, archetype, static=True)

    def rows(self, entity: str, time: Array, columns: Any) -> None:
        """Add columns with T rows."""
        nanoseconds = np.rint(1e9 * time).astype("timedelta64[ns]")
        self.stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=nanoseconds)], columns)

    def poses(
        self, entity: str, time: Array, position: Array, attitude: Array | None = None
    ) -> None:
        """Move an entity through positions (T, 3) [m] with attitudes (T, 4), quaternions xyzw."""
        self.rows(entity, time, rr.Transform3D.columns(translation=position, quaternion=attitude))

    def shapes(
        self, entity: str, time: Array, counts: np.ndarray, look: Any, **columns: Any
    ) -> None:
        """Add shapes like the archetype `look`, `counts` (T,) of them per row; `columns` differ
        between the shapes.
        """
        if counts.any():
            self.still(entity, look)
            self.rows(entity, time, type(look).columns(**columns).partition(counts))

    def line(self, entity: str, points: Array, colour: str, radius: float) -> None:
        """Add a line through points (n, 3); radius in [m]."""
        if len(points):
            self.still(entity, rr.LineStrips3D([points], **paint(colour, radius)))

    def series(self, root: str, time: Array, series: Sequence[Series]) -> None:
        """Add plot lines below the entity `root`."""
        late = time >= min(TRANSIENT, time[-1] / 2)
        for lines in series:
            entity = f"{root}/{lines.entity}"
            count = len(lines.names)
            colours = [rgb(colour) for colour in lines.colours[:count]]
            look = rr.SeriesLines(names=lines.names, colors=colours, widths=[lines.width] * count)
            self.still(entity, look)
            columns = rr.Scalars.columns(scalars=lines.values.ravel())
            self.rows(entity, time, columns.partition(np.full(len(time), count)))
            self.plotted[entity] = lines.values[late]
        self.duration = max(self.duration, float(time[-1]))


def write_recording(file: Path, title: str, send: Callable[[Recording], None]) -> None:
    """Write a .rrd file of all that `send` adds, complete or not at all; raises OutputError if it
    can't be written.
    """

    def write(draft: Path) -> None:
        draft.touch()  # fails at once if the file can't be written
        with rr.RecordingStream("trackslip", recording_id=uuid4()) as stream:
            # not to the file: rerun's thread for it hangs when the disk is full
            memory = rr.binary_stream(recording=stream)
            stream.send_recording_name(title)
            try:
                send(Recording(stream))
            finally:
                # once, because each part that is read is a recording of its own, and also after an
                # error, because rerun prints a warning about data that nobody has read
                content = memory.read()
        draft.write_bytes(content or b"")

    write_output(file, write)


def about_vertical(heading: Array) -> Array:
    """Quaternions (T, 4), xyzw, of rotations about the vertical by `heading` (T,) [rad]."""
    return np.asarray(Rotation.from_euler("z", heading[:, None]).as_quat())


def at_height(pose: Array, height: float) -> Array:
    """Positions (T, 3) [m] of poses (T, 2 or 3), at a height above the ground [m]."""
    return np.column_stack([pose[:, :2], np.full(len(pose), height)])


def paint(colour: str, radius: float, opacity: int = 255) -> dict[str, Any]:
    """Keywords of points, lines and arrows for the colour '#rrggbb', a radius [m] and an opacity (0
    to 255).
    """
    return {"colors": [(*rgb(colour), opacity)], "radii": [radius]}


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of '#rrggbb'."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
