"""RunLogs and steady samples as tables, and back.

A table contains any number of runs, distinguished by the column `run`. The log of a real robot needs only the columns
REQUIRED, and x and y or phi; samples of steady driving without a trace need SAMPLE_COLUMNS.
"""

from __future__ import annotations

import itertools
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError, first_line
from trackslip.kinematics import Array
from trackslip.logs.columns import Columns
from trackslip.logs.file_format import FORMAT, require_known_format
from trackslip.logs.runlog import RunLog
from trackslip.logs.scan_columns import SCANNED, list_column, scan_columns
from trackslip.logs.schema import COLUMNS, with_units

REQUIRED = ("t", "omega_l", "omega_r")
"""Columns of any log of a robot; it has x and y, phi or all three, too. Without `run`, it is one run."""
SAMPLE_COLUMNS = ("omega_l", "omega_r", "v", "w")
LATERAL = "lateral"
"""Speed to the left, of samples that have it [m/s]."""
BLOCKS: dict[str, tuple[str, ...]] = {  # columns of fields of a RunLog
    "command": ("omega_cmd_l", "omega_cmd_r"),
    "twist_command": ("v_cmd", "w_cmd"),
    "icr": ("icr_offset", "icr_radius_error"),
    "load": ("load_along", "load_left"),
    "gyro": ("gyro",),
    "omega": ("omega_l", "omega_r"),
    "pose": ("x", "y", "phi"),
}
TRUTH: dict[str, tuple[str, ...]] = {  # columns of fields of its Truth
    "pose": ("true_x", "true_y", "true_phi"),
    "twist": ("true_v", "true_lateral", "true_w"),
    "traction": ("traction_l", "traction_r"),
    "torque": ("torque_l", "torque_r"),
    "power": ("power_l", "power_r"),
    "saturated": ("saturated_l", "saturated_r"),
    "lean": ("true_lean",),
}
COVARIANCE = ("var_x", "cov_xy", "cov_xphi", "var_y", "cov_yphi", "var_phi")
UPPER = np.triu_indices(3)
CONTACT = "contact"
SHEAR = "shear"
_METADATA_KEY = b"trackslip"  # of the description of runs and columns in the metadata of a file
_CHECKSUM_KEY = b"trackslip_crc32"  # of its checksum: Parquet's own only cover the pages of the columns


def to_table(logs: Sequence[RunLog]) -> pa.Table:
    """Runs as one table with a row per scan, and metadata of columns and runs.

    Columns that a run lacks are null in its rows.
    """
    table = to_rows(logs)
    return table.replace_schema_metadata(file_metadata(table.schema, runs_metadata(logs)))


def to_rows(logs: Sequence[RunLog]) -> pa.Table:
    """Runs as one table, without the file's metadata."""
    names = [log.run for log in logs]
    if len(set(names)) < len(names):
        name = max(names, key=names.count)
        raise LogError(f"run {name!r}: there are {names.count(name)} of it")
    alike = itertools.groupby(map(_Content.of, logs), lambda run: run.columns)
    table = pa.concat_tables([_table(list(runs)) for _, runs in alike], promote_options="default")
    return with_units(table)


def runs_metadata(logs: Sequence[RunLog]) -> dict[str, Any]:
    """Metadata of runs by name, with their scanners."""
    return {log.run: log.metadata | ({SCANNED: log.scans.metadata()} if log.scans else {}) for log in logs}


def file_metadata(fields: Sequence[pa.Field], runs: Mapping[str, Any]) -> dict[bytes, str]:
    """Metadata of a file: its runs, and its columns again for readers that ignore the metadata of columns (polars)."""
    known = {field.name: COLUMNS[field.name].metadata for field in fields if field.name in COLUMNS}
    others = {
        field.name: {key.decode(): value.decode() for key, value in field.metadata.items()}
        for field in fields
        if field.name not in COLUMNS and field.metadata
    }
    columns = known | others
    text = json.dumps({"format": FORMAT, "columns": columns, "runs": runs})
    return {_METADATA_KEY: text, _CHECKSUM_KEY: _checksum(text.encode())}


