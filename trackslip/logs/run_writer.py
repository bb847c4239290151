"""Writing runs to a Parquet file while they last: part by part, so that memory doesn't grow with their length."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import pyarrow as pa
import pyarrow.parquet

from trackslip.errors import LogError, OutputError, first_line
from trackslip.logs.logfile import packing
from trackslip.logs.runlog import RunLog
from trackslip.logs.table import file_metadata, runs_metadata, to_rows

_ROWS = 8192  # of a row group, or more: every one costs memory until the file is closed
_MOST_ROWS = 131_072  # of a row group, which readers of a single run read as a whole


class RunWriter:
    """A Parquet file of runs that are written in parts; as a context manager.

    The file appears when the block ends, and only if it ends without an error: until then there is a hidden draft
    beside it. The first call of `write` fixes runs, columns and metadata.
    """

    def __init__(self, path: Path) -> None:
        """The file `path`, which may exist."""
        self._path = path
        self._draft = path.with_name(f".{path.name}-{os.getpid()}")
        self._writer: pa.parquet.ParquetWriter | None = None
        self._runs: list[str] = []
        self._waiting: list[pa.Table] = []

    def __enter__(self) -> Self:
        return self

    def write(self, logs: Sequence[RunLog]) -> None:
        """Append parts of the runs, which follow those of the call before.

        Raises LogError if they are not of the same runs, or have other columns than theirs; OutputError for a place
        that can't be written to.
        """
        table, names = to_rows(logs), [log.run for log in logs]
        if self._writer is None:
            schema = table.schema.with_metadata(file_metadata(table.schema, runs_metadata(logs)))
            try:
                self._writer = pa.parquet.ParquetWriter(self._draft, schema, **packing(schema))
            except OSError as error:
                raise OutputError(f"{self._path}: can't be written ({first_line(error)})") from error
            self._runs = names
        if names != self._runs:
            raise LogError(f"{self._path}: part of the runs {names}, where those before are of {self._runs}")
        if table.schema != self._writer.schema:
            raise LogError(f"{self._path}: columns {table.column_names}, before {self._writer.schema.names}")
        self._waiting.append(table.replace_schema_metadata(self._writer.schema.metadata))
        if sum(map(len, self._waiting)) >= _ROWS:
            self._write_waiting(self._writer)

    def _write_waiting(self, writer: pa.parquet.ParquetWriter) -> None:
        writer.write_table(pa.concat_tables(self._waiting), _MOST_ROWS)
        self._waiting.clear()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is None:
            return
        try:
            if kind is None and self._waiting:
                self._write_waiting(self._writer)
            self._writer.close()
            if kind is None:
                os.replace(self._draft, self._path)
        finally:
            with contextlib.suppress(OSError):
                self._draft.unlink(missing_ok=True)
