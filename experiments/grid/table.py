"""The table of a grid's runs, with units."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from experiments.common.run_table import COLUMNS, SOIL_COLUMNS
from experiments.common.sweep import Row
from experiments.grid.axes import known
from trackslip.logs.schema import Column


def write_table(rows: Sequence[Row], axes: Sequence[str], path: Path) -> None:
    """Write the rows of a sweep to a Parquet file, with units and descriptions in the columns'
    metadata.
    """
    run, id, *measured = COLUMNS.values()
    of_axes = [known()[axis][1] for axis in axes]
    arrays = []
    fields = []
    of_soil = [column for name, column in SOIL_COLUMNS.items() if any(name in row for row in rows)]
    for column in (run, id, *of_axes, *measured, *of_soil):
        array = _array([row.get(column.name) for row in rows], column)
        arrays.append(array)
        fields.append(pa.field(column.name, array.type, metadata=column.metadata))
    table = pa.table(arrays, schema=pa.schema(fields))
    pa.parquet.write_table(table, path, write_page_checksum=True)


def _array(values: list[Any], column: Column) -> pa.Array:
    if all(value is None for value in values):  # the type can't be seen from the values
        return pa.array(values, pa.float64() if column.unit else pa.string())
    return pa.array(values)


if __name__ == "__main__":
    for column in (COLUMNS | SOIL_COLUMNS).values():
        print(f"| `{column.name}` | {column.unit or '–'} | {column.description} |")
