"""Runs from a table of any origin: rows and runs that cannot be read are left out one by one, each with its reason."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.checks import in_order, plausible_gyro, restarts, unwrapped
from trackslip.logs.columns import Columns
from trackslip.logs.runlog import MAX_YAW_RATE, Refused, RunLog, Truth, none_usable
from trackslip.logs.scan_columns import SCANNED, from_list_column, scans_from_table
from trackslip.logs.table import BLOCKS, CONTACT, COVARIANCE, REQUIRED, SHEAR, TRUTH, UPPER, stored_metadata

_OPTIONAL = ("command", "twist_command", "icr", "load")
_ENCODER, _POSE, _GYRO = BLOCKS["omega"], BLOCKS["pose"], BLOCKS["gyro"]
_GAP = 1.0  # without readings that the next one covers [s]
_QUATERNION = re.compile(r"(^|[._/ ])(q_?|orientation[._/ ]?)(?P<part>[xyzw])$", re.IGNORECASE)
_MOST = 0.5  # share of damaged rows above which a run cannot be read


@dataclass(frozen=True)
class ReadRuns:
    """The runs of a log, and what was left out of it."""

    runs: tuple[RunLog, ...] = ()
    refused: tuple[Refused, ...] = ()
    """Runs that cannot be read."""
    notes: tuple[str, ...] = ()
    """Parts that were left out of the others, one line each."""
    taken: tuple[str, ...] = ()
    """Encoders and poses taken where the log leaves a choice, one line each."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """All that was left out, one line each."""
        return (*self.notes, *map(str, self.refused))


def runs_from_table(table: pa.Table, source: str) -> ReadRuns:
    """The runs in a table; `source` names it in errors.

    Raises LogError if it holds no run that can be read.

    A row without position and heading, or with one that cannot be read, counts as not valid. A row without encoder
    reading gets that of the next row that has one, a mean that covers it. Rows with a damaged reading or time are left
    out.
    """
    return _Reader(table, source).read()


class _Reader:
    """The columns of a table, and what was left out so far."""

    def __init__(self, table: pa.Table, source: str) -> None:
        table = _named(_with_heading(table, source), source)
        columns = Columns(table, source)
        headings_alone = "phi" in table.column_names and not {"x", "y"} & set(table.column_names)
        columns.require(REQUIRED if headings_alone else (*REQUIRED, "x", "y"))
        self._table, self._source, self._columns = table, source, columns
        self._metadata = stored_metadata(table, source)
        self._cells = {name: columns.cells(name) for name in ("t", *_ENCODER, *_POSE, *_GYRO)}
        self._valid = columns.boolean("valid") if "valid" in table.column_names else None
        self._blocks = {field: columns.optional(BLOCKS[field]) for field in _OPTIONAL}
        upper = columns.optional(COVARIANCE)
        self._blocks["covariance"] = None if upper is None else _symmetric(upper)
        self._truth = {field: columns.optional(names) for field, names in TRUTH.items()}
        self._refused: list[Refused] = []
        self._notes: list[str] = []

    def read(self) -> ReadRuns:
        """All runs that can be read."""
        number, names = self._columns.categories("run")
        if not len(number):
            raise LogError(f"{self._source}: no rows")
        order = np.argsort(number, kind="stable")
        runs: list[RunLog] = []
        for name, rows in zip(names, np.split(order, np.cumsum(np.bincount(number))[:-1]), strict=True):
            if not name.strip():
                self._notes.append(f"{_rows(len(rows))} left out: row {rows[0] + 1}, column run: empty")
                continue
            try:
                runs += self._runs(name, rows)
            except LogError as error:
                self._refused.append(Refused.of(name, error))
        if not runs:
            raise LogError(f"{self._source}: {none_usable(self._refused) if self._refused else self._notes[0]}")
        return ReadRuns(tuple(runs), tuple(self._refused), tuple(self._notes))

    def _runs(self, name: str, rows: np.ndarray) -> list[RunLog]:
        """The run in `rows`, or several if its clock restarts; raises LogError if it cannot be read."""
        unread = {column: self._cells[column].damaged for column in _ENCODER}
        unread["t"] = np.isnan(self._cells["t"].values)
        rows = rows[~self._left_out(name, rows, unread, "row")]
        time = self._cells["t"].values[rows]
        starts = restarts(time)
        if not starts.size:
            return [self._run(name, name, rows)]
        first = starts[0]
        back = f"goes back from {time[first - 1]:.12g} s to {time[first]:.12g} s: read as {starts.size + 1} runs"
        self._notes.append(f"run {name!r}: row {rows[first] + 1}, column t: {back}")
        runs = []
        for number, part in enumerate(np.split(rows, starts), start=1):
            called = f"{name}, part {number}"
            try:
                runs.append(self._run(called, name, part))
            except LogError as error:
                self._refused.append(Refused.of(called, error))
        return runs

    def _run(self, called: str, name: str, rows: np.ndarray) -> RunLog:
        """A run of rows under one clock, with the metadata of the run `name`."""
        rows = self._in_order(called, self._joined(rows))
        omega, read = self._encoder(called, rows)
        beyond = self._beyond(rows, read)
        rows = read
        pose, valid = self._poses(called, rows)
        time = self._cells["t"].values[rows]
        headed = valid & np.isfinite(pose[:, 2])
        pose[headed, 2] = unwrapped(pose[headed, 2])
        metadata = self._metadata.get(name, {})
        return RunLog(
            run=called,
            time=time,
            omega=omega,
            pose=pose,
            **_present(self._blocks, rows),
            valid=None if self._valid is None and valid.all() else valid,
            gyro=self._gyro(called, rows, np.where(valid, pose[:, 2], np.nan)),
            truth=self._truth_of(rows),
            scans=scans_from_table(self._table, rows, metadata),
            beyond=beyond,
            metadata={key: value for key, value in metadata.items() if key != SCANNED},
        )

    def _left_out(self, name: str, rows: np.ndarray, unread: Mapping[str, np.ndarray], what: str) -> np.ndarray:
        """Mask (n,) of the rows that are bad in any column, with a note; raises LogError if most of them are."""
        bad = np.any([marks[rows] for marks in unread.values()], axis=0)
        if bad.any():
            row = rows[np.argmax(bad)]
            column = next(column for column, marks in unread.items() if marks[row])
            self._say(name, int(bad.sum()), len(rows), what, self._columns.complaint(column, int(row)))
        return bad

    def _say(self, name: str, count: int, total: int, what: str, reason: str) -> None:
        """Note that rows or poses are left out; raises LogError if these are most of them."""
        if count > _MOST * total:
            raise LogError(f"{reason}; so are {count} of its {total} {what}s" if total > 1 else reason)
        self._notes.append(f"run {name!r}: {count} {what}{'s' if count > 1 else ''} left out: {reason}")

    def _joined(self, rows: np.ndarray) -> np.ndarray:
        """The rows without those that only add to a row before, of the same time: encoders, gyro and pose apart."""
        first = np.append(True, np.diff(self._cells["t"].values[rows]) != 0)[: len(rows)]
        group = np.cumsum(first) - 1
        names = (*_ENCODER, *_POSE, *_GYRO)
        there = {name: np.isfinite(self._cells[name].values[rows]) for name in names}
        twice = np.zeros(len(rows), bool)  # groups with two readings, or a damaged one
        for name in names:
            damaged = self._cells[name].damaged[rows] & ~first
            twice[: group[-1] + 1] |= np.bincount(group, there[name]) > 1 if len(rows) else False
            twice[group[damaged]] = True
        adds = ~first & ~twice[group]
        into = rows[first][group]
        for name in names:
            new = adds & there[name]
            self._cells[name].values[into[new]] = self._cells[name].values[rows[new]]
            if name in _POSE and self._valid is not None:
                self._valid.values[into[new]] = self._valid.values[rows[new]]
        return rows[~adds]

    def _in_order(self, name: str, rows: np.ndarray) -> np.ndarray:
        """The rows whose times ascend."""
        time = self._cells["t"].values[rows]
        kept = in_order(time)
        if len(kept) < len(rows):
            k = int(np.argmax(np.diff(time) <= 0))
            order = f"{time[k + 1]:.12g} is not after {time[k]:.12g}, the time before it"
            self._say(name, len(rows) - len(kept), len(rows), "row", f"row {rows[k + 1] + 1}, column t: {order}")
        return rows[kept]

    def _encoder(self, name: str, rows: np.ndarray) -> tuple[Array, np.ndarray]:
        """Sprocket speeds (n, 2), and the rows (n,) from the first to the last reading; others take the next one.

        Rows up to _GAP before the first reading are covered by it.
        """
        omega = np.stack([self._cells[column].values[rows] for column in _ENCODER], axis=-1)
        read = np.flatnonzero(np.isfinite(omega).all(axis=1))
        if not read.size:
            raise LogError("columns omega_l, omega_r: no row has both")
        time = self._cells["t"].values[rows]
        begin, end = int(np.searchsorted(time, time[read[0]] - _GAP)), int(read[-1]) + 1
        for count, where in ((begin, "before its first"), (len(rows) - end, "after its last")):
            if count:
                self._notes.append(f"run {name!r}: {_rows(count)} {where} encoder reading left out")
        return omega[read[np.searchsorted(read, np.arange(begin, end))]], rows[begin:end]

    def _beyond(self, rows: np.ndarray, read: np.ndarray) -> Array | None:
        """Times and poses (B, 4) of `rows` that aren't `read` with encoders; they tell how clocks differ."""
        others = rows[~np.isin(rows, read)]
        columns = [self._cells[column].values[others] for column in ("t", *_POSE)]
        poses = np.stack(columns, axis=-1)[np.isfinite(columns[1:]).any(axis=0)]
        if not len(poses):
            return None
        headed = np.isfinite(poses[:, 3])
        poses[headed, 3] = unwrapped(poses[headed, 3])
        return poses

    def _poses(self, name: str, rows: np.ndarray) -> tuple[Array, np.ndarray]:
        """Poses (n, 3), and which of them were measured."""
        pose = np.stack([self._cells[column].values[rows] for column in _POSE], axis=-1)
        unread = {column: self._cells[column].damaged for column in _POSE}
        stated = np.ones(len(rows), bool)
        if self._valid is not None and (np.isfinite(self._valid.values) | self._valid.damaged)[rows].any():
            said = self._valid.values == 1
            unread = {column: damaged & said for column, damaged in unread.items()} | {"valid": self._valid.damaged}
            stated = said[rows]
        bad = self._left_out(name, rows, unread, "pose")
        placed = np.isfinite(pose[:, :2]).all(axis=1)
        pose[~placed, :2] = np.nan
        return pose, (placed | np.isfinite(pose[:, 2])) & stated & ~bad

    def _gyro(self, name: str, rows: np.ndarray, heading: Array) -> Array | None:
        """Yaw rates (n,), NaN where not measured, None if nowhere; empty cells take the next reading, as encoders do.

        `heading` (n,) [rad] is NaN where not measured. Raises LogError if it shows that the gyro has another unit.
        """
        cells, time = self._cells["gyro"], self._cells["t"].values[rows]
        wild = {"gyro": cells.damaged | (np.abs(cells.values) > MAX_YAW_RATE)}
        rate = np.where(self._left_out(name, rows, wild, "gyro reading"), np.nan, cells.values[rows])
        read = np.flatnonzero(np.isfinite(rate))
        if not read.size:
            return None
        after = read[np.minimum(np.searchsorted(read, np.arange(len(rows))), len(read) - 1)]
        ahead = time[after] - time
        empty = ~(np.isfinite(cells.values) | cells.nan | cells.damaged)[rows]
        rate = np.where(empty & (ahead >= 0) & (ahead <= _GAP), rate[after], rate)
        plausible, doubt = plausible_gyro(time, rate, heading, name)
        self._notes += [doubt] if doubt else []
        return plausible

    def _truth_of(self, rows: np.ndarray) -> Truth | None:
        parts = _present(self._truth, rows)
        if not {"pose", "twist"} <= set(parts):
            return None
        if "lean" in parts:
            parts["lean"] = parts["lean"][:, 0]
        contact, shear = (from_list_column(self._table, column, rows) for column in (CONTACT, SHEAR))
        return Truth(**parts, contact=None if contact is None else contact.reshape(len(rows), -1, 3), shear=shear)


