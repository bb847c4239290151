"""A row for each run of a sweep, as a table with units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from experiments.sweep.options import explained
from trackslip.logs.schema import NO_UNIT, PURE, Column, markdown

_MEASURED = (
    Column("run", NO_UNIT, "name of the run: its log in runs.parquet"),
    Column("id", NO_UNIT, "hash of all that the run is: options, robot, ground, seed"),
    Column("error", NO_UNIT, "why there is no run; null where there is one"),
    Column("omega_l", "rad/s", "measured speed of the left sprocket"),
    Column("omega_r", "rad/s", "measured speed of the right sprocket"),
    Column("v", "m/s", "measured forward speed"),
    Column("w", "rad/s", "measured yaw rate"),
    Column("observed_radius", "m", "measured radius, positive to the left"),
    Column("slip_l", PURE, "measured slip of the left track"),
    Column("slip_r", PURE, "measured slip of the right track"),
    Column("true_slip_l", PURE, "true slip of the left track"),
    Column("true_slip_r", PURE, "true slip of the right track"),
    Column("note", NO_UNIT, "what of the run could not be used, and why; null where all could"),
    Column("rmse_x", "m", "root mean square error of the poses along x"),
    Column("rmse_y", "m", "root mean square error of the poses along y"),
    Column("rmse_heading", "rad", "root mean square error of the headings"),
    Column("valid_fraction", PURE, "share of the scans that gave a pose"),
    Column("saturated", PURE, "share of the time with a motor at its limit, the worse track"),
    Column("made_by", NO_UNIT, "digest of the code, models and libraries that drove it, listed in summary.json"),
)
COLUMNS = {column.name: column for column in _MEASURED}
"""Besides the axes of the sweep, which come after `id`."""
_AXES = (
    Column("radius", "m", "radius of the no-slip command"),
    Column("speed", "m/s", "speed of the no-slip command"),
    Column("friction_ratio", PURE, "friction across the track over friction along it"),
    Column("slope", "rad", "angle of the ground to the horizontal"),
    Column("ground", NO_UNIT, "name or file of the ground"),
    Column("seed", NO_UNIT, "root of all random numbers"),
)
AXES = {column.name: column for column in _AXES}
"""Those that have a name of their own; others are options, whose help is their description."""
_MAX_INTEGER = 2**63 - 1
"""Integer of a column; larger ones, seeds, are text."""


def write_table(rows: Sequence[Mapping[str, Any]], axes: Sequence[str], path: Path) -> None:
    """Write the rows of a sweep to a Parquet file; units and meanings are in the columns' metadata."""
    first, last = [*COLUMNS.values()][:2], [*COLUMNS.values()][2:]
    about = [AXES.get(axis) or Column(axis, *explained(axis)) for axis in axes]
    columns = (*first, *about, *last)
    arrays = [_column([row.get(column.name) for row in rows], column) for column in columns]
    fields = [
        pa.field(column.name, array.type, metadata=column.metadata)
        for column, array in zip(columns, arrays, strict=True)
    ]
    pa.parquet.write_table(pa.table(arrays, schema=pa.schema(fields)), path, write_page_checksum=True)


def is_row(row: object) -> bool:
    """Whether that is a row of a sweep: with numbers where numbers belong, and texts where texts do."""
    if not isinstance(row, Mapping) or not all(isinstance(row.get(name), str) for name in ("run", "id", "made_by")):
        return False
    return "error" in row and all(
        row.get(column.name) is None
        or (
            isinstance(row[column.name], str if column.unit == NO_UNIT else int | float)
            and not isinstance(row[column.name], bool)
        )
        for column in _MEASURED
    )


def _column(values: list[Any], column: Column) -> pa.Array:
    """A column of the type that its values have; text where there are none, or of several kinds."""
    kinds = {type(value) for value in values if value is not None}
    if kinds == {int} and max(value for value in values if value is not None) > _MAX_INTEGER:
        kinds = {str}
    if kinds <= {int, float} and (kinds or column.unit != NO_UNIT):
        return pa.array(values, pa.int64() if kinds == {int} else pa.float64())
    if kinds == {bool}:
        return pa.array(values, pa.bool_())
    return pa.array([None if value is None else str(value) for value in values], pa.string())


if __name__ == "__main__":
    print(markdown([*COLUMNS.values(), *AXES.values()]), end="")
