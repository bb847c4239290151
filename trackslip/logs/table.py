"""Conversion between RunLogs and tables.

A table contains any number of runs, distinguished by the column `run`. A real robot's log needs
only the columns REQUIRED, and either x and y or phi; steady samples without traces need
SAMPLE_COLUMNS.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError, first_line, require_whole
from trackslip.files import FORMAT, reason, require_known_format
from trackslip.kinematics import Array
from trackslip.localization.scan import Cluster, Plate, Scan
from trackslip.logs.columns import Columns, Lists
from trackslip.logs.runlog import MALFORMED, RunLog, ScanLog
from trackslip.logs.schema import with_units

REQUIRED: Final = ("t", "omega_l", "omega_r")
"""Required columns of a robot log, besides x and y, phi or all three. A log without the column
`run` is one run.
"""
SAMPLE_COLUMNS: Final = ("omega_l", "omega_r", "v", "w")
LATERAL: Final = "lateral"  # optional column of steady samples: speed to the left [m/s]
BLOCKS: Final[dict[str, tuple[str, ...]]] = {  # columns for each field of a RunLog
    "command": ("omega_cmd_l", "omega_cmd_r"),
    "twist_command": ("v_cmd", "w_cmd"),
    "icr": ("icr_offset", "icr_radius_error"),
    "load": ("load_along", "load_left"),
    "gyro": ("gyro",),
    "omega": ("omega_l", "omega_r"),
    "pose": ("x", "y", "phi"),
}
TRUTH: Final[dict[str, tuple[str, ...]]] = {  # columns for each field of a Truth
    "pose": ("true_x", "true_y", "true_phi"),
    "twist": ("true_v", "true_lateral", "true_w"),
    "traction": ("traction_l", "traction_r"),
    "torque": ("torque_l", "torque_r"),
    "power": ("power_l", "power_r"),
    "saturated": ("saturated_l", "saturated_r"),
    "sinkage": ("sinkage_l", "sinkage_r"),
    "resistance": ("resistance_l", "resistance_r"),
    "lean": ("true_lean",),
}
COVARIANCE: Final = ("var_x", "cov_xy", "cov_xphi", "var_y", "cov_yphi", "var_phi")
SYMMETRIC: Final = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""For each element (3, 3) of a covariance, its index in COVARIANCE."""
CONTACT: Final = "contact"
SHEAR: Final = "shear"
SCANNED: Final = "scanned"  # key of the scanner in a run's metadata
_RANGES: Final = "ranges"
_ALL_RANGES: Final = "all_ranges"
_OF_SCANS: Final = ("first_beam", "lost", "hidden_first", "hidden_last")
_MOST_BEAMS: Final = 1_000_000  # most beams of a scanner, a hundred times those of known ones
_METADATA_KEY: Final = b"trackslip"  # key of the run descriptions in a file's metadata


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


def column_names(log: RunLog) -> list[str]:
    """Names of the columns in the table of a run."""
    names = ["run"]
    for columns, block in _blocks(log).items():
        if block is not None:
            names += columns
    names += [name for name, rows in _lists_of(log).items() if rows is not None]
    if log.scans:
        names += [*_OF_SCANS, _RANGES]
        if log.scans.full is not None:
            names.append(_ALL_RANGES)
    return names


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
    columns = {"run": pa.repeat(log.run, len(log.time))}
    for names, block in _blocks(log).items():
        if block is not None:
            columns |= zip(names, map(pa.array, block.reshape(len(block), -1).T), strict=True)
    for name, rows in _lists_of(log).items():
        if rows is not None:
            columns[name] = _list_column(rows)
    return pa.table(columns | (_scan_columns(log.scans) if log.scans else {}))


def _blocks(log: RunLog) -> dict[tuple[str, ...], Array | None]:
    """The values of a run by the names of their columns, with a row per scan; None where the run
    has none.
    """
    blocks: dict[tuple[str, ...], Array | None] = {("t",): log.time}
    blocks |= {names: getattr(log, field) for field, names in BLOCKS.items()}
    # an empty cell says that the encoders weren't read
    blocks[BLOCKS["omega"]] = np.where(log.is_read[:, None], log.omega, np.nan)
    blocks[COVARIANCE] = None if log.covariance is None else log.covariance[:, *np.triu_indices(3)]
    if log.truth is not None:
        blocks |= {names: getattr(log.truth, field) for field, names in TRUTH.items()}
    blocks["valid",] = log.valid
    return blocks


def _lists_of(log: RunLog) -> dict[str, Array | None]:
    """The lists of a run by the name of their column, one per scan."""
    return {} if log.truth is None else {CONTACT: log.truth.contact, SHEAR: log.truth.shear}


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


@dataclass(frozen=True)
class ScanColumns:
    """The columns for scans in a table."""

    numbers: Array | None  # (T, 4) OF_SCANS; NaN in cells without a number
    ranges: Lists | None
    all_ranges: Lists | None

    @classmethod
    def of(cls, columns: Columns) -> ScanColumns:
        """Read the columns; those that are missing are None."""
        return cls(
            columns.optional(_OF_SCANS, infinite=True),
            columns.lists(_RANGES),
            columns.lists(_ALL_RANGES),
        )

    def scans(self, rows: np.ndarray, metadata: Mapping[str, Any]) -> ScanLog | None:
        """The scans in the `rows` of a run with this `metadata`, or None without scans.

        Raises LogError if the columns or the metadata differ from those that `to_table` writes.
        """
        if SCANNED not in metadata or self.numbers is None or self.ranges is None:
            return None
        try:
            scan, plate = _scanner(metadata[SCANNED])
        except MALFORMED as error:
            raise LogError(
                f"its scanner is not as trackslip writes it ({reason(error)})"
            ) from error
        numbers, hidden = self.numbers[rows, :2], self.numbers[rows, 2:]
        # angles may be hidden without limit
        if not np.isfinite(numbers).all() or np.isnan(hidden).any():
            raise LogError(f"its scans need numbers in {', '.join(_OF_SCANS)}")
        if self.ranges.empty[rows].any():
            raise LogError(f"its scans have empty cells in {_RANGES}")
        ranges, width = self.ranges.take(rows)
        beams = len(scan.bearings)
        if ((numbers < 0) | (numbers > beams)).any() or (numbers[:, 0] + width > beams).any():
            raise LogError(f"its scans have beams beyond the scanner's {beams}")
        first, lost = numbers.astype(int).T
        row = np.repeat(np.arange(len(width)), width)
        beam = first[row] + np.arange(len(row)) - (width.cumsum() - width)[row]
        hit = np.isfinite(ranges)
        count = np.bincount(row[hit], minlength=len(width))
        cluster = Cluster(scan.bearings[beam][hit], ranges[hit], count, lost, hidden)
        full = None if self.all_ranges is None else equal_lists(self.all_ranges, rows)
        return ScanLog(scan, plate, cluster, full)


def equal_lists(column: Lists, rows: np.ndarray) -> Array | None:
    """Numbers (R, n) in the lists in `rows` (R,); None if a list is missing or lengths differ."""
    numbers, lengths = column.take(rows)
    if column.empty[rows].any() or len(np.unique(lengths)) != 1:
        return None
    return numbers.reshape(len(rows), -1)


def _scanner(about: Mapping[str, Any]) -> tuple[Scan, Plate]:
    """The scanner and its plate from a run's metadata."""
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
    return scan, Plate(**about["plate"])