def _with_heading(table: pa.Table, source: str) -> pa.Table:
    """The table with phi from the columns of a quaternion, if it has these instead; LogError if z or w is missing."""
    if "phi" in table.column_names:
        return table
    parts = dict[str, str]()
    for name in table.column_names:
        match = _QUATERNION.search(name)
        if match and match["part"].lower() in parts:
            return table  # of several things
        if match:
            parts[match["part"].lower()] = name
    if not parts:
        return table
    missing = [part for part in "zw" if part not in parts]
    if missing:
        raise LogError(
            f"{source}: columns {', '.join(parts.values())} are of a quaternion without {' and '.join(missing)}: give "
            "phi, the heading in rad, or all of it"
        )
    columns = Columns(table, source)
    none = np.zeros(len(table))
    x, y, z, w = (columns.cells(parts[part]).values if part in parts else none for part in "xyzw")
    phi = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
    return table.append_column("phi", pa.array(phi, from_pandas=True))


def _named(table: pa.Table, source: str) -> pa.Table:
    """The table with a column `run`: without one, it is one run that is called like its file."""
    if "run" in table.column_names:
        return table
    return table.add_column(0, "run", pa.repeat(Path(source).stem, len(table)))


def _rows(count: int) -> str:
    return f"{count} row{'s' if count > 1 else ''}"


def _present(blocks: Mapping[str, Array | None], rows: np.ndarray) -> dict[str, Any]:
    """Rows of the blocks of columns that the run has: the others are null in its rows."""
    return {
        field: block[rows] for field, block in blocks.items() if block is not None and not np.isnan(block[rows]).all()
    }


def _symmetric(upper: Array) -> Array:
    """Symmetric matrices (T, 3, 3) from their upper triangles (T, 6)."""
    full = np.empty((len(upper), 3, 3))
    full[:, *UPPER] = upper
    full[:, UPPER[1], UPPER[0]] = upper
    return full
