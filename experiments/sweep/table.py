"""The rows of a grid's runs, the table of them with units, and the choice of runs by the values of its axes."""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from experiments.storage.plain_json import plain
from experiments.storage.results import TABLE_FILE
from experiments.sweep.axes import AXES, known
from experiments.sweep.parts import Row
from trackslip.errors import InvalidValueError
from trackslip.logs.columns import Columns
from trackslip.logs.logfile import read_table
from trackslip.logs.schema import NO_UNIT, PURE, Column, markdown

COLUMNS = {
    column.name: column
    for column in (
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
}
"""Besides the axes of the sweep, which come after `id`."""
_SHOWN = 10  # values of an axis in a message


def renamed(row: Row, name: str, axes: Mapping[str, Any]) -> Row:
    """The row of a run that may have had another name and other axes in another sweep."""
    kept = {column: value for column, value in row.items() if column in COLUMNS}
    if kept.get("note"):
        kept["note"] = kept["note"].replace(repr(row["run"]), repr(name))
    return {"run": name, "id": row["id"], **plain(axes)} | kept | {"run": name}


def write_table(rows: Sequence[Row], axes: Sequence[str], path: Path) -> None:
    """Write the rows of a sweep to a Parquet file, with units and meanings in the columns' metadata."""
    run, id, *measured = COLUMNS.values()
    columns = (run, id, *(AXES.get(axis) or known()[axis][1] for axis in axes), *measured)
    arrays = [_array([row.get(column.name) for row in rows], column) for column in columns]
    pairs = zip(columns, arrays, strict=True)
    schema = pa.schema([pa.field(column.name, array.type, metadata=column.metadata) for column, array in pairs])
    pa.parquet.write_table(pa.table(arrays, schema=schema), path, write_page_checksum=True)


def _array(values: list[Any], column: Column) -> pa.Array:
    """A column of the values' common type; text if they have none, or are too large, as seeds may be."""
    if all(value is None for value in values):
        return pa.array(values, pa.float64() if column.unit else pa.string())
    try:
        return pa.array(values)
    except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError):
        return pa.array([None if value is None else str(value) for value in values])


def chosen(folder: Path, where: Sequence[str]) -> set[str]:
    """Names of the runs for which every NAME=VALUE of `where` holds.

    Raises InvalidValueError for an axis or a value that the sweep doesn't have, LogError for a folder without a table
    of runs.
    """
    table = read_table(folder / TABLE_FILE)
    Columns(table, str(folder / TABLE_FILE)).require(("run",))
    rows: list[Row] = table.to_pylist()
    axes = [name for name in rows[0] if name not in COLUMNS] if rows else []
    for text in where:
        name, _, value = text.partition("=")
        if name not in axes:
            raise InvalidValueError("where", text, f"NAME=VALUE with one of {', '.join(axes)}")
        there = list(dict.fromkeys(str(row[name]) for row in rows))
        rows = [row for row in rows if _is(row[name], value)]
        if not rows:
            raise InvalidValueError("where", text, f"{name}=one of {', '.join(there[:_SHOWN])}")
    return {str(row["run"]) for row in rows}


def _is(value: Any, text: str) -> bool:
    """True if a value equals its text."""
    if str(value) == text or (isinstance(value, bool) and str(value).lower() == text):
        return True
    with contextlib.suppress(ValueError):
        return isinstance(value, int | float) and float(text) == value
    return False


if __name__ == "__main__":
    print(markdown([*COLUMNS.values(), *AXES.values()]), end="")
