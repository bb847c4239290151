"""Reads and writes Parquet and CSV files of runs, and joins Parquet files without loading all runs
at once.
"""

from __future__ import annotations

import contextlib
import csv
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any, BinaryIO, Final

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from trackslip.errors import LogError, LogWarning, first_line
from trackslip.files import known_manifest, regular_file
from trackslip.logs.columns import HUGE
from trackslip.logs.layout import AS_DOCUMENTED, Layout
from trackslip.logs.runlog import RunLog
from trackslip.logs.schema import NO_UNIT, READ
from trackslip.logs.size import ParquetSize, first_lines, open_parquet, require_csv_fits
from trackslip.logs.table import file_metadata, stored_metadata, to_table
from trackslip.logs.table_reader import ReadRuns, RunsInTables

RUNS: Final = "runs.parquet"  # name of the file with a results folder's runs
# least number of rows that are read at once from a file of many runs: tens of megabytes
_ROWS_AT_ONCE: Final = 20_000
_BLOCK: Final = 8_000_000  # size of the part of a CSV file that is in memory as text [bytes]
_LOOKED_AT: Final = 50  # number of lines that decide the separator and the decimal mark
_DECIMAL_COMMA: Final = re.compile(r"^\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*$")
# names in a header, one of each kind of encoder readings
_OF_HEADERS: Final = ("omega_l", "angle_l", "ticks_l", "odom_x", "odom_v")
_TIMES: Final = ("s", "sec", "ms", "us", "ns")  # units of the column t that identify a row of units


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
    return pa.concat_tables(read_tables(path, max_memory))


def read_tables(
    path: Path, max_memory: int | None = None, *, all_kept: bool = True
) -> Iterator[pa.Table]:
    """Read the table in a `.parquet` or `.csv` file in parts, each with all rows of its runs.

    A Parquet file with one run per row group is read in parts of some runs, any other file in one
    part. Raises LogError if the file cannot be read, or if reading it takes more than `max_memory`
    [bytes], see `require_fits`. Unless `all_kept`, the parts are taken one at a time, and only one
    must fit into the memory.
    """
    kind = path.suffix.lower()
    try:
        regular_file(path)
        if kind == ".csv":
            yield _read_csv(path, max_memory)
        elif kind == ".parquet":
            with (
                open_parquet(path, max_memory) as file,
                ParquetSize(path, file.metadata) as size,
            ):
                parts = _parts_with_whole_runs(file.metadata)
                if all_kept:
                    size.require_fits(range(file.metadata.num_row_groups), max_memory)
                for groups in parts:
                    if not all_kept:
                        size.require_fits(groups, max_memory)
                    yield file.read_row_groups(groups)
        else:
            raise LogError(f"{path}: must end in .parquet or .csv")
    except FileNotFoundError as error:
        raise LogError(f"{path}: no such file") from error
    except (pa.ArrowException, OSError, csv.Error, UnicodeError) as error:
        if isinstance(error, OSError) and error.strerror:
            raise LogError(f"{path}: {error.strerror}") from error
        reason = first_line(error).split("': ")[-1]  # pyarrow may repeat the file's name
        if kind == ".parquet":
            reason = f"damaged, cut short or no Parquet file ({reason})"
        raise LogError(f"{path}: {reason}") from error


def _parts_with_whole_runs(metadata: pa.parquet.FileMetaData) -> list[list[int]]:
    """Successive row groups in parts of at least _ROWS_AT_ONCE rows, each with whole runs.

    That is known if each row group contains a single run, in the order of the runs; otherwise all
    row groups are one part.
    """
    single_part = [list(range(metadata.num_row_groups))]
    paths = [metadata.schema.column(k).path for k in range(metadata.num_columns)]
    if "run" not in paths:
        return single_part
    parts: list[list[int]] = [[]]
    rows = 0
    seen: set[str | int] = set()
    last: str | int | None = None
    for group in single_part[0]:
        content = metadata.row_group(group)
        names = content.column(paths.index("run")).statistics
        if names is None or names.null_count or not isinstance(names.min, str | int):
            return single_part
        if names.min != names.max or (names.min != last and names.min in seen):
            return single_part
        if names.min != last and rows >= _ROWS_AT_ONCE:
            parts.append([])
            rows = 0
        parts[-1].append(group)
        rows += content.num_rows
        last = names.min
        seen.add(names.min)
    return parts


