"""Files of runs, Parquet and CSV, and joining the runs of several Parquet files without loading all of them."""

from __future__ import annotations

import csv
import json
import warnings
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from trackslip.errors import LogError, LogWarning, first_line
from trackslip.files import regular_file
from trackslip.logs.csv_file import read_csv
from trackslip.logs.file_format import known_manifest
from trackslip.logs.runlog import RunLog
from trackslip.logs.table import file_metadata, stored_text, to_table
from trackslip.logs.table_reader import ReadRuns, runs_from_table

RUNS = "runs.parquet"
"""Name of the file of runs in a folder of results."""
_MOST_VALUES, _VALUES_PER_BYTE = 20_000_000, 8  # of a Parquet file; measured numbers take 4 bytes and more
_AHEAD = 8  # runs read ahead of writing


def write_parquet(logs: Sequence[RunLog], file: Path | BinaryIO) -> None:
    """Write runs to a Parquet file, one row group per run, in order."""
    table = to_table(logs)
    with pa.parquet.ParquetWriter(file, table.schema, **packing(table.schema)) as writer:
        first = 0
        for log in logs:
            writer.write_table(table.slice(first, len(log.time)), row_group_size=len(log.time))
            first += len(log.time)


def packing(schema: pa.Schema) -> dict[str, Any]:
    """Options of the Parquet writer: compact storage of measured numbers, which rarely repeat, with checksums.

    Zstandard would save another tenth but take half as long again. Statistics let readers skip runs and times.
    """
    return {
        "compression": "lz4",
        "use_dictionary": ["run"],
        "use_byte_stream_split": [field.name for field in schema if pa.types.is_float64(field.type)],
        "write_statistics": ["run", "t"],
        "write_page_checksum": True,
    }


def write_csv(logs: Sequence[RunLog], path: Path) -> None:
    """Write runs to a CSV file, without metadata, ranges and contacts; other numbers are exact."""
    plain = [replace(log, scans=None, truth=log.truth and replace(log.truth, contact=None, shear=None)) for log in logs]
    pa.csv.write_csv(to_table(plain), path)


def read_table(path: Path) -> pa.Table:
    """The table in a `.parquet` or `.csv` file; raises LogError if it cannot be read."""
    try:
        table = None
        regular_file(path)
        if path.suffix.lower() == ".parquet":
            _require_moderate(path)
            table = pa.parquet.read_table(path, page_checksum_verification=True)
        elif path.suffix.lower() == ".csv":
            table = read_csv(path)
        if table is not None and table.column_names is not None:  # names that are not text
            return table
    except FileNotFoundError as error:
        raise LogError(f"{path}: no such file") from error
    except (pa.ArrowException, OSError, csv.Error, UnicodeError) as error:
        if isinstance(error, OSError) and error.strerror:
            raise LogError(f"{path}: {error.strerror}") from error
        reason = first_line(error).split("': ")[-1]  # pyarrow may repeat the name of the file
        if path.suffix.lower() == ".parquet":
            reason = f"damaged, cut short or no Parquet file ({reason})"
        raise LogError(f"{path}: {reason}") from error
    raise LogError(f"{path}: must end in .parquet or .csv")


def _require_moderate(path: Path) -> None:
    """Raise LogError for a file with more values than a log of its size has: a small one can fill any memory."""
    with pa.parquet.ParquetFile(path) as file:
        groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
    values = sum(group.column(k).num_values for group in groups for k in range(group.num_columns))
    if values > (most := _MOST_VALUES + _VALUES_PER_BYTE * path.stat().st_size):
        raise LogError(f"{path}: holds {values:,} values, must be at most {most:,} in a file of this size")


def runs_file(path: Path) -> Path:
    """The file of runs in a folder of results, or `path` itself; LogError if the folder has none, or is too new."""
    try:
        if not path.is_dir():
            return path
        if not (path / RUNS).is_file():
            raise LogError(f"{path}: there is no {RUNS} in this folder")
        known_manifest(path)
    except OSError as error:
        raise LogError(f"path = {str(path)[:80]!r}: {error.strerror}") from error
    return path / RUNS


def read_runs(path: Path) -> list[RunLog]:
    """The runs in a file, with a LogWarning for what is left out; raises LogError if no run can be read."""
    read = read_log(path)
    for line in read.warnings:
        warnings.warn(f"{path}: {line}", LogWarning, stacklevel=3)
    return list(read.runs)


def read_log(path: Path) -> ReadRuns:
    """The runs in a file, and what was left out of it; raises LogError if no run can be read."""
    return runs_from_table(read_table(path), str(path))


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
            self._file = pa.parquet.ParquetFile(regular_file(path), page_checksum_verification=True)
            self._metadata = json.loads(stored_text(self._file.schema_arrow.metadata))["runs"]
        except (pa.ArrowException, OSError, ValueError, RecursionError, KeyError, TypeError) as error:
            raise LogError(f"{path}: {first_line(error)}") from error
        names, types = self._file.schema_arrow.names, self._file.schema_arrow.types
        is_named = names[:1] == ["run"] and pa.types.is_string(types[0]) and isinstance(self._metadata, dict)
        if not is_named or len({*names}) < len(names):
            raise LogError(f"{path}: not as trackslip writes runs")
        self._groups = self._groups_of_runs()
        self.schema = self._file.schema_arrow.remove_metadata()

    def _groups_of_runs(self) -> dict[str, list[int]]:
        """The row groups with rows of each run: one of its own, or several, shared with others, for runs in parts."""
        groups: dict[str, list[int]] = {name: [] for name in self._metadata}
        names = sorted(groups)
        for k in range(self._file.num_row_groups):
            between = self._file.metadata.row_group(k).column(0).statistics
            if between is None or not between.has_min_max:
                raise LogError(f"{self._path}: it doesn't say where its runs are")
            for name in names[bisect_left(names, between.min) : bisect_right(names, between.max)]:
                groups[name].append(k)
        missing = next((name for name, own in groups.items() if not own), None)
        if missing is not None:
            raise LogError(f"{self._path}: run {missing!r} has no rows")
        return groups

    def metadata(self, name: str) -> dict[str, Any]:
        """The metadata of a run."""
        if name not in self._metadata:
            raise LogError(f"{self._path}: it has no run {name!r}")
        return dict(self._metadata[name])

    def log(self, name: str) -> RunLog:
        """A run; raises LogError if it cannot be read."""
        about = file_metadata(self.schema, {name: self.metadata(name)})
        (log,) = runs_from_table(self.table(name, name).replace_schema_metadata(about), str(self._path)).runs
        return log

    def table(self, name: str, new: str) -> pa.Table:
        """The rows of a run under a new name."""
        import pyarrow.compute as pc  # takes longer to import than pyarrow itself

        try:
            table = self._file.read_row_groups(self._groups[name]).replace_schema_metadata(None)
            if pc.count_distinct(table.column(0)).as_py() > 1:
                table = table.filter(pc.equal(table.column(0), name))
            return table if new == name else table.set_column(0, "run", pa.repeat(new, len(table)))
        except (pa.ArrowException, OSError) as error:
            raise LogError(f"{self._path}: run {name!r}: {first_line(error)}") from error
