"""Reads and writes Parquet and CSV files of runs, and joins Parquet files without loading all runs
at once.
"""

from __future__ import annotations

import contextlib
import csv
import re
import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from trackslip.errors import LogError, LogWarning, first_line
from trackslip.files import known_manifest, regular_file
from trackslip.logs.runlog import RunLog
from trackslip.logs.schema import COLUMNS
from trackslip.logs.size import first_lines, open_parquet, require_csv_fits
from trackslip.logs.table import file_metadata, stored_metadata, to_table
from trackslip.logs.table_reader import ReadRuns, runs_from_table

RUNS = "runs.parquet"  # name of the file with a results folder's runs
_LOOKED_AT = 50  # number of lines that decide the separator and the decimal mark
_DECIMAL_COMMA = re.compile(r"^\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*$")
_TIMES = ("s", "sec", "ms", "us", "ns")  # units of the column t that identify a row of units


def write_parquet(logs: Sequence[RunLog], file: Path | BinaryIO) -> None:
    """Write runs to a Parquet file, in order, with one row group per run."""
    table = to_table(logs)
    with pa.parquet.ParquetWriter(file, table.schema, **packing(table.schema)) as writer:
        first = 0
        for log in logs:
            writer.write_table(table.slice(first, len(log.time)), row_group_size=len(log.time))
            first += len(log.time)


def packing(schema: pa.Schema) -> dict[str, Any]:
    """Options for the Parquet writer: compact storage for measured numbers, which rarely repeat,
    with checksums.

    Zstandard would make files a tenth smaller but take 1.5 times as long. Statistics let readers
    skip runs and times.
    """
    return {
        "compression": "lz4",
        "use_dictionary": ["run"],
        "use_byte_stream_split": [
            field.name for field in schema if pa.types.is_float64(field.type)
        ],
        "write_statistics": ["run", "t"],
        "write_page_checksum": True,
    }


def write_csv(logs: Sequence[RunLog], path: Path) -> None:
    """Write runs to a CSV file without metadata, ranges, contacts and shear; all other numbers are
    exact.
    """
    plain = [
        replace(log, scans=None, truth=log.truth and replace(log.truth, contact=None, shear=None))
        for log in logs
    ]
    pa.csv.write_csv(to_table(plain), path)


def read_table(path: Path, max_memory: int | None = None) -> pa.Table:
    """Read the table in a `.parquet` or `.csv` file.

    Raises LogError if it cannot be read, or if reading it takes more than `max_memory` [bytes], see
    `require_fits`.
    """
    kind = path.suffix.lower()
    try:
        regular_file(path)
        if kind == ".csv":
            return _read_csv(path, max_memory)
        if kind == ".parquet":
            with open_parquet(path, max_memory) as file:
                return file.read()
    except FileNotFoundError as error:
        raise LogError(f"{path}: no such file") from error
    except (pa.ArrowException, OSError, csv.Error, UnicodeError) as error:
        if isinstance(error, OSError) and error.strerror:
            raise LogError(f"{path}: {error.strerror}") from error
        reason = first_line(error).split("': ")[-1]  # pyarrow may repeat the file's name
        if kind == ".parquet":
            reason = f"damaged, cut short or no Parquet file ({reason})"
        raise LogError(f"{path}: {reason}") from error
    raise LogError(f"{path}: must end in .parquet or .csv")


