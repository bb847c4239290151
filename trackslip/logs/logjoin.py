"""Joining runs from several Parquet files into one, without loading all of them."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from trackslip.errors import LogError, first_line
from trackslip.logs.logfile import packing
from trackslip.logs.table import file_metadata, stored_text

_AHEAD = 8  # runs read ahead of writing


def join_parquet(runs: Sequence[tuple[Path, str, str]], path: Path) -> None:
    """Write runs, each given as (file, name, new name), from files by `write_parquet` to a single file, in order.

    Raises LogError if a file cannot be read or lacks the run.
    """
    files = {file: StoredRuns(file) for file in dict.fromkeys(file for file, *_ in runs)}
    joined = pa.unify_schemas([stored.schema for stored in files.values()])
    about = {new: files[file].metadata(name) for file, name, new in runs}
    joined = joined.with_metadata(file_metadata(joined, about))
    with pa.parquet.ParquetWriter(path, joined, **packing(joined)) as writer, ThreadPoolExecutor(1) as reader:
        left = iter(runs)
        ahead = deque(reader.submit(files[file].table, name, new) for file, name, new in islice(left, _AHEAD))
        while ahead:
            table = ahead.popleft().result()
            ahead.extend(reader.submit(files[file].table, name, new) for file, name, new in islice(left, 1))
            for field in joined:
                if field.name not in table.column_names:
                    table = table.append_column(field, pa.nulls(len(table), field.type))
            table = table.select(joined.names).cast(joined)
            writer.write_table(table, row_group_size=len(table))


class StoredRuns:
    """Access to single runs of a file by `write_parquet`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = pa.parquet.ParquetFile(path, page_checksum_verification=True)
            self._metadata = json.loads(stored_text(self._file.schema_arrow.metadata))["runs"]
        except (pa.ArrowException, OSError, ValueError, RecursionError, KeyError, TypeError) as error:
            raise LogError(f"{path}: {first_line(error)}") from error
        if self._file.num_row_groups != len(self._metadata):
            raise LogError(f"{path}: its runs have no row groups of their own")
        self._group = {name: k for k, name in enumerate(self._metadata)}
        self.schema = self._file.schema_arrow.remove_metadata()

    def metadata(self, name: str) -> dict[str, Any]:
        """The metadata of a run."""
        if name not in self._metadata:
            raise LogError(f"{self._path}: it has no run {name!r}")
        return dict(self._metadata[name])

    def table(self, name: str, new: str) -> pa.Table:
        """The rows of a run under a new name."""
        try:
            table = self._file.read_row_group(self._group[name]).replace_schema_metadata(None)
            return table if new == name else table.set_column(0, "run", pa.array([new] * len(table)))
        except (pa.ArrowException, OSError) as error:
            raise LogError(f"{self._path}: run {name!r}: {first_line(error)}") from error
