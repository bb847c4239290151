"""The memory that reading a table takes: from a Parquet file's metadata, or from a CSV file's
lines, which are counted.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, Self

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
    """Open a Parquet file whose metadata fit into the memory, see `require_fits`.

    Raises LogError for a file whose metadata don't, or that has more than MOST_COLUMNS columns;
    ArrowException for a damaged file.
    """
    require_fits(path, _footer_memory(path), max_memory)
    file = pa.parquet.ParquetFile(path, page_checksum_verification=True)
    try:
        require_few_columns(path, file.metadata.num_columns)
    except LogError:
        file.close()
        raise
    return file


class ParquetSize:
    """The memory that reading row groups of a Parquet file takes."""

    def __init__(self, path: Path, about: pa.parquet.FileMetaData) -> None:
        self._path = path
        self._about = about
        self._columns = [about.schema.column(k) for k in range(about.num_columns)]
        texts = [column.path for column in self._columns if _is_text(column)]
        # opened once, because a file with many row groups takes long to open
        self._texts = pa.parquet.ParquetFile(path, read_dictionary=texts)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._texts.close()

    def require_fits(self, groups: Sequence[int], max_memory: int | None = None) -> None:
        """Raise LogError if these row groups, read together, don't fit into the memory."""
        for needed in self._needs(groups):
            require_fits(self._path, needed, max_memory)

    def _needs(self, groups: Sequence[int]) -> Iterator[int]:
        """Yield the memory that row groups take [bytes]: first without their texts, then with each
        further column of texts, whose lengths are known only from its dictionaries.
        """
        contents = [self._about.row_group(group) for group in groups]
        rows = sum(content.num_rows for content in contents)
        needed = _footer_memory(self._path) + _ROW * rows
        needed += _CHUNK * len(self._columns) * len(contents)
        for k, column in enumerate(self._columns):
            width = _WIDTHS.get(column.physical_type, max(column.length, _DECIMAL)) + _CELL
            for content in contents:
                chunk = content.column(k)
                values = max(chunk.num_values, content.num_rows)
                needed += chunk.total_uncompressed_size + width * values
        yield needed
        for k, column in enumerate(self._columns):
            if _is_text(column):
                chunks = [content.column(k) for content in contents]
                needed += _TEXT * self._characters(column, groups, chunks)
                yield needed

    def _characters(self, column: Any, groups: Sequence[int], chunks: Sequence[Any]) -> int:
        """Size of a column's texts in row groups, repeated as often as they occur [bytes]; an upper
        bound where a look at their dictionaries doesn't tell.
        """
        if column.max_repetition_level or any(
            "DELTA_BYTE_ARRAY" in chunk.encodings for chunk in chunks
        ):
            return sum(chunk.num_values * chunk.total_uncompressed_size for chunk in chunks)
        size = 0
        for group, chunk in zip(groups, chunks, strict=True):
            text = _common_text(chunk)
            if text is not None:
                size += chunk.num_values * len(text.encode())
                continue
            (texts,) = self._texts.read_row_group(group, columns=[column.path]).flatten().columns
            size += sum(map(_expanded_size, texts.chunks))
        return size


def _common_text(chunk: Any) -> str | None:
    """The text of all cells of a column in a row group, if its statistics say that there is just
    one, as in the column of runs.
    """
    statistics = chunk.statistics
    if statistics is None or not statistics.has_min_max or statistics.min != statistics.max:
        return None
    return statistics.min if isinstance(statistics.min, str) else None


def _is_text(column: Any) -> bool:
    return bool(column.physical_type == "BYTE_ARRAY")


def require_few_columns(path: Path, columns: int) -> None:
    """Raise LogError for a table with more than MOST_COLUMNS columns."""
    if columns > MOST_COLUMNS:
        raise LogError(f"{path}: has {columns} columns, must have at most {MOST_COLUMNS}")


def _footer_memory(path: Path) -> int:
    """Memory for a Parquet file's metadata, whose size its end states [bytes]."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - _TAIL))
        stated = int.from_bytes(file.read(4), "little")
    return _FOOTER * min(stated, size)  # Arrow refuses a file that states more


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
