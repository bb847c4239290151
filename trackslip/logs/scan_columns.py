"""The scans of a RunLog as columns of its table, with a description of the scanner in the metadata."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError
from trackslip.files import reason
from trackslip.kinematics import Array
from trackslip.localization.scan import Cluster, Plate, Scan
from trackslip.logs.scanlog import ScanLog

SCANNED = "scanned"
"""Key of the scanner in the metadata of a run."""
_RANGES = "ranges"
_FULL = "all_ranges"
_NUMBERS = ("first_beam", "lost", "hidden_first", "hidden_last")


def scan_columns(scans: ScanLog) -> dict[str, Any]:
    """The columns, with T rows each."""
    numbers = (scans.first_beam(), scans.cluster.lost, *scans.cluster.hidden.T)
    columns = {name: pa.array(values) for name, values in zip(_NUMBERS, numbers, strict=True)}
    columns[_RANGES] = _lists(*scans.ranges())
    return columns if scans.full is None else columns | {_FULL: list_column(scans.full)}


def list_column(rows: Array) -> pa.Array:
    """Convert numbers (T, ...) to a column of T lists."""
    return _lists(rows.ravel(), np.full(len(rows), rows[0].size))


def _lists(values: Array, count: np.ndarray) -> pa.Array:
    """Lists of `count` (T,) numbers each, of all values (n,) in order."""
    ends = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return pa.ListArray.from_arrays(pa.array(ends), pa.array(values.astype(np.float32)))


def from_list_column(table: pa.Table, name: str, rows: np.ndarray) -> Array | None:
    """Numbers (T, n) from lists of equal length, or None if a row is empty or the column is missing."""
    if name not in table.column_names or not pa.types.is_list(table.schema.field(name).type):
        return None
    column = table.column(name).take(rows).combine_chunks()
    if column.null_count or len(np.unique(column.value_lengths())) != 1:
        return None
    return np.asarray(column.flatten(), float).reshape(len(rows), -1)


def scanner_metadata(scans: ScanLog) -> dict[str, Any]:
    """Everything but the ranges, JSON-compatible."""
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


def scans_from_table(table: pa.Table, rows: np.ndarray, metadata: Mapping[str, Any]) -> ScanLog | None:
    """The scans of a run, or None if it has none; raises LogError if they are not as `scan_columns` writes them."""
    if SCANNED not in metadata or not {*_NUMBERS, _RANGES} <= set(table.column_names):
        return None
    try:
        return _scans(table, rows, metadata[SCANNED])
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise LogError(f"its scans are not as trackslip writes them ({reason(error)})") from error


def _scans(table: pa.Table, rows: np.ndarray, about: Mapping[str, Any]) -> ScanLog:
    beams, reach = about["beams"], about["max_range"]
    scan = Scan(
        about["first_bearing"] + about["beam_step"] * np.arange(beams),
        np.empty((0, beams)),
        about["noise"],
        np.array(about["mount"], float),
        np.inf if reach is None else reach,
        about["dropout"],
    )
    first, lost, *hidden = (table.column(name).take(rows).to_numpy() for name in _NUMBERS)
    lists = table.column(_RANGES).take(rows).combine_chunks()
    width = np.asarray(lists.value_lengths())
    column = np.arange(width.max(initial=1))
    ranges = np.full((len(width), len(column)), np.nan)
    ranges[column < width[:, None]] = lists.flatten()
    hit = np.isfinite(ranges)
    bearing = scan.bearings[np.minimum(first[:, None].astype(int) + column, beams - 1)]
    hidden_ends = np.stack(hidden, axis=-1)
    cluster = Cluster(bearing, np.where(hit, ranges, 1.0), hit, hit.sum(axis=1), lost.astype(int), hidden_ends)
    full = from_list_column(table, _FULL, rows)
    return ScanLog(scan, Plate(**about["plate"]), cluster, full)
