"""The rows of a grid's runs, and the table of them with units."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from experiments.common.plain_json import plain
from experiments.common.run_table import COLUMNS
from experiments.common.sweep import Row
from experiments.grid.axes import AXES, known
from trackslip.logs.schema import Column, markdown


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


if __name__ == "__main__":
    print(markdown([*COLUMNS.values(), *AXES.values()]), end="")
