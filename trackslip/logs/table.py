"""RunLogs and steady samples as tables, and back.

A table contains any number of runs, distinguished by the column `run`. The log of a real robot needs only the columns
REQUIRED; samples of steady driving without a trace need SAMPLE_COLUMNS.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError, first_line
from trackslip.kinematics import Array
from trackslip.logs.columns import Columns
from trackslip.logs.file_format import FORMAT, require_known_format
from trackslip.logs.heading_check import require_headings
from trackslip.logs.runlog import RunLog, Truth
from trackslip.logs.scan_columns import SCANNED, from_list_column, list_column, scan_columns, scans_from_table
from trackslip.logs.schema import COLUMNS, with_units

REQUIRED = ("run", "t", "omega_l", "omega_r", "x", "y")
SAMPLE_COLUMNS = ("omega_l", "omega_r", "v", "w")
_BLOCKS: dict[str, tuple[str, ...]] = {  # columns of fields of a RunLog
    "command": ("omega_cmd_l", "omega_cmd_r"),
    "twist_command": ("v_cmd", "w_cmd"),
    "icr": ("icr_offset", "icr_radius_error"),
    "omega": ("omega_l", "omega_r"),
    "pose": ("x", "y", "phi"),
}
_OPTIONAL = ("command", "twist_command", "icr")
_TRUTH: dict[str, tuple[str, ...]] = {  # columns of fields of its Truth
    "pose": ("true_x", "true_y", "true_phi"),
    "twist": ("true_v", "true_lateral", "true_w"),
    "traction": ("traction_l", "traction_r"),
    "torque": ("torque_l", "torque_r"),
    "power": ("power_l", "power_r"),
    "saturated": ("saturated_l", "saturated_r"),
    "lean": ("true_lean",),
}
_COVARIANCE = ("var_x", "cov_xy", "cov_xphi", "var_y", "cov_yphi", "var_phi")
_UPPER = np.triu_indices(3)
_CONTACT = "contact"
_METADATA_KEY = b"trackslip"  # of the description of runs and columns in the metadata of a file
_CHECKSUM_KEY = b"trackslip_crc32"  # of its checksum: Parquet's own only cover the pages of the columns


def to_table(logs: Sequence[RunLog]) -> pa.Table:
    """Runs as one table with a row per scan, and metadata of columns and runs.

    Columns that a run lacks are null in its rows.
    """
    names = [log.run for log in logs]
    if len(set(names)) < len(names):
        name = max(names, key=names.count)
        raise LogError(f"run {name!r}: there are {names.count(name)} of it")
    table = pa.concat_tables([_run_table(log) for log in logs], promote_options="default")
    fields = with_units(table.schema.remove_metadata())
    runs = {log.run: log.metadata | ({SCANNED: log.scans.metadata()} if log.scans else {}) for log in logs}
    return table.cast(pa.schema(fields, metadata=file_metadata(fields, runs)))


def file_metadata(fields: Iterable[pa.Field], runs: Mapping[str, Any]) -> dict[bytes, str]:
    """Metadata of a file: its runs, and its columns again for readers that ignore the metadata of columns (polars)."""
    columns = {field.name: COLUMNS[field.name].metadata for field in fields if field.name in COLUMNS}
    text = json.dumps({"format": FORMAT, "columns": columns, "runs": runs})
    return {_METADATA_KEY: text, _CHECKSUM_KEY: _checksum(text.encode())}


def stored_text(metadata: Mapping[bytes, bytes]) -> bytes:
    """The JSON under _METADATA_KEY in UTF-8; raises KeyError if there is none, ValueError if its checksum is wrong."""
    text = metadata[_METADATA_KEY]
    expected = metadata.get(_CHECKSUM_KEY)  # older files have none
    if expected not in (None, _checksum(text).encode()):
        raise ValueError("its checksum is wrong")
    return text


def _checksum(text: bytes) -> str:
    return f"{zlib.crc32(text):08x}"


def runs_from_table(table: pa.Table, source: str) -> list[RunLog]:
    """The runs in a table; `source` names it in errors."""
    columns = Columns(table, source)
    columns.require(REQUIRED)
    if pa.types.is_nested(table.schema.field("run").type):
        raise LogError(f"{source}: column run: {table.schema.field('run').type} is not a name")
    try:
        names = table.column("run").cast(pa.string())
    except pa.ArrowException as error:
        raise LogError(f"{source}: column run: {first_line(error)}") from error
    if "" in (listed := ["" if name is None else name for name in names.to_pylist()]):
        raise LogError(f"{source}: row {listed.index('') + 1}, column run: empty")
    encoded = names.combine_chunks().dictionary_encode()
    label, keys = encoded.indices.to_numpy(), encoded.dictionary.to_pylist()
    if not keys:
        raise LogError(f"{source}: no rows")
    metadata = _stored_metadata(table, source)
    time = columns.numbers(("t",))[:, 0]
    omega, pose = columns.gappy(_BLOCKS["omega"]), columns.gappy(_BLOCKS["pose"][:2])
    phi = columns.optional(("phi",))
    pose = np.column_stack([pose, np.full(len(pose), np.nan) if phi is None else phi])
    ok = np.asarray(np.isfinite(pose[:, :2]).all(axis=1))
    stated = columns.boolean("valid", label)
    valid = ok if stated is None else ok & stated
    ok = valid
    rows_of = {key: np.flatnonzero(label == number) for number, key in enumerate(keys)}
    for key, rows in rows_of.items():
        backwards = np.flatnonzero(np.diff(time[rows]) <= 0)
        if backwards.size:
            before, row = rows[backwards[0]], rows[backwards[0] + 1]
            raise LogError(
                f"{source}: row {row + 1}, column t: {time[row]:g} is not after {time[before]:g}, "
                f"the time before it in run {key!r}"
            )
    blocks = {field: columns.optional(_BLOCKS[field]) for field in _OPTIONAL}
    upper = columns.optional(_COVARIANCE)
    blocks["covariance"] = None if upper is None else _symmetric(upper)
    truth = {field: columns.optional(names) for field, names in _TRUTH.items()}
    logs = []
    for key, rows in rows_of.items():
        with_encoder = np.flatnonzero(np.isfinite(omega[rows]).all(axis=1))
        covering = np.searchsorted(with_encoder, np.arange(len(rows)))  # the next row that has a reading
        rows = rows[: with_encoder[-1] + 1] if with_encoder.size else rows[:0]
        omega[rows] = omega[rows[with_encoder[covering[: len(rows)]]]]
        measured = rows[ok[rows] & np.isfinite(pose[rows, 2])]
        try:
            require_headings(time[measured], pose[measured], key)
            logs.append(
                RunLog(
                    run=key,
                    time=time[rows],
                    omega=omega[rows],
                    pose=_unwrapped(pose[rows]),
                    **_present(blocks, rows),
                    valid=None if stated is None and valid[rows].all() else valid[rows],
                    truth=_truth(_present(truth, rows), from_list_column(table, _CONTACT, rows)),
                    scans=scans_from_table(table, rows, metadata.get(key, {})),
                    metadata={k: value for k, value in metadata.get(key, {}).items() if k != SCANNED},
                )
            )
        except LogError as error:
            raise LogError(f"{source}: {error}") from error
    return logs


def read_columns(table: pa.Table, names: Sequence[str], source: str) -> Array:
    """Columns of numbers (T, len(names)); raises LogError naming the row and column that cannot be read."""
    columns = Columns(table, source)
    columns.require(names)
    values = columns.numbers(names)
    if not len(values):
        raise LogError(f"{source}: no rows")
    return values


def _run_table(log: RunLog) -> pa.Table:
    columns: dict[str, Any] = {"run": pa.array([log.run] * len(log.time)), "t": log.time}
    blocks = [(names, getattr(log, field)) for field, names in _BLOCKS.items()]
    if log.covariance is not None:
        blocks.append((_COVARIANCE, log.covariance[:, *_UPPER]))
    if log.truth is not None:
        blocks += [(names, getattr(log.truth, field)) for field, names in _TRUTH.items()]
    for names, block in blocks:
        if block is not None:
            parts = block.reshape(len(block), -1).T
            columns |= {name: np.ascontiguousarray(part) for name, part in zip(names, parts, strict=True)}
    if log.valid is not None:
        columns["valid"] = log.valid
    if log.truth is not None and log.truth.contact is not None:
        columns[_CONTACT] = list_column(log.truth.contact)
    if log.scans is not None:
        columns |= scan_columns(log.scans)
    return pa.table(columns)


def _unwrapped(pose: Array) -> Array:
    """Poses (T, 3) with unwrapped headings."""
    known = np.isfinite(pose[:, 2])
    pose[known, 2] = np.unwrap(pose[known, 2])
    return pose


def _present(blocks: Mapping[str, Array | None], rows: np.ndarray) -> dict[str, Any]:
    """Rows of the blocks of columns that the run has: the others are null in its rows."""
    return {
        field: block[rows] for field, block in blocks.items() if block is not None and not np.isnan(block[rows]).all()
    }


def _truth(parts: dict[str, Any], contact: Array | None) -> Truth | None:
    if not {"pose", "twist"} <= set(parts):
        return None
    if "lean" in parts:
        parts["lean"] = parts["lean"][:, 0]
    pads = None if contact is None or contact.shape[1] % 3 else contact.reshape(len(contact), -1, 3)
    return Truth(**parts, contact=pads)


def _symmetric(upper: Array) -> Array:
    """Symmetric matrices (T, 3, 3) from their upper triangles (T, 6)."""
    full = np.empty((len(upper), 3, 3))
    full[:, *_UPPER] = upper
    full[:, _UPPER[1], _UPPER[0]] = upper
    return full


def _stored_metadata(table: pa.Table, source: str) -> dict[str, dict[str, Any]]:
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
