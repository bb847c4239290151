"""CSV files as people and their programs write them: separators, decimal commas, comments and rows of units."""

from __future__ import annotations

import csv
import re
from itertools import islice, takewhile
from pathlib import Path

import pyarrow as pa
import pyarrow.csv

from trackslip.logs.schema import COLUMNS

_LOOKED_AT = 50  # lines from which separator and decimal mark are told
_DECIMAL_COMMA = re.compile(r"^\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*$")
_TIMES = ("s", "sec", "ms", "us", "ns")  # in the column t of a row of units
_NO_UNIT = ("", "-", "1")


def read_csv(path: Path) -> pa.Table:
    """The table in a CSV file, every column as text so that errors name row and column.

    Read as well: blanks around cells, lines before the header that begin with #, columns separated by semicolons or
    tabs, decimal commas among these, and a row of units under the header, which become the units of the columns.
    """
    import pyarrow.compute as pc  # takes longer to import than pyarrow itself

    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        lines = list(islice(file, _LOOKED_AT))
    comments = len(list(takewhile(lambda line: line.lstrip().startswith("#"), lines)))
    header = lines[comments] if comments < len(lines) else ""
    separator = max(",;\t", key=header.count)
    rows = list(csv.reader(lines[comments:], delimiter=separator))
    table = pa.csv.read_csv(
        path,
        read_options=pa.csv.ReadOptions(skip_rows=comments),
        parse_options=pa.csv.ParseOptions(delimiter=separator),
        convert_options=pa.csv.ConvertOptions(column_types=dict.fromkeys(rows[0] if rows else (), pa.string())),
    )
    names = [name.strip() for name in table.column_names]
    columns = [pc.utf8_trim_whitespace(column.cast(pa.string())) for column in table.columns]
    if separator != "," and any(_DECIMAL_COMMA.match(cell) for row in rows for cell in row):
        columns = [
            column if name == "run" else pc.replace_substring(column, ",", ".")
            for name, column in zip(names, columns, strict=True)
        ]
    return _with_units(pa.Table.from_arrays(columns, names))


def _with_units(table: pa.Table) -> pa.Table:
    """The table without a first row of units, which its columns get."""
    first = [column[0].as_py().strip("[]()") for column in table.columns] if len(table) else []
    if dict(zip(table.column_names, first, strict=False)).get("t") not in _TIMES:
        return table
    fields = [
        field.with_metadata({"unit": unit}) if field.name in COLUMNS and unit not in _NO_UNIT else field
        for field, unit in zip(table.schema, first, strict=True)
    ]
    return table.slice(1).cast(pa.schema(fields))