def _read_csv(path: Path, max_memory: int | None) -> pa.Table:
    """Read the table in a CSV file with every column as text, so that errors can name row and
    column.

    The file may have blanks around cells, lines beginning with # before the header, columns
    separated by semicolons or tabs (and then decimal commas), and, below the header, a row with the
    columns' units.
    """
    import pyarrow.compute as pc  # takes longer to import than pyarrow itself

    lines = first_lines(path, _LOOKED_AT)
    comments = len(list(takewhile(lambda line: line.lstrip().startswith("#"), lines)))
    if (
        comments
        and "omega_l" in lines[comments - 1]
        and "omega_l" not in "".join(lines[comments : comments + 1])
    ):
        comments -= 1  # the last comment is the header, as from numpy.savetxt
    header = lines[comments] if comments < len(lines) else ""
    separator = max(",;\t", key=header.count)
    require_csv_fits(path, 1 + header.count(separator), max_memory)
    rows = list(csv.reader(lines[comments:], delimiter=separator))
    table = pa.csv.read_csv(
        path,
        read_options=pa.csv.ReadOptions(skip_rows=comments),
        parse_options=pa.csv.ParseOptions(delimiter=separator),
        convert_options=pa.csv.ConvertOptions(
            column_types=dict.fromkeys(rows[0] if rows else (), pa.string())
        ),
    )
    names = [name.strip("# ") for name in table.column_names]
    columns = [pc.utf8_trim_whitespace(column.cast(pa.string())) for column in table.columns]
    if separator != "," and any(_DECIMAL_COMMA.match(cell) for row in rows for cell in row):
        columns = [
            column if name == "run" else pc.replace_substring(column, ",", ".")
            for name, column in zip(names, columns, strict=True)
        ]
    return _with_units(pa.Table.from_arrays(columns, names))


def _with_units(table: pa.Table) -> pa.Table:
    """Move a first row of units, if there is one, to the metadata of the table's columns."""
    first = [column[0].as_py().strip("[]()") for column in table.columns] if len(table) else []
    if dict(zip(table.column_names, first, strict=False)).get("t") not in _TIMES:
        return table
    fields = [
        field.with_metadata({"unit": unit})
        if field.name in COLUMNS and unit not in ("", "-", "1")
        else field
        for field, unit in zip(table.schema, first, strict=True)
    ]
    return table.slice(1).cast(pa.schema(fields))


def runs_file(path: Path) -> Path:
    """The runs' file in a results folder, or `path` if not a folder; LogError for a folder with no
    or too new runs.
    """
    try:
        if not path.is_dir():
            return path
        if not (path / RUNS).is_file():
            raise LogError(f"{path}: there is no {RUNS} in this folder")
        known_manifest(path)
    except OSError as error:
        raise LogError(f"path = {str(path)[:80]!r}: {error.strerror}") from error
    return path / RUNS


def read_runs(path: Path, max_memory: int | None = None) -> list[RunLog]:
    """Read the runs in a file, with a LogWarning for each part left out; raises LogError if no run
    can be read, or if reading takes more than `max_memory` [bytes].
    """
    read = read_log(path, max_memory)
    for line in read.warnings:
        warnings.warn(f"{path}: {line}", LogWarning, stacklevel=3)
    return list(read.runs)


def read_log(path: Path, max_memory: int | None = None) -> ReadRuns:
    """Read the runs in a file, with notes on the parts left out; raises LogError if no run can be
    read, or if reading takes more than `max_memory` [bytes].
    """
    return runs_from_table(read_table(path, max_memory), str(path), max_memory)


def join_parquet(runs: Sequence[tuple[Path, str, str]], path: Path) -> None:
    """Copy runs, each given as (file, name, new name), in order from files by `write_parquet` to a
    single file.

    Each run is a row group, so only one run at a time is in memory. Raises LogError if a file
    cannot be read.
    """
    with contextlib.ExitStack() as stack:
        try:
            files = {}
            for file in {file for file, *_ in runs}:
                files[file] = stack.enter_context(open_parquet(file))
            about = {
                file: stored_metadata(read.schema_arrow.metadata, str(file))
                for file, read in files.items()
            }
            schema = pa.unify_schemas(
                [files[file].schema_arrow.remove_metadata() for file, *_ in runs]
            )
            schema = schema.with_metadata(
                file_metadata({new: about[file][name] for file, name, new in runs})
            )
            with pa.parquet.ParquetWriter(path, schema, **packing(schema)) as writer:
                for file, name, new in runs:
                    table = (
                        files[file]
                        .read_row_group([*about[file]].index(name))
                        .replace_schema_metadata(None)
                    )
                    table = table.set_column(0, "run", pa.repeat(new, len(table)))
                    table = pa.concat_tables(
                        [schema.empty_table(), table], promote_options="default"
                    )
                    writer.write_table(table, row_group_size=len(table))
        except (pa.ArrowException, OSError) as error:
            raise LogError(f"{path}: its runs can't be joined ({first_line(error)})") from error
