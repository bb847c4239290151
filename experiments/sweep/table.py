"""The table of a sweep: one row per run, with units."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from experiments.sweep.options import explained
from experiments.sweep.rows import COLUMNS, RunRow
from trackslip.logs.schema import NO_UNIT, PURE, Column, markdown

_AXES = (
    Column("radius", "m", "radius of the no-slip command"),
    Column("speed", "m/s", "speed of the no-slip command"),
    Column("friction_ratio", PURE, "friction across the track over friction along it"),
    Column("slope", "rad", "angle of the ground to the horizontal"),
    Column("ground", NO_UNIT, "name or file of the ground"),
    Column("seed", NO_UNIT, "root of all random numbers"),
)
AXES = {column.name: column for column in _AXES}
"""Axes with a name of their own; the others are options, described by their help."""
_MAX_INTEGER = 2**63 - 1
"""Largest integer of a column; larger ones (seeds) become text."""


def write_table(rows: Sequence[RunRow], axes: Sequence[str], path: Path) -> None:
    """Write the rows of a sweep to a Parquet file, with units and meanings in the columns' metadata."""
    first, last = [*COLUMNS.values()][:2], [*COLUMNS.values()][2:]
    about = [AXES.get(axis) or Column(axis, *explained(axis)) for axis in axes]
    columns = (*first, *about, *last)
    cells = [row.to_json() for row in rows]
    arrays = [_array([row.get(column.name) for row in cells], column) for column in columns]
    fields = [
        pa.field(column.name, array.type, metadata=column.metadata)
        for column, array in zip(columns, arrays, strict=True)
    ]
    pa.parquet.write_table(pa.table(arrays, schema=pa.schema(fields)), path, write_page_checksum=True)


def _array(values: list[Any], column: Column) -> pa.Array:
    """A column of the values' common type; text if there are none, or several types."""
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
