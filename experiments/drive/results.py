"""Results from a drive over a course: outcome, slip of each track, penetration and energy; and a
table of its rows.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from experiments.common.plain_json import plain
from experiments.drive.course import DrivenCourse
from trackslip.kinematics import Array
from trackslip.logs.logfile import packing
from trackslip.logs.schema import PURE, with_units
from trackslip.logs.table import file_metadata

_NAME: Final = "drive"  # name of the run


def drive_summary(run: DrivenCourse) -> dict[str, Any]:
    """Summary of a drive: outcome, lengths [m], angles [rad], penetration [m], energy [J], and a
    summary per track.
    """
    state = run.state
    contact = run.contact
    position = run.state.position
    steps = np.diff(position[:, :2], axis=0)
    end = position[-1]
    # the first row is at rest
    deepest = contact.depth.max(axis=1)[1:] if len(run.time) > 1 else np.zeros(1)
    return {
        "outcome": run.outcome,
        "duration": round(float(run.time[-1]), 9),  # simulated time [s]
        # path length of the chassis in the plane
        "way": float(np.hypot(steps[:, 0], steps[:, 1]).sum()),
        "remaining": max(0.0, run.goal - float(end[0])),  # distance left along the course
        # height of the chassis at the end, above the start
        "climbed": float(end[2] - position[0, 2]),
        "max_pitch": float(np.abs(state.pitch).max()),
        "max_roll": float(np.abs(state.roll).max()),
        "max_penetration": float(deepest.max()),
        "penetration_p99": float(np.percentile(deepest, 99)),  # 99 % of the rows penetrate less
        "energy": float(run.work.sum()),  # work of all belts against the ground
        "saturation": run.saturation,  # of the motor that was at its limit for longer
        "tracks": [_track_summary(run, k) for k in range(len(run.tracks))],
    }


def _track_summary(run: DrivenCourse, k: int) -> dict[str, Any]:
    """Slip [-], share of the time in contact, penetration [m] and work [J] of a track; no slip
    without contact.
    """
    contact = run.contact
    known = np.isfinite(contact.slip[:, k])
    slip = contact.slip[known, k]
    belt = np.abs(contact.belt[known, k])
    moved = belt.sum() > 0
    after_start = contact.touching[1:, k]
    return {
        "name": run.tracks[k],
        "slip": float(np.average(slip, weights=belt)) if moved else None,
        "slip_p95": float(np.percentile(np.abs(slip), 95)) if known.any() else None,
        "touching": float(after_start.mean()) if len(after_start) else 0.0,
        "max_penetration": float(contact.depth[:, k].max()),
        "work": float(run.work[:, k].sum()),
    }


def write_course_run(run: DrivenCourse, about: Mapping[str, Any], file: Path) -> None:
    """Write a drive as a table with units, and `about` as its metadata. Undefined values are null,
    never NaN.
    """
    arrays = [pa.array([_NAME] * len(run.time))]
    fields = [pa.field("run", pa.string())]
    for begin, ends, unit, text, values in _columns(run, about["geometry"]["sprocket_radius"]):
        metadata = {"unit": unit, "description": text}
        for end, column in zip(ends, values.T, strict=True):
            contiguous = np.ascontiguousarray(column)
            arrays.append(pa.array(contiguous, from_pandas=True))
            fields.append(pa.field(begin + end, pa.float64(), metadata=metadata))
    table = with_units(pa.Table.from_arrays(arrays, schema=pa.schema(fields)))
    table = table.replace_schema_metadata(file_metadata({_NAME: plain(about)}))
    pa.parquet.write_table(table, file, row_group_size=len(run.time), **packing(table.schema))


def _columns(run: DrivenCourse, radius: float) -> list[tuple[str, Sequence[str], str, str, Array]]:
    """Groups of columns: prefix, n suffixes, unit, description (empty for columns in every log),
    and values (R, n).
    """
    state = run.state
    contact = run.contact
    return [
        ("", ["t"], "s", "", run.time[:, None]),
        ("omega_", "lr", "rad/s", "", contact.belt[:, run.sides] / radius),
        ("", "xy", "m", "", state.position[:, :2]),
        ("", ["phi"], "rad", "", np.unwrap(state.heading)[:, None]),
        ("", "z", "m", "height of the chassis' frame", state.position[:, 2:]),
        ("q_", "wxyz", PURE, "attitude of the chassis, a unit quaternion", state.quaternion),
        ("", ["roll"], "rad", "angle by which the chassis leans to its right", state.roll[:, None]),
        ("", ["pitch"], "rad", "angle by which the chassis points upwards", state.pitch[:, None]),
        ("v_", "xyz", "m/s", "velocity of the chassis' frame in the world", state.velocity),
        ("w_", "xyz", "rad/s", "angular velocity in the chassis' frame", state.rate),
        (
            "",
            ["slope"],
            "rad",
            "slope of the ground under the tracks, along the robot, uphill",
            run.slope[:, None],
        ),
        ("belt_cmd_", "lr", "m/s", "commanded belt speed", run.command.speed),
        ("belt_", run.tracks, "m/s", "mean belt speed since the previous row", contact.belt),
        (
            "slip_",
            run.tracks,
            PURE,
            "1 - ground speed / belt speed; null without contact or at rest",
            contact.slip,
        ),
        ("traction_", run.tracks, "N", "mean force of the ground along the belt", contact.traction),
        ("load_", run.tracks, "N", "mean normal force", contact.load),
        ("depth_", run.tracks, "m", "largest penetration since the previous row", contact.depth),
        (
            "work_",
            run.tracks,
            "J",
            "work of the belt against the ground since the previous row",
            run.work,
        ),
        ("angle_", run.flippers, "rad", "angle of the flipper, tip up", run.angles),
        (
            "angle_cmd_",
            run.flippers,
            "rad",
            "angle asked of the flipper, tip up",
            run.command.flippers,
        ),
    ]
