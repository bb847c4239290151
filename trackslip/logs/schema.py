"""The columns in a table of runs: names, units and descriptions, which files store as metadata."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import pyarrow as pa

PURE: Final = "1"  # unit of a pure number
NO_UNIT: Final = ""  # unit of a column that is not a number


@dataclass(frozen=True)
class Column:
    """A column in a table of runs."""

    name: str
    unit: str
    description: str

    @property
    def metadata(self) -> dict[str, str]:
        """Metadata that files store with the column."""
        return {"unit": self.unit, "description": self.description}


def _tracks(name: str, unit: str, description: str) -> tuple[Column, Column]:
    return Column(f"{name}_l", unit, f"{description}, left"), Column(
        f"{name}_r", unit, f"{description}, right"
    )


_ALL: Final = (
    Column("run", NO_UNIT, "name of the run, the same in all its rows"),
    Column("t", "s", "time of the scan since the start of the run, ascending"),
    *_tracks(
        "omega", "rad/s", "sprocket speed measured by the encoder, mean since the previous reading"
    ),
    Column("x", "m", "estimated position in the field"),
    Column("y", "m", "estimated position in the field"),
    Column("phi", "rad", "estimated heading, counter-clockwise from x, unwrapped"),
    Column(
        "gyro",
        "rad/s",
        "yaw rate measured by a gyroscope, counter-clockwise, mean since the previous row",
    ),
    Column("valid", NO_UNIT, "whether the pose was measured in this scan"),
    Column(
        "load_along",
        PURE,
        "traction along the robot needed against slope and pull, over the load on its tracks",
    ),
    Column(
        "load_left",
        PURE,
        "traction to the robot's left needed against the slope, over the load on its tracks",
    ),
    *_tracks("omega_cmd", "rad/s", "sprocket speed commanded from this row to the next"),
    Column("v_cmd", "m/s", "forward speed commanded by the controller"),
    Column("w_cmd", "rad/s", "yaw rate commanded by the controller"),
    Column("icr_offset", "m", "offset D of the ICRs used for slip compensation"),
    Column("icr_radius_error", PURE, "sprocket radius error epsilon used for slip compensation"),
    Column("var_x", "m^2", "variance of x"),
    Column("cov_xy", "m^2", "covariance of x and y"),
    Column("cov_xphi", "m rad", "covariance of x and phi"),
    Column("var_y", "m^2", "variance of y"),
    Column("cov_yphi", "m rad", "covariance of y and phi"),
    Column("var_phi", "rad^2", "variance of phi"),
    Column("true_x", "m", "true position"),
    Column("true_y", "m", "true position"),
    Column("true_phi", "rad", "true heading"),
    Column("true_v", "m/s", "true forward speed"),
    Column("true_lateral", "m/s", "true speed to the left"),
    Column("true_w", "rad/s", "true yaw rate"),
    *_tracks(
        "traction",
        "N",
        "mean force of the ground on the track since the previous row, along the robot",
    ),
    *_tracks("torque", "N m", "torque of the motor at its sprocket"),
    *_tracks("power", "W", "electrical power of the motor, mean since the previous row"),
    *_tracks(
        "saturated", PURE, "share of the time since the previous row with the motor at its limit"
    ),
    *_tracks("sinkage", "m", "on soft soil: depth of the rut under the track"),
    *_tracks(
        "resistance",
        "N",
        "on soft soil: force of the soil's compaction on the track, along the robot",
    ),
    Column("true_lean", "m", "offset of the scanned plate to the left of the robot"),
    Column(
        "first_beam",
        PURE,
        "index of the beam of the first range, counted from 0 on the right; 0 without ranges",
    ),
    Column(
        "lost",
        PURE,
        "number of beams without a return between the first and the last one from the plate",
    ),
    Column(
        "hidden_first",
        "rad",
        "angle hidden by a closer object next to the first return from the plate",
    ),
    Column(
        "hidden_last",
        "rad",
        "angle hidden by a closer object next to the last return from the plate",
    ),
    Column("ranges", "m", "list of the ranges attributed to the plate, one number per beam"),
    Column(
        "all_ranges", "m", "with --rrd or --bag: list of all ranges of the scan; NaN for no return"
    ),
    Column(
        "contact",
        "N",
        "with --rrd: list of the forces of the ground on each pad: along the robot, to its left "
        "and up",
    ),
    Column("shear", "m", "with --rrd: list of the ground's shear displacements under the pads"),
    Column("v", "m/s", "forward speed of a steady sample"),
    Column("w", "rad/s", "yaw rate of a steady sample"),
    *_tracks("slip", PURE, "slip i = 1 - V / (r omega) of a steady sample"),
)
COLUMNS: Final = {column.name: column for column in _ALL}
"""Columns of the tables that trackslip writes, by name."""
_READ_ONLY: Final = (
    *_tracks("angle", "rad", "angle turned by the sprocket since any fixed time"),
    *_tracks("ticks", PURE, "ticks counted by the encoder since any fixed time"),
    Column("odom_x", "m", "position by the odometry of the wheels"),
    Column("odom_y", "m", "position by the odometry of the wheels"),
    Column("odom_phi", "rad", "heading by the odometry of the wheels, counter-clockwise"),
    Column("odom_v", "m/s", "forward speed by the odometry, mean since the previous reading"),
    Column("odom_w", "rad/s", "yaw rate by the odometry, mean since the previous reading"),
    Column("lateral", "m/s", "speed to the left of a steady sample"),
)
READ: Final = COLUMNS | {column.name: column for column in _READ_ONLY}
"""Columns that trackslip reads: those that it writes, and other readings of the encoders."""


def with_units(table: pa.Table) -> pa.Table:
    """Store unit and description as metadata of each known column; removes the table's own
    metadata.
    """
    fields = [
        f.with_metadata(COLUMNS[f.name].metadata) if f.name in COLUMNS else f for f in table.schema
    ]
    return pa.Table.from_arrays(table.columns, schema=pa.schema(fields))
