"""The memory that reading a table takes: from a Parquet file's metadata, or from a CSV file's
lines, which are counted.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from trackslip.errors import LogError
from trackslip.memory import require_fits

MOST_COLUMNS: Final = 10_000
"""Most columns of a table; a log of trackslip has about 50."""
LONGEST_LINE: Final = 1_000_000
"""Longest line of a CSV file [characters]; Arrow reads none that is longer."""

# Upper bounds on the peak memory of `trackslip log`; a table of 2.4e6 rows took 210 bytes a row
_ROW: Final = 300  # values, masks and runs, whatever the number of columns [bytes per row]
_RUN: Final = 4000  # a run, however few rows it has [bytes]
_LISTED: Final = 60  # a number in a list, in the run that is being read [bytes]
_CELL: Final = 8  # offsets and nulls of a cell, beside its value [bytes]
_TEXT: Final = 3  # copies of a column of text
_CHUNK: Final = 1000  # a column in a row group, however few rows it has [bytes]
_FOOTER: Final = 40  # a Parquet file's metadata, and the JSON in it [bytes per byte of the file]
_WIDTHS: Final = {
    "BOOLEAN": 1,
    "INT32": 4,
    "INT64": 8,
    "INT96": 8,
    "FLOAT": 4,
    "DOUBLE": 8,
    "BYTE_ARRAY": 4,  # without the characters
}  # [bytes per value]
_DECIMAL: Final = 32  # the widest decimal [bytes per value]
_TAIL: Final = 8  # end of a Parquet file: the length of its metadata, and PAR1 [bytes]
_PIECE: Final = 16_000_000  # size of the pieces in which lines are counted [bytes]


def open_parquet(path: Path, max_memory: int | None = None) -> pa.parquet.ParquetFile:
    """Open a Parquet file that fits into the memory, see `require_fits`.

    Raises LogError for one that doesn't, or has more than MOST_COLUMNS columns; ArrowException for
    a damaged file.
    """
    footer = _footer_size(path)
    require_fits(path, _FOOTER * footer, max_memory)
    file = pa.parquet.ParquetFile(path, page_checksum_verification=True)
    try:
        require_few_columns(path, file.metadata.num_columns)
        for needed in _parquet_needs(path, file.metadata, footer):
            require_fits(path, needed, max_memory)
    except BaseException:
        file.close()
        raise
    return file


def require_few_columns(path: Path, columns: int) -> None:
    """Raise LogError for a table with more than MOST_COLUMNS columns."""
    if columns > MOST_COLUMNS:
        raise LogError(f"{path}: has {columns} columns, must have at most {MOST_COLUMNS}")


def _footer_size(path: Path) -> int:
    """Size of a Parquet file's metadata, as its end states it [bytes]."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _TAIL))
        stated = int.from_bytes(file.read(4), "little")
    return min(stated, size)  # Arrow refuses a file that states more


def _parquet_needs(path: Path, about: pa.parquet.FileMetaData, footer: int) -> Iterator[int]:
    """Yield the memory that reading a Parquet file takes [bytes]: first without its texts, then
    with each further column of texts, whose lengths are known only from its dictionaries.
    """
    columns = [about.schema.column(k) for k in range(about.num_columns)]
    groups = [about.row_group(k) for k in range(about.num_row_groups)]
    needed = _FOOTER * footer + _ROW * about.num_rows + _CHUNK * len(columns) * len(groups)
    for k, column in enumerate(columns):
        width = _WIDTHS.get(column.physical_type, max(column.length, _DECIMAL)) + _CELL
        for group in groups:
            chunk = group.column(k)
            needed += chunk.total_uncompressed_size + width * max(chunk.num_values, group.num_rows)
    yield needed
    for k, column in enumerate(columns):
        if column.physical_type == "BYTE_ARRAY":
            chunks = [group.column(k) for group in groups]
            needed += _TEXT * _characters(path, column, chunks)
            yield needed


def _characters(path: Path, column: Any, chunks: Sequence[Any]) -> int:
    """Size of a column's texts, repeated as often as they occur [bytes]; an upper bound where a
    look at their dictionaries doesn't tell.
    """
    if column.max_repetition_level or any(
        "DELTA_BYTE_ARRAY" in chunk.encodings for chunk in chunks
    ):
        return sum(chunk.num_values * chunk.total_uncompressed_size for chunk in chunks)
    size = 0
    with pa.parquet.ParquetFile(path, read_dictionary=[column.path]) as file:
        for group in range(len(chunks)):
            (texts,) = file.read_row_group(group, columns=[column.path]).flatten().columns
            size += sum(map(_expanded_size, texts.chunks))
    return size


def _expanded_size(texts: pa.DictionaryArray) -> int:
    """Size of texts without their dictionary [bytes]."""
    import pyarrow.compute as pc  # takes longer to import than pyarrow itself

    lengths = pc.fill_null(pc.binary_length(texts.dictionary), 0).to_numpy()
    counts = np.bincount(texts.indices.drop_null().to_numpy(), minlength=len(lengths))
    return int(counts @ lengths)


def require_csv_fits(path: Path, columns: int, max_memory: int | None = None) -> None:
    """Raise LogError for a CSV file with more lines of `columns` cells than fit into the memory, or
    with more than MOST_COLUMNS columns.
    """
    require_few_columns(path, columns)
    size = rows = 0
    with path.open("rb") as file:
        while piece := file.read(_PIECE):
            size += len(piece)
            rows += max(piece.count(b"\n"), piece.count(b"\r"))
    require_fits(path, _ROW * rows + _TEXT * (size + _CELL * rows * columns), max_memory)


def require_runs_fit(
    source: object, table: pa.Table, run: np.ndarray, max_memory: int | None = None
) -> None:
    """Raise LogError for a table with more runs, or a run with longer lists of ranges, than fit
    into the memory; `run` (T,) has the number of the run of each row.
    """
    import pyarrow.compute as pc

    require_fits(source, _RUN * (int(run.max(initial=0)) + 1), max_memory)
    for column in table.columns:
        if pa.types.is_list(column.type):
            lengths = pc.fill_null(pc.list_value_length(column), 0).to_numpy()
            longest = int(np.bincount(run, lengths).max(initial=0))
            require_fits(source, _LISTED * longest, max_memory)


def first_lines(path: Path, most: int) -> list[str]:
    """The first lines of a text, at most `most`; raises LogError for one that is longer than
    LONGEST_LINE.
    """
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        lines: list[str] = []
        while len(lines) < most and (line := file.readline(LONGEST_LINE + 1)):
            if len(line) > LONGEST_LINE:
                raise LogError(
                    f"{path}: line {len(lines) + 1} is longer than {LONGEST_LINE} characters"
                )
            lines.append(line)
    return lines
