"""Results of a drive over a course: outcome, slip of each track, penetration and energy; and its rows as a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from experiments.common.plain_json import plain
from experiments.drive.course import DrivenCourse
from trackslip.kinematics import Array
from trackslip.logs.logfile import packing
from trackslip.logs.schema import COLUMNS, PURE, Column
from trackslip.logs.table import file_metadata

_NAME = "drive"  # of the run
_LOG = ("t", "omega_l", "omega_r", "x", "y", "phi")
_TRACK = {
    "belt": ("m/s", "mean belt speed since the previous row"),
    "slip": (PURE, "1 - speed over ground / belt speed; null where the track doesn't touch or stands"),
    "traction": ("N", "mean force of the ground along the belt"),
    "load": ("N", "mean normal force"),
    "depth": ("m", "largest penetration since the previous row"),
    "work": ("J", "work of the belt against the ground since the previous row"),
}


def drive_summary(run: DrivenCourse) -> dict[str, Any]:
    """Summary of a drive: outcome, lengths [m], angles [rad], penetration [m], energy [J], and each track."""
    state, moving = run.state, run.depth[1:]
    position = state.position
    deepest = moving.max(axis=1) if len(moving) else np.zeros(1)
    return {
        "outcome": run.outcome,
        "duration": round(float(run.time[-1]), 9),  # simulated time [s]
        "way": float(np.hypot(*np.diff(position[:, :2], axis=0).T).sum()),  # of the chassis in the plane
        "remaining": max(0.0, run.course.goal - float(position[-1, 0])),  # along the course until its end
        "climbed": float(position[-1, 2] - position[0, 2]),  # height of the chassis at the end, above the start
        "max_pitch": float(np.abs(state.pitch).max()),
        "max_roll": float(np.abs(state.roll).max()),
        "max_penetration": float(deepest.max()),
        "penetration_p99": float(np.percentile(deepest, 99)),  # of the largest penetration in each row
        "energy": float(run.work.sum()),  # work of all belts against the ground
        "tracks": [_track_summary(run, k) for k in range(len(run.tracks))],
    }


def _track_summary(run: DrivenCourse, k: int) -> dict[str, Any]:
    """Slip [-], share of the time in touch, penetration [m] and work [J] of a track; no slip where it never touched."""
    slip, known = run.slip[:, k], np.isfinite(run.slip[:, k])
    belt = np.abs(run.belt[known, k])
    return {
        "name": run.tracks[k],
        "slip": float(np.average(slip[known], weights=belt)) if belt.sum() > 0 else None,
        "slip_p95": float(np.percentile(np.abs(slip[known]), 95)) if known.any() else None,
        "touching": float(run.touching[1:, k].mean()) if len(run.time) > 1 else 0.0,
        "max_penetration": float(run.depth[:, k].max()),
        "work": float(run.work[:, k].sum()),
    }


def slip_by_slope(slope: Array, slip: Array, width: float) -> tuple[Array, Array]:
    """Middles (B,) of bins of slope of some width, and median and quartiles (B, 3) of the slip in them.

    Bins with fewer than five values are left out.
    """
    known = np.isfinite(slip)
    which = np.round(slope[known] / width).astype(int)
    bins = [b for b in np.unique(which) if np.sum(which == b) >= 5]
    quartiles = [np.percentile(slip[known][which == b], (25, 50, 75)) for b in bins]
    return np.array(bins, float) * width, np.array(quartiles).reshape(-1, 3)[:, [1, 0, 2]]


def write_course_run(run: DrivenCourse, about: Mapping[str, Any], file: Path) -> None:
    """Write a drive as a table with units, and `about` as its metadata. What is not defined is null, never NaN."""
    columns = list(_columns(run, about["geometry"]["sprocket_radius"]))
    # NaN stands for what is not defined, and nothing else: the states of a run that broke down are the last finite ones
    arrays = [pa.array(np.ascontiguousarray(values), from_pandas=True) for _, values in columns]
    fields = [pa.field("run", pa.string())]
    fields += [pa.field(c.name, array.type, metadata=c.metadata) for (c, _), array in zip(columns, arrays, strict=True)]
    schema = pa.schema(fields, metadata=file_metadata(fields, {_NAME: plain(about)}))
    table = pa.Table.from_arrays([pa.array([_NAME] * len(run.time)), *arrays], schema=schema)
    pa.parquet.write_table(table, file, row_group_size=len(run.time), **packing(schema))


def _columns(run: DrivenCourse, radius: float) -> Iterator[tuple[Column, Array]]:
    """Each column with its values (R,)."""
    state = run.state
    position, heading = state.position, np.unwrap(state.heading)
    omega = run.belt[:, :2] / radius
    for name, values in zip(_LOG, (run.time, *omega.T, *position.T[:2], heading), strict=True):
        yield COLUMNS[name], values
    for names, unit, what, columns in (
        (("z",), "m", "height of the chassis' frame", position[:, 2:]),
        (("q_w", "q_x", "q_y", "q_z"), PURE, "attitude of the chassis, a unit quaternion", state.quaternion),
        (("roll",), "rad", "angle by which the chassis leans to its right", state.roll[:, None]),
        (("pitch",), "rad", "angle by which the chassis points upwards", state.pitch[:, None]),
        (("v_x", "v_y", "v_z"), "m/s", "velocity of the chassis' frame in the world", state.velocity),
        (("w_x", "w_y", "w_z"), "rad/s", "angular velocity in the chassis' frame", state.rate),
        (
            ("slope",),
            "rad",
            "slope of the ground under the tracks, along the robot, uphill is positive",
            run.slope[:, None],
        ),
        (("belt_cmd_l",), "m/s", "belt speed asked for, left", run.command[:, :1]),
        (("belt_cmd_r",), "m/s", "belt speed asked for, right", run.command[:, 1:]),
    ):
        yield from ((Column(name, unit, what), values) for name, values in zip(names, columns.T, strict=True))
    for name, (unit, what) in _TRACK.items():
        for track, values in zip(run.tracks, getattr(run, name).T, strict=True):
            yield Column(f"{name}_{track}", unit, f"{what}, track {track}"), values
    for k, flipper in enumerate(run.flippers):
        yield Column(f"angle_{flipper}", "rad", f"angle of {flipper}, up is positive"), state.flippers[:, k]
        yield Column(f"angle_cmd_{flipper}", "rad", f"angle asked of {flipper}"), run.flipper_command[:, k]
