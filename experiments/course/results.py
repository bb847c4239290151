"""Results of a drive over a course: outcome, slip of each track, penetration and energy; and its rows as a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from experiments.course.run import CourseRun
from experiments.storage.plain_json import plain
from sim.terrain import Course
from trackslip.kinematics import Array
from trackslip.logs.logfile import packing
from trackslip.logs.schema import COLUMNS, PURE, Column
from trackslip.logs.table import file_metadata

_ATTITUDE = "attitude of the chassis, a unit quaternion"
_VELOCITY, _RATE = "velocity of the chassis' frame in the world", "angular velocity in the chassis' frame"
_BODY = (
    Column("z", "m", "height of the chassis' frame"),
    *(Column(f"q_{axis}", PURE, _ATTITUDE) for axis in "wxyz"),
    Column("roll", "rad", "angle by which the chassis leans to its right"),
    Column("pitch", "rad", "angle by which the chassis points upwards"),
    *(Column(f"v_{axis}", "m/s", _VELOCITY) for axis in "xyz"),
    *(Column(f"w_{axis}", "rad/s", _RATE) for axis in "xyz"),
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


@dataclass(frozen=True)
class TrackResult:
    """What one track did on the way."""

    name: str
    slip: float | None  # mean weighted by the way of the belt while it touched [-]
    slip_p95: float | None  # 95th percentile of the slip's magnitude [-]
    touching: float  # share of the time in which it touched the ground [-]
    max_penetration: float  # [m]
    work: float  # of the belt against the ground [J]


@dataclass(frozen=True)
class DriveResult:
    """How a drive over a course went."""

    outcome: str  # that of the run
    duration: float  # simulated time [s]
    way: float  # of the chassis in the plane [m]
    remaining: float  # along the course until its end [m]
    climbed: float  # height of the chassis at the end, above that at the start [m]
    max_pitch: float  # largest magnitude [rad]
    max_roll: float  # largest magnitude [rad]
    max_penetration: float  # of any track [m]
    penetration_p99: float  # 99th percentile of the largest penetration in each row [m]
    energy: float  # work of all belts against the ground [J]
    tracks: tuple[TrackResult, ...]

    @classmethod
    def of(cls, run: CourseRun, course: Course) -> DriveResult:
        """The results of a run."""
        state, moving = run.state, run.depth[1:]
        position = state.position
        deepest = moving.max(axis=1) if len(moving) else np.zeros(1)
        return cls(
            outcome=run.outcome,
            duration=round(float(run.time[-1]), 9),
            way=float(np.hypot(*np.diff(position[:, :2], axis=0).T).sum()),
            remaining=max(0.0, course.goal - float(position[-1, 0])),
            climbed=float(position[-1, 2] - position[0, 2]),
            max_pitch=float(np.abs(state.pitch).max()),
            max_roll=float(np.abs(state.roll).max()),
            max_penetration=float(deepest.max()),
            penetration_p99=float(np.percentile(deepest, 99)),
            energy=float(run.work.sum()),
            tracks=tuple(_track(run, k) for k in range(len(run.tracks))),
        )


def _track(run: CourseRun, k: int) -> TrackResult:
    slip, known = run.slip[:, k], np.isfinite(run.slip[:, k])
    belt = np.abs(run.belt[known, k])
    return TrackResult(
        name=run.tracks[k],
        slip=float(np.average(slip[known], weights=belt)) if belt.sum() > 0 else None,
        slip_p95=float(np.percentile(np.abs(slip[known]), 95)) if known.any() else None,
        touching=float(run.touching[1:, k].mean()) if len(run.time) > 1 else 0.0,
        max_penetration=float(run.depth[:, k].max()),
        work=float(run.work[:, k].sum()),
    )


def slip_by_slope(slope: Array, slip: Array, width: float) -> tuple[Array, Array]:
    """Middles (B,) of bins of slope of some width, and median and quartiles (B, 3) of the slip in them.

    Bins with fewer than five values are left out.
    """
    known = np.isfinite(slip)
    which = np.round(slope[known] / width).astype(int)
    bins = [b for b in np.unique(which) if np.sum(which == b) >= 5]
    quartiles = [np.percentile(slip[known][which == b], (25, 50, 75)) for b in bins]
    return np.array(bins, float) * width, np.array(quartiles).reshape(-1, 3)[:, [1, 0, 2]]


def write_course_run(run: CourseRun, name: str, about: Mapping[str, Any], file: Path) -> None:
    """Write a drive as a table with units.

    `about` is the run's metadata. What is not defined is null, never NaN.
    """
    columns = list(_columns(run, about["geometry"]["sprocket_radius"]))
    # NaN stands for what is not defined, and nothing else: the states of a run that broke down are the last finite ones
    arrays = [pa.array(np.ascontiguousarray(values), from_pandas=True) for _, values in columns]
    fields = [pa.field("run", pa.string())]
    fields += [pa.field(c.name, array.type, metadata=c.metadata) for (c, _), array in zip(columns, arrays, strict=True)]
    schema = pa.schema(fields, metadata=file_metadata(fields, {name: plain(about)}))
    table = pa.Table.from_arrays([pa.array([name] * len(run.time)), *arrays], schema=schema)
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