def _read_csv(path: Path, max_memory: int | None) -> pa.Table:
    """Read the table in a CSV file. Columns are numbers or, if a cell isn't a number, text, so that
    errors can name row and column and show the cell.

    The file may have blanks around cells, lines beginning with # before the header, columns
    separated by semicolons or tabs (and then decimal commas), and, below the header, a row with the
    columns' units.
    """
    lines = first_lines(path, _LOOKED_AT)
    comments = _comments_before_header(lines)
    header = lines[comments] if comments < len(lines) else ""
    separator = max(",;\t", key=header.count)
    require_csv_fits(path, 1 + header.count(separator), max_memory)

    # the first rows tell the columns' names, units and decimal mark
    rows = [row for row in csv.reader(lines[comments:], delimiter=separator) if row]
    stated = rows[0] if rows else []
    units = _units([_name(cell) for cell in stated], rows[1] if len(rows) > 1 else [])
    cells = (cell for row in rows for cell in row)
    decimal_comma = separator != "," and any(_DECIMAL_COMMA.match(cell) for cell in cells)

    # the text of one block at a time is in memory
    read_options = pa.csv.ReadOptions(
        skip_rows=comments, skip_rows_after_names=1 if units else 0, block_size=_BLOCK
    )
    as_text = pa.csv.ConvertOptions(column_types=dict.fromkeys(stated, pa.string()))
    blocks = pa.csv.open_csv(
        path,
        read_options=read_options,
        parse_options=pa.csv.ParseOptions(delimiter=separator),
        convert_options=as_text,
    )
    names = [_name(cell) for cell in blocks.schema.names]
    parts: list[list[pa.Array]] = []
    for block in blocks:
        named = zip(names, block.columns, strict=True)
        parts.append([_trimmed(name, column, decimal_comma) for name, column in named])

    columns = [_joined([part[k] for part in parts]) for k in range(len(names))]
    fields = [
        pa.field(name, column.type, metadata=units.get(name))
        for name, column in zip(names, columns, strict=True)
    ]
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def _comments_before_header(lines: Sequence[str]) -> int:
    """Number of lines before the header: those that begin with #, unless the last of them is the
    header, as from numpy.savetxt.
    """
    comments = len(list(takewhile(lambda line: line.lstrip().startswith("#"), lines)))
    if not comments:
        return 0
    after = "".join(lines[comments : comments + 1])
    is_header = any(name in lines[comments - 1] for name in _OF_HEADERS)
    return (
        comments - 1 if is_header and not any(name in after for name in _OF_HEADERS) else comments
    )


def _name(cell: str) -> str:
    """A column's name in a header."""
    return cell.strip("# ")


def _units(names: Sequence[str], row: Sequence[str]) -> dict[str, dict[str, str]]:
    """Metadata, by column, from the row below the header; empty unless it is a row of units."""
    cells = {name: cell.strip().strip("[]()") for name, cell in zip(names, row, strict=False)}
    if cells.get("t") not in _TIMES:
        return {}
    no_unit = ("", "-", "1")
    return {
        name: {"unit": unit} if name in READ and unit not in no_unit else {}
        for name, unit in cells.items()
    }


