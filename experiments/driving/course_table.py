"""A drive over a course as a Parquet table: the columns of a log, and more for attitude, tracks and flippers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from experiments.driving.course_run import CourseRun
from experiments.storage.plain_json import plain
from experiments.storage.results import arrow_errors
from trackslip.kinematics import Array
from trackslip.logs.logfile import packing
from trackslip.logs.schema import COLUMNS, PURE, Column
from trackslip.logs.table import file_metadata

_BODY = (
    Column("z", "m", "height of the chassis' frame"),
    Column("q_w", PURE, "attitude of the chassis, a unit quaternion"),
    Column("q_x", PURE, "attitude of the chassis, a unit quaternion"),
    Column("q_y", PURE, "attitude of the chassis, a unit quaternion"),
    Column("q_z", PURE, "attitude of the chassis, a unit quaternion"),
    Column("roll", "rad", "angle by which the chassis leans to its right"),
    Column("pitch", "rad", "angle by which the chassis points upwards"),
    Column("v_x", "m/s", "velocity of the chassis' frame in the world"),
    Column("v_y", "m/s", "velocity of the chassis' frame in the world"),
    Column("v_z", "m/s", "velocity of the chassis' frame in the world"),
    Column("w_x", "rad/s", "angular velocity in the chassis' frame"),
    Column("w_y", "rad/s", "angular velocity in the chassis' frame"),
    Column("w_z", "rad/s", "angular velocity in the chassis' frame"),
    Column("slope", "rad", "slope of the ground under the tracks along the robot, uphill is positive"),
    Column("belt_cmd_l", "m/s", "belt speed asked for, left"),
    Column("belt_cmd_r", "m/s", "belt speed asked for, right"),
)
_TRACK = {
    "belt": ("belt", "m/s", "mean belt speed since the previous row, track {}"),
    "slip": ("slip", PURE, "1 - speed over ground / belt speed, track {}; null where it doesn't touch or stands"),
    "traction": ("traction", "N", "mean force of the ground along the belt, track {}"),
    "load": ("load", "N", "mean normal force, track {}"),
    "depth": ("depth", "m", "largest penetration since the previous row, track {}"),
    "work": ("work", "J", "work of the belt against the ground since the previous row, track {}"),
}
_LOG = ("t", "omega_l", "omega_r", "x", "y", "phi")


def write_course_run(run: CourseRun, name: str, about: Mapping[str, Any], radius: float, file: Path) -> None:
    """Write a drive as a table with units; sprocket speeds are those of wheels of a radius [m].

    `about` is the run's metadata. What is not defined is null, never NaN.
    """
    columns = list(_columns(run, radius))
    # NaN stands for what is not defined, and nothing else: the states of a run that broke down are the last finite ones
    arrays = [pa.array(np.ascontiguousarray(values), from_pandas=True) for _, values in columns]
    fields = [pa.field("run", pa.string())]
    fields += [pa.field(c.name, array.type, metadata=c.metadata) for (c, _), array in zip(columns, arrays, strict=True)]
    schema = pa.schema(fields, metadata=file_metadata(fields, {name: plain(about)}))
    table = pa.Table.from_arrays([pa.array([name] * len(run.time)), *arrays], schema=schema)
    with arrow_errors(file):
        pa.parquet.write_table(table, file, row_group_size=len(run.time), **packing(schema))


def _columns(run: CourseRun, radius: float) -> Iterator[tuple[Column, Array]]:
    """Each column with its values (R,)."""
    state = run.state
    position, heading = state.position, np.unwrap(state.heading)
    omega = run.belt[:, :2] / radius
    for name, values in zip(_LOG, (run.time, *omega.T, *position.T[:2], heading), strict=True):
        yield COLUMNS[name], values
    first = state.quaternion.T
    body = (position[:, 2], *first, state.roll, state.pitch, *state.velocity.T, *state.rate.T, run.slope)
    yield from zip(_BODY, (*body, *run.command.T), strict=True)
    for field, (prefix, unit, what) in _TRACK.items():
        for track, values in zip(run.tracks, getattr(run, field).T, strict=True):
            yield Column(f"{prefix}_{track}", unit, what.format(track)), values
    for k, flipper in enumerate(run.flippers):
        yield Column(f"angle_{flipper}", "rad", f"angle of {flipper}, up is positive"), state.flippers[:, k]
        yield Column(f"angle_cmd_{flipper}", "rad", f"angle asked of {flipper}"), run.flipper_command[:, k]