def stored_text(metadata: Mapping[bytes, bytes]) -> bytes:
    """The JSON under _METADATA_KEY in UTF-8; raises KeyError if there is none, ValueError if its checksum is wrong."""
    text = metadata[_METADATA_KEY]
    expected = metadata.get(_CHECKSUM_KEY)  # older files have none
    if expected not in (None, _checksum(text).encode()):
        raise ValueError("its checksum is wrong")
    return text


def stored_metadata(table: pa.Table, source: str) -> dict[str, dict[str, Any]]:
    """Descriptions of the runs in a table by name; raises LogError if they are damaged or in a newer format."""
    about = table.schema.metadata or {}
    if not about.get(_METADATA_KEY):
        return {}
    try:
        content = json.loads(stored_text(about))
        require_known_format(content, source)
        return {name: {**description} for name, description in content["runs"].items()}
    except LogError:
        raise
    except (ValueError, RecursionError, KeyError, TypeError, AttributeError) as error:
        raise LogError(f"{source}: its metadata is damaged ({first_line(error)})") from error


def _checksum(text: bytes) -> str:
    return f"{zlib.crc32(text):08x}"


def read_columns(table: pa.Table, names: Sequence[str], source: str) -> Array:
    """Columns of numbers (T, len(names)); raises LogError naming the row and column that cannot be read."""
    columns = Columns(table, source)
    columns.require(names)
    values = columns.numbers(names)
    if not len(values):
        raise LogError(f"{source}: no rows")
    return values


@dataclass(frozen=True)
class _Content:
    """The columns of one run."""

    name: pa.Array
    """The run's name in every row."""
    numbers: list[tuple[tuple[str, ...], np.ndarray]]
    """Names of columns with a number per row, with what they contain: (T,), (T, number of names) or covariances."""
    others: dict[str, pa.Array]
    """Lists, and the columns of scans."""

    @classmethod
    def of(cls, log: RunLog) -> _Content:
        blocks: list[tuple[tuple[str, ...], np.ndarray | None]] = [(("t",), log.time)]
        blocks += [(names, getattr(log, field)) for field, names in BLOCKS.items()]
        blocks.append((COVARIANCE, log.covariance))
        others = {}
        if log.truth is not None:
            blocks += [(names, getattr(log.truth, field)) for field, names in TRUTH.items()]
            lists = {CONTACT: log.truth.contact, SHEAR: log.truth.shear}
            others = {name: list_column(rows) for name, rows in lists.items() if rows is not None}
        blocks.append((("valid",), log.valid))
        numbers = [(names, block) for names, block in blocks if block is not None]
        if log.scans is not None:
            others |= scan_columns(log.scans)
        return cls(pa.repeat(log.run, len(log.time)), numbers, others)

    @property
    def columns(self) -> list[tuple[Any, Any]]:
        """Names and types."""
        numbers = [(names, block.dtype) for names, block in self.numbers]
        return [*numbers, *((name, column.type) for name, column in self.others.items())]


def _table(runs: Sequence[_Content]) -> pa.Table:
    """Runs with the same columns: each column at once, for there may be thousands of runs."""
    columns = {"run": pa.chunked_array([one.name for one in runs])}
    for blocks in zip(*(one.numbers for one in runs), strict=True):
        names = blocks[0][0]
        block = np.concatenate([block for _, block in blocks])
        block = block[:, *UPPER] if names == COVARIANCE else block.reshape(len(block), -1)
        columns |= {name: pa.array(part) for name, part in zip(names, block.T, strict=True)}
    columns |= {name: pa.chunked_array([one.others[name] for one in runs]) for name in runs[0].others}
    return pa.Table.from_arrays([*columns.values()], names=[*columns])
