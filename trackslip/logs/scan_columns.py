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
    ranges, count = scans.ranges()
    columns = dict(zip(_NUMBERS, map(pa.array, numbers), strict=True)) | {
        _RANGES: _lists(ranges.astype(np.float32), count)
    }
    return columns if scans.full is None else columns | {_FULL: list_column(scans.full)}


def list_column(rows: Array) -> pa.Array:
    """Convert numbers (T, ...) to a column of T lists."""
    return _lists(rows.ravel().astype(np.float32), np.full(len(rows), rows[0].size))


def _lists(values: Array, count: np.ndarray) -> pa.Array:
    """Lists of `count` (T,) numbers each, of all values (n,) in order."""
    ends = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return pa.ListArray.from_arrays(pa.array(ends), pa.array(values))


def from_list_column(table: pa.Table, name: str, rows: np.ndarray) -> Array | None:
    """Numbers (T, n) from lists of equal length, or None if a row is empty or the column is missing."""
    if name not in table.column_names or not pa.types.is_list(table.schema.field(name).type):
        return None
    column = table.column(name).take(rows).combine_chunks()
    lengths = np.diff(column.offsets.to_numpy())
    if column.null_count or len(np.unique(lengths)) != 1:
        return None
    return np.asarray(column.flatten().to_numpy(zero_copy_only=False), float).reshape(len(rows), -1)


def scans_from_table(table: pa.Table, rows: np.ndarray, metadata: Mapping[str, Any]) -> ScanLog | None:
    """The scans of a run, or None if it has none; raises LogError for invalid columns."""
    names = [*_NUMBERS, _RANGES]
    if SCANNED not in metadata or not set(names) <= set(table.column_names):
        return None
    part = table.select(names).take(rows)
    for name in names:
        column, kind = part.column(name), part.schema.field(name).type
        fits = pa.types.is_list(kind) if name == _RANGES else pa.types.is_integer(kind) or pa.types.is_floating(kind)
        if column.null_count or not fits:
            raise LogError(f"column {name}: {kind} with {column.null_count} empty")
    first_beam, lost, *hidden = (part.column(name).to_numpy() for name in _NUMBERS)
    scan, plate = _scanner(metadata[SCANNED])
    beams, first = len(scan.bearings), first_beam.astype(int)
    lists = part.column(_RANGES).combine_chunks()
    width = np.asarray(lists.value_lengths())
    if (first < 0).any() or (first + width > beams).any():
        raise LogError(f"its ranges are of other beams than the scanner's {beams}")
    column = np.arange(width.max(initial=1))
    ranges = np.full((len(width), len(column)), np.nan)
    ranges[column < width[:, None]] = lists.flatten()
    hit = np.isfinite(ranges)
    bearing = scan.bearings[np.minimum(first[:, None] + column, beams - 1)]
    cluster = Cluster(
        bearing, np.where(hit, ranges, 1.0), hit, hit.sum(axis=1), lost.astype(int), np.stack(hidden, axis=-1)
    )
    full = from_list_column(table, _FULL, rows)
    if full is not None and full.shape[1] != beams:
        raise LogError(f"column {_FULL}: {full.shape[1]} ranges, where the scanner has {beams} beams")
    return ScanLog(scan, plate, cluster, full)


def _scanner(metadata: Mapping[str, Any]) -> tuple[Scan, Plate]:
    """Scanner, without ranges, and plate, from `ScanLog.metadata`."""
    try:
        beams, reach = metadata["beams"], metadata["max_range"]
        scan = Scan(
            metadata["first_bearing"] + metadata["beam_step"] * np.arange(beams),
            np.empty((0, beams)),
            metadata["noise"],
            np.array(metadata["mount"], float),
            np.inf if reach is None else reach,
            metadata["dropout"],
        )
        return scan, Plate(**metadata["plate"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise LogError(f"invalid description of its scanner ({reason(error)})") from error
