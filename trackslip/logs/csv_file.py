"""CSV files as people and their programs write them: separators, decimal commas, comments and rows of units."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pyarrow as pa
import pyarrow.csv

from trackslip.logs.schema import COLUMNS

_LOOKED_AT = 50  # lines from which separator and decimal mark are told
_DECIMAL_COMMA = re.compile(r"^\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*$")
_NO_UNIT = ("", "-", "1")


def read_csv(path: Path) -> pa.Table:
    """The table in a CSV file, every column as text so that errors name row and column.

    Read as well: blanks around cells, lines before the header that begin with #, columns separated by semicolons or
    tabs, decimal commas among these, and a row of units under the header, which become the units of the columns.
    """
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        lines = [line for _, line in zip(range(_LOOKED_AT), file, strict=False)]
    comments = next((k for k, line in enumerate(lines) if not line.lstrip().startswith("#")), len(lines))
    separator = max(",;\t", key=lambda mark: lines[comments].count(mark) if comments < len(lines) else 0)
    rows = list(csv.reader(lines[comments:], delimiter=separator))
    names = rows[0] if rows else []
    table = pa.csv.read_csv(
        path,
        read_options=pa.csv.ReadOptions(skip_rows=comments),
        parse_options=pa.csv.ParseOptions(delimiter=separator),
        convert_options=pa.csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string())),
    )
    table = table.rename_columns([name.strip() for name in table.column_names])
    if any(pa.types.is_string(kind) for kind in table.schema.types):
        if separator != "," and any(_DECIMAL_COMMA.match(cell) for row in rows[1:] for cell in row):
            table = _with_points(table)
        if table.column_names.count("run") == 1:
            place = table.column_names.index("run")
            table = table.set_column(place, "run", _stripped(table.column(place)))
    return _with_units(table)


def _stripped(column: pa.ChunkedArray) -> pa.ChunkedArray:
    import pyarrow.compute as pc  # takes longer to import than pyarrow itself

    return pc.utf8_trim_whitespace(column) if pa.types.is_string(column.type) else column


def _with_points(table: pa.Table) -> pa.Table:
    """The table with points for the commas of its numbers."""
    import pyarrow.compute as pc

    for k, name in enumerate(table.column_names):
        if name != "run" and pa.types.is_string(table.column(k).type):
            table = table.set_column(k, name, pc.replace_substring(table.column(k), ",", "."))
    return table


def _with_units(table: pa.Table) -> pa.Table:
    """The table without a first row of units, which its columns get."""
    if "t" not in table.column_names or len(set(table.column_names)) < table.num_columns or not len(table):
        return table
    first = {name: str(table.column(name)[0].as_py() or "").strip().strip("[]()") for name in table.column_names}
    known = {name: COLUMNS[name].unit for name in first if name in COLUMNS and name not in ("run", "valid")}
    if first["t"] not in ("-", "s", "sec", "ms", "us", "ns") or any(map(_is_number, (first[name] for name in known))):
        return table
    fields = [
        field.with_metadata({"unit": first[field.name]})
        if field.name in known and first[field.name] not in _NO_UNIT
        else field
        for field in table.schema
    ]
    return table.slice(1).cast(pa.schema(fields, table.schema.metadata))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text not in _NO_UNIT
