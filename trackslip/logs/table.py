"""Conversion between RunLogs and tables.

A table contains any number of runs, distinguished by the column `run`. A real robot's log needs
only the columns REQUIRED, and either x and y or phi; steady samples without traces need
SAMPLE_COLUMNS.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError, first_line, require_whole
from trackslip.files import FORMAT, reason, require_known_format
from trackslip.kinematics import Array
from trackslip.localization.scan import Cluster, Plate, Scan
from trackslip.logs.runlog import RunLog, ScanLog
from trackslip.logs.schema import with_units

REQUIRED = ("t", "omega_l", "omega_r")
"""Required columns of a robot log, besides x and y, phi or all three. A log without the column
`run` is one run.
"""
SAMPLE_COLUMNS = ("omega_l", "omega_r", "v", "w")
LATERAL = "lateral"  # optional column of steady samples: speed to the left [m/s]
BLOCKS: dict[str, tuple[str, ...]] = {  # columns for each field of a RunLog
    "command": ("omega_cmd_l", "omega_cmd_r"),
    "twist_command": ("v_cmd", "w_cmd"),
    "icr": ("icr_offset", "icr_radius_error"),
    "load": ("load_along", "load_left"),
    "gyro": ("gyro",),
    "omega": ("omega_l", "omega_r"),
    "pose": ("x", "y", "phi"),
}
TRUTH: dict[str, tuple[str, ...]] = {  # columns for each field of a Truth
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
"""For each element (3, 3) of a covariance, its index in COVARIANCE."""
CONTACT = "contact"
SHEAR = "shear"
SCANNED = "scanned"  # key of the scanner in a run's metadata
_RANGES, _ALL_RANGES = "ranges", "all_ranges"
_OF_SCANS = ("first_beam", "lost", "hidden_first", "hidden_last")
_MOST_BEAMS = 1_000_000  # most beams of a scanner, a hundred times those of known ones
_METADATA_KEY = b"trackslip"  # key of the run descriptions in a file's metadata


def to_table(logs: Sequence[RunLog]) -> pa.Table:
    """Convert runs to a table with a row per scan, and metadata for columns and runs.

    A column is null in the rows of runs without values for it. Raises LogError if run names repeat.
    """
    names = [log.run for log in logs]
    if len(set(names)) < len(names):
        name = max(names, key=names.count)
        raise LogError(f"run {name!r}: there are {names.count(name)} of it")
    table = with_units(
        pa.concat_tables(map(_table, logs), promote_options="default").combine_chunks()
    )
    runs = {
        log.run: log.metadata | ({SCANNED: _scanner_metadata(log.scans)} if log.scans else {})
        for log in logs
    }
    return table.replace_schema_metadata(file_metadata(runs))


def file_metadata(runs: Mapping[str, Any]) -> dict[bytes, str]:
    """Metadata for a file: its format and the descriptions of its runs."""
    return {_METADATA_KEY: json.dumps({"format": FORMAT, "runs": runs})}


def stored_metadata(
    metadata: Mapping[bytes, bytes] | None, source: str
) -> dict[str, dict[str, Any]]:
    """Descriptions of runs, by name, from a file's metadata; raises LogError for a damaged or newer
    format.
    """
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
    columns |= {name: _list_column(rows) for name, rows in lists.items() if rows is not None}
    return pa.table(columns | (_scan_columns(log.scans) if log.scans else {}))


def _scan_columns(scans: ScanLog) -> dict[str, Any]:
    """Columns for scans, with T rows each; ranges are NaN for beams without a return inside a
    cluster.
    """
    cluster, beam = scans.cluster, scans.beam
    first, last = (ends.astype(int) for ends in cluster.extremes(beam))
    width = np.where(cluster.count > 0, last - first + 1, 0)
    ranges = np.full(width.sum(), np.nan)
    ranges[(width.cumsum() - width - first)[cluster.row] + beam] = cluster.range
    numbers = (first, cluster.lost, *cluster.hidden.T)
    columns = {name: pa.array(values) for name, values in zip(_OF_SCANS, numbers, strict=True)}
    columns[_RANGES] = _lists(ranges, width)
    return columns if scans.full is None else columns | {_ALL_RANGES: _list_column(scans.full)}


def _list_column(rows: Array) -> pa.Array:
    """Convert numbers (T, ...) to a column of T lists."""
    return _lists(rows.ravel(), np.full(len(rows), rows[0].size))


def _lists(values: Array, count: np.ndarray) -> pa.Array:
    """Split values (n,), in order, into T lists of `count` (T,) numbers each."""
    ends = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return pa.ListArray.from_arrays(pa.array(ends), pa.array(values.astype(np.float32)))


def from_list_column(table: pa.Table, name: str, rows: np.ndarray) -> Array | None:
    """Numbers (T, n) from lists of equal length; None if the column is missing, a list is null or
    lengths differ.
    """
    if name not in table.column_names or not pa.types.is_list(table.schema.field(name).type):
        return None
    column = table.column(name).take(rows).combine_chunks()
    if column.null_count or len(np.unique(column.value_lengths())) != 1:
        return None
    return np.asarray(column.flatten(), float).reshape(len(rows), -1)


def _scanner_metadata(scans: ScanLog) -> dict[str, Any]:
    scan = scans.scan
    return {
        "first_bearing": float(scan.bearings[0]),
        "beam_step": scan.beam_step,
        "beams": len(scan.bearings),
        "noise": scan.noise,
        "max_range": scan.max_range if np.isfinite(scan.max_range) else None,
        "dropout": scan.dropout,
        "mount": scan.mount.tolist(),
        "plate": {"length": scans.plate.length, "thickness": scans.plate.thickness},
    }


def scans_from_table(
    table: pa.Table, rows: np.ndarray, metadata: Mapping[str, Any]
) -> ScanLog | None:
    """A run's scans, or None without scans; raises LogError if the columns differ from those that
    `to_table` writes.
    """
    if SCANNED not in metadata or not {*_OF_SCANS, _RANGES} <= set(table.column_names):
        return None
    try:
        return _scans(table, rows, metadata[SCANNED])
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise LogError(f"its scans are not as trackslip writes them ({reason(error)})") from error


def _scans(table: pa.Table, rows: np.ndarray, about: Mapping[str, Any]) -> ScanLog:
    beams, reach = about["beams"], about["max_range"]
    require_whole("beams", beams, 1, _MOST_BEAMS)
    scan = Scan(
        about["first_bearing"] + about["beam_step"] * np.arange(beams),
        np.empty((0, beams)),
        about["noise"],
        np.array(about["mount"], float),
        np.inf if reach is None else reach,
        about["dropout"],
    )
    first, lost, *hidden = (table.column(name).take(rows).to_numpy() for name in _OF_SCANS)
    lists = table.column(_RANGES).take(rows).combine_chunks()
    width, ranges = np.asarray(lists.value_lengths()), np.asarray(lists.flatten(), float)
    row = np.repeat(np.arange(len(width)), width)
    bearing = scan.bearings[
        first[row].astype(int) + np.arange(len(row)) - (width.cumsum() - width)[row]
    ]
    hit = np.isfinite(ranges)
    count = np.bincount(row[hit], minlength=len(width))
    cluster = Cluster(bearing[hit], ranges[hit], count, lost.astype(int), np.stack(hidden, axis=-1))
    full = from_list_column(table, _ALL_RANGES, rows)
    return ScanLog(scan, Plate(**about["plate"]), cluster, full)
