"""RunLogs and steady samples as tables, and back.

A table contains any number of runs, distinguished by the column `run`. The log of a real robot needs only the columns
REQUIRED, and x and y or phi; samples of steady driving without a trace need SAMPLE_COLUMNS.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError, first_line
from trackslip.kinematics import Array
from trackslip.logs.file_format import FORMAT, require_known_format
from trackslip.logs.runlog import RunLog
from trackslip.logs.scan_columns import SCANNED, list_column, scan_columns, scanner_metadata
from trackslip.logs.schema import with_units

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
SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Places of the elements of a covariance among COVARIANCE."""
CONTACT = "contact"
SHEAR = "shear"
_METADATA_KEY = b"trackslip"  # of the description of runs and columns in the metadata of a file


def to_table(logs: Sequence[RunLog]) -> pa.Table:
    """Runs as one table with a row per scan, and metadata of columns and runs.

    Columns that a run lacks are null in its rows.
    """
    names = [log.run for log in logs]
    if len(set(names)) < len(names):
        name = max(names, key=names.count)
        raise LogError(f"run {name!r}: there are {names.count(name)} of it")
    table = with_units(pa.concat_tables(map(_table, logs), promote_options="default").combine_chunks())
    runs = {log.run: log.metadata | ({SCANNED: scanner_metadata(log.scans)} if log.scans else {}) for log in logs}
    return table.replace_schema_metadata(file_metadata(table.schema, runs))


def file_metadata(fields: Sequence[pa.Field], runs: Mapping[str, Any]) -> dict[bytes, str]:
    """Metadata of a file: its runs, and its columns again for readers that ignore the metadata of columns (polars)."""
    columns = {
        field.name: {key.decode(): value.decode() for key, value in field.metadata.items()}
        for field in fields
        if field.metadata
    }
    return {_METADATA_KEY: json.dumps({"format": FORMAT, "columns": columns, "runs": runs})}


def stored_metadata(metadata: Mapping[bytes, bytes] | None, source: str) -> dict[str, dict[str, Any]]:
    """Descriptions of the runs by name in the metadata of a file; LogError if damaged or in a newer format."""
    text = (metadata or {}).get(_METADATA_KEY)
    if not text:
        return {}
    try:
        content = json.loads(text)
        require_known_format(content, source)
        return {name: {**description} for name, description in content["runs"].items()}
    except LogError:
        raise
    except (ValueError, RecursionError, KeyError, TypeError, AttributeError) as error:
        raise LogError(f"{source}: its metadata is damaged ({first_line(error)})") from error


def _table(log: RunLog) -> pa.Table:
    """A run without metadata."""
    blocks: dict[tuple[str, ...], Array | None] = {("t",): log.time}
    blocks |= {names: getattr(log, field) for field, names in BLOCKS.items()}
    blocks[COVARIANCE] = None if log.covariance is None else log.covariance[:, *np.triu_indices(3)]
    lists: dict[str, Array | None] = {}
    if log.truth is not None:
        blocks |= {names: getattr(log.truth, field) for field, names in TRUTH.items()}
        lists = {CONTACT: log.truth.contact, SHEAR: log.truth.shear}
    blocks["valid",] = log.valid
    columns = {"run": pa.repeat(log.run, len(log.time))}
    for names, block in blocks.items():
        if block is not None:
            columns |= zip(names, map(pa.array, block.reshape(len(block), -1).T), strict=True)
    columns |= {name: list_column(rows) for name, rows in lists.items() if rows is not None}
    return pa.table(columns | (scan_columns(log.scans) if log.scans else {}))