def _trimmed(name: str, column: pa.Array, decimal_comma: bool) -> pa.Array:
    """A part of a column as numbers or, if a cell isn't a plausible number, as text without
    blanks.
    """
    import pyarrow.compute as pc  # takes longer to import than pyarrow itself

    text = pc.utf8_trim_whitespace(column.cast(pa.string()))
    if decimal_comma and name != "run":
        text = pc.replace_substring(text, ",", ".")
    if name in READ and READ[name].unit == NO_UNIT:
        return text
    try:
        numbers = pc.if_else(pc.equal(text, ""), None, text).cast(pa.float64())
    except pa.ArrowInvalid:
        return text
    return text if pc.any(pc.greater(pc.abs(numbers), HUGE)).as_py() else numbers


def _joined(parts: Sequence[pa.Array]) -> pa.ChunkedArray:
    """A column from its parts: numbers, or text if any part is text."""
    if any(pa.types.is_string(part.type) for part in parts):
        return pa.chunked_array([part.cast(pa.string()) for part in parts], pa.string())
    return pa.chunked_array(parts, pa.float64())


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


def read_runs(
    path: Path, max_memory: int | None = None, layout: Layout = AS_DOCUMENTED
) -> list[RunLog]:
    """Read the runs in a file, with a LogWarning for each part left out; raises LogError if no run
    can be read, or if reading takes more than `max_memory` [bytes].
    """
    read = read_log(path, max_memory, layout)
    for line in read.warnings:
        warnings.warn(f"{path}: {line}", LogWarning, stacklevel=3)
    return list(read.runs)


def read_log(path: Path, max_memory: int | None = None, layout: Layout = AS_DOCUMENTED) -> ReadRuns:
    """Read the runs in a file, with notes on the parts left out; raises LogError if no run can be
    read, or if reading takes more than `max_memory` [bytes].
    """
    tables = read_tables(path, max_memory)
    return RunsInTables(tables, str(path), max_memory, layout).read()


def runs_in(
    path: Path, max_memory: int | None = None, layout: Layout = AS_DOCUMENTED
) -> RunsInTables:
    """The runs in a file, to iterate over, of which those of one part at a time are in memory; see
    `read_log`.
    """
    tables = read_tables(path, max_memory, all_kept=False)
    return RunsInTables(tables, str(path), max_memory, layout)


def join_parquet(runs: Sequence[tuple[Path, str, str]], path: Path) -> None:
    """Copy runs, each given as (file, name, new name), in order from files by `write_parquet` to a
    single file.

    Each run is a row group, so only one run at a time is in memory. Raises LogError if a file
    cannot be read.
    """
    with contextlib.ExitStack() as stack:
        try:
            files = {}
            sizes = {}
            for file in {file for file, *_ in runs}:
                files[file] = stack.enter_context(open_parquet(file))
                sizes[file] = stack.enter_context(ParquetSize(file, files[file].metadata))
            about = {
                file: stored_metadata(read.schema_arrow.metadata, str(file))
                for file, read in files.items()
            }
            group = {
                file: {name: k for k, name in enumerate(descriptions)}
                for file, descriptions in about.items()
            }
            columns = {file: read.schema_arrow.remove_metadata() for file, read in files.items()}
            unified = pa.unify_schemas([columns[file] for file, *_ in runs])
            schema = unified.with_metadata(
                file_metadata({new: about[file][name] for file, name, new in runs})
            )
            with pa.parquet.ParquetWriter(path, schema, **packing(schema)) as writer:
                for file, name, new in runs:
                    sizes[file].require_fits([group[file][name]])
                    table = files[file].read_row_group(group[file][name])
                    table = table.replace_schema_metadata(None)
                    table = table.set_column(0, "run", pa.repeat(new, len(table)))
                    # without the metadata of all runs, which would be copied for each run
                    table = pa.concat_tables(
                        [unified.empty_table(), table], promote_options="default"
                    )
                    writer.write_table(table, row_group_size=len(table))
        except (pa.ArrowException, OSError) as error:
            raise LogError(f"{path}: its runs can't be joined ({first_line(error)})") from error
