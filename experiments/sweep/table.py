"""The table of a sweep: one row per run, with units; and the choice of runs by the values of its axes."""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from experiments.storage.results import TABLE_FILE
from experiments.sweep.options import explained
from experiments.sweep.rows import COLUMNS, RunRow
from trackslip.errors import InvalidValueError
from trackslip.logs.logfile import read_table
from trackslip.logs.schema import NO_UNIT, PURE, Column, markdown

AXES = {
    column.name: column
    for column in (
        Column("radius", "m", "radius of the no-slip command"),
        Column("speed", "m/s", "speed of the no-slip command"),
        Column("friction_ratio", PURE, "friction across the track over friction along it"),
        Column("slope", "rad", "angle of the ground to the horizontal"),
        Column("ground", NO_UNIT, "name or file of the ground"),
        Column("seed", NO_UNIT, "root of all random numbers"),
    )
}
"""Axes with a name of their own; the others are options, described by their help."""
_SHOWN = 10  # values of an axis in a message
_MAX_INTEGER = 2**63 - 1
"""Largest integer of a column; larger ones (seeds) become text."""


def write_table(rows: Sequence[RunRow], axes: Sequence[str], path: Path) -> None:
    """Write the rows of a sweep to a Parquet file, with units and meanings in the columns' metadata."""
    run, id, *measured = COLUMNS.values()
    columns = (run, id, *(AXES.get(axis) or Column(axis, *explained(axis)) for axis in axes), *measured)
    cells = [row.to_json() for row in rows]
    arrays = [_array([row.get(column.name) for row in cells], column) for column in columns]
    pairs = zip(columns, arrays, strict=True)
    schema = pa.schema([pa.field(column.name, array.type, metadata=column.metadata) for column, array in pairs])
    pa.parquet.write_table(pa.table(arrays, schema=schema), path, write_page_checksum=True)


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


def chosen(folder: Path, where: Sequence[str]) -> set[str]:
    """Names of the runs for which every NAME=VALUE of `where` holds.

    Raises InvalidValueError for an axis or a value that the sweep doesn't have, LogError for a folder without a table.
    """
    rows: list[dict[str, Any]] = read_table(folder / TABLE_FILE).to_pylist()
    axes = [name for name in rows[0] if name not in COLUMNS] if rows else []
    for text in where:
        name, _, value = text.partition("=")
        if name not in axes:
            raise InvalidValueError("where", text, f"NAME=VALUE with one of {', '.join(axes)}")
        there = list(dict.fromkeys(row[name] for row in rows))
        rows = [row for row in rows if _is(row[name], value)]
        if not rows:
            raise InvalidValueError("where", text, f"{name}=one of {', '.join(map(str, there[:_SHOWN]))}")
    return {row["run"] for row in rows}


def _is(value: Any, text: str) -> bool:
    """Whether a value equals its text."""
    if str(value) == text or (isinstance(value, bool) and str(value).lower() == text):
        return True
    with contextlib.suppress(ValueError):
        return isinstance(value, int | float) and float(text) == value
    return False


if __name__ == "__main__":
    print(markdown([*COLUMNS.values(), *AXES.values()]), end="")
