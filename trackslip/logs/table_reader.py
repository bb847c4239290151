"""Runs from a table of any origin: unreadable rows and runs are left out, each with a reason."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError, counted, require
from trackslip.kinematics import Array
from trackslip.logs.angles import (
    COUNTERS,
    EncoderKind,
    continuous,
    encoder_kind,
    mean_speeds,
    odometry_angles,
    odometry_jump,
    odometry_speeds,
    unwrapped_angle,
)
from trackslip.logs.changes import are_changes
from trackslip.logs.checks import gaps, in_order, restarts, unwrapped_headings
from trackslip.logs.columns import Columns
from trackslip.logs.layout import AS_DOCUMENTED, Layout, known_odometry, known_ticks
from trackslip.logs.recognition import suggested_columns
from trackslip.logs.repeats import angle_readings, speed_readings
from trackslip.logs.runlog import MAX_YAW_RATE, Refused, RunLog, Truth, none_usable
from trackslip.logs.size import require_runs_fit
from trackslip.logs.table import (
    BLOCKS,
    CONTACT,
    COVARIANCE,
    SCANNED,
    SHEAR,
    SYMMETRIC,
    TRUTH,
    ScanColumns,
    equal_lists,
    stored_metadata,
)

_OPTIONAL: Final = ("command", "twist_command", "icr", "load")
_NAMES: Final = ("t", *BLOCKS["pose"], *BLOCKS["gyro"], "valid")
"""Names of the first columns of a reader's values; the columns of the encoders follow."""
_TIME: Final = 0
_POSE: Final = [1, 2, 3]
_GYRO: Final = 4
_VALID: Final = 5
_GAP: Final = 1.0  # longest time without readings that the next reading may fill [s]
_QUATERNION: Final = re.compile(
    r"(^|[._/ ])(q_?|orientation[._/ ]?)(?P<part>[xyzw])$", re.IGNORECASE
)
# share of rows before the row above them: with a clock that restarts, 1 % at most
_MIXED: Final = 0.1
_MOST: Final = 0.5  # share of damaged rows above which a run is refused


@dataclass(frozen=True)
class ReadRuns:
    """The runs in a log, and notes on the parts left out."""

    runs: tuple[RunLog, ...] = ()
    refused: tuple[Refused, ...] = ()
    """Runs that cannot be read."""
    notes: tuple[str, ...] = ()
    """Parts that were left out of readable runs, one line each."""
    taken: tuple[str, ...] = ()
    """The chosen encoders and poses if the log offers several, one line each."""

    def __iter__(self) -> Iterator[RunLog]:
        return iter(self.runs)

    @property
    def warnings(self) -> tuple[str, ...]:
        """A line for each part and for each run that was left out."""
        return (*self.notes, *map(str, self.refused))


def runs_from_table(
    table: pa.Table,
    source: str,
    max_memory: int | None = None,
    layout: Layout = AS_DOCUMENTED,
) -> ReadRuns:
    """Read the runs in a table, which errors call `source`; raises LogError if no run can be read,
    or if reading takes more than `max_memory` [bytes].

    A pose is not valid if position and heading are both empty or either is unreadable. A row
    without an encoder reading gets the next reading, which is a mean over that row, too. Rows with
    a damaged reading or time are left out.
    """
    return RunsInTables([table], source, max_memory, layout).read()


class RunsInTables:
    """The runs in successive parts of a table, each with all rows of its runs.

    An iteration reads a part at a time, as `runs_from_table` does, so that only one part is in
    memory. It raises LogError at its end if no run could be read, and if the runs take more than
    `max_memory` [bytes]. `warnings` are complete after the iteration.
    """

    taken: tuple[str, ...] = ()  # as in ReadRuns: a table offers no choice

    def __init__(
        self,
        tables: Iterable[pa.Table],
        source: str,
        max_memory: int | None = None,
        layout: Layout = AS_DOCUMENTED,
    ) -> None:
        self._tables = tables
        self._source = source
        self._max_memory = max_memory
        self._layout = layout
        self._refused: list[Refused] = []
        self._notes: list[str] = []

    def __iter__(self) -> Iterator[RunLog]:
        rows = 0
        found = False
        metadata: dict[str, dict[str, Any]] | None = None
        for table in self._tables:
            if metadata is None:  # the same in all parts
                metadata = stored_metadata(table.schema.metadata, self._source)
            reader = _Reader(table, self._source, metadata, rows, self._layout)
            for run in reader.runs(self._max_memory):
                found = True
                yield run
            self._refused += reader.refused
            self._notes += reader.notes
            rows += len(table)
        if not rows:
            raise LogError(f"{self._source}: no rows")
        if not found:
            reason = none_usable(self._refused) if self._refused else self._notes[0]
            raise LogError(f"{self._source}: {reason}")

    @property
    def warnings(self) -> tuple[str, ...]:
        """A line for each part and for each run that was left out."""
        return (*self._notes, *map(str, self._refused))

    def read(self) -> ReadRuns:
        """All readable runs, in memory."""
        return ReadRuns(tuple(self), tuple(self._refused), tuple(self._notes))


class _Reader:
    """Reader of a table's columns that collects notes on the runs and parts left out.

    Errors count rows from `first_row`, the number of rows in earlier parts of the table.
    """

    def __init__(
        self,
        table: pa.Table,
        source: str,
        metadata: Mapping[str, Mapping[str, Any]],
        first_row: int = 0,
        layout: Layout = AS_DOCUMENTED,
    ) -> None:
        table = _with_heading(layout.applied(table, source), source)
        columns = Columns(table, source, first_row)
        self._kind = _required_columns(table, columns, source)
        require_fitting(layout, self._kind, source)
        self._table = table
        self._source = source
        self._layout = layout
        self._columns = columns
        self._metadata = metadata
        self._first_row = first_row

        # (T, n), ordered as names; NaN where not read
        self._names = (*_NAMES, *self._kind.value)
        self._encoders = list(range(len(_NAMES), len(self._names)))
        self._values = np.empty((len(table), len(self._names)))
        self._damaged = np.empty((len(table), len(self._names)), bool)
        for k, name in enumerate(self._names):
            cells = columns.boolean(name) if k == _VALID else columns.cells(name)
            self._values[:, k] = cells.values
            self._damaged[:, k] = cells.damaged
            if k == _GYRO:
                self._gyro_empty = cells.empty
        self._damaged[:, _GYRO] |= np.abs(self._values[:, _GYRO]) > MAX_YAW_RATE
        self._values[self._damaged] = np.nan
        self._damaged[:, _TIME] = np.isnan(self._values[:, _TIME])

        self._blocks = {field: columns.optional(BLOCKS[field]) for field in _OPTIONAL}
        upper = columns.optional(COVARIANCE)
        self._blocks["covariance"] = None if upper is None else upper[:, SYMMETRIC]
        self._truth = {field: columns.optional(names) for field, names in TRUTH.items()}
        self._contact = columns.lists(CONTACT)
        self._shear = columns.lists(SHEAR)
        self._scans = ScanColumns.of(columns)
        self.refused: list[Refused] = []
        self.notes: list[str] = []

    def runs(self, max_memory: int | None) -> Iterator[RunLog]:
        """All readable runs, in the order of their first rows; raises LogError if they take more
        than `max_memory` [bytes].
        """
        for name, rows in self._rows_by_run(max_memory):
            if name.strip():
                yield from self._runs(name, rows)
            else:
                reason = f"row {self._place(rows[0])}, column run: empty"
                self.notes.append(f"{counted(len(rows), 'row')} left out: {reason}")

    def _rows_by_run(self, max_memory: int | None) -> list[tuple[str, np.ndarray]]:
        """The name and the rows (n,) of each run."""
        if "run" not in self._table.column_names:
            every = np.arange(len(self._table))
            return [(Path(self._source).stem, every)] if len(every) else []
        number, names = self._columns.categories("run")
        require_runs_fit(self._source, self._table, number, max_memory)
        order = np.argsort(number, kind="stable")
        ends = np.cumsum(np.bincount(number, minlength=len(names))).tolist()
        return [
            (name, order[first:end])
            for name, first, end in zip(names, [0, *ends], ends, strict=False)
        ]

    def _place(self, row: int) -> int:
        """The number of a row in messages, counted from 1 in the whole table."""
        return int(self._first_row + row + 1)

    def _runs(self, name: str, rows: np.ndarray) -> list[RunLog]:
        """The readable runs in `rows`: a single run, or several if its clock restarts."""
        runs = list[RunLog]()
        try:
            sections = self._cut_at_restarts(name, rows)
        except LogError as error:
            self.refused.append(Refused.of(name, error))
            return []
        for number, section in enumerate(sections, start=1):
            part = f"{name}, part {number}" if len(sections) > 1 else name
            runs += self._drives(part, section, self._metadata.get(name, {}))
        return runs

    def _cut_at_restarts(self, name: str, rows: np.ndarray) -> list[np.ndarray]:
        """The rows of a run without those that are damaged, cut where its clock restarts, or sorted
        if they just aren't in the order of time.
        """
        rows = rows[
            ~self._left_out(name, rows, self._damaged[rows], [*self._encoders, _TIME], "row")
        ]
        time = self._values[rows, _TIME]
        starts = restarts(time)
        if not starts.size:
            return [rows]
        sections = np.split(rows, starts)
        is_by_sensor = np.mean([self._has_both(section) for section in sections]) < _MOST
        is_mixed = np.mean(np.diff(time) < 0) > _MIXED
        if is_by_sensor or is_mixed:
            self.notes.append(f"run {name!r}: rows are not in the order of t, and are sorted")
            return [rows[np.argsort(time, kind="stable")]]
        k = starts[0]
        back = f"goes back from {time[k - 1]:.12g} s to {time[k]:.12g} s"
        self.notes.append(
            f"run {name!r}: row {self._place(rows[k])}, column t: {back}: read as "
            f"{len(sections)} runs"
        )
        return sections

    def _drives(self, name: str, rows: np.ndarray, metadata: Mapping[str, Any]) -> list[RunLog]:
        """The readable runs in `rows` whose clock doesn't restart: several if it has gaps."""
        runs = list[RunLog]()
        try:
            sections = self._cut_at_gaps(name, rows)
        except LogError as error:
            self.refused.append(Refused.of(name, error))
            return []
        for number, section in enumerate(sections, start=1):
            part = f"{name}, part {number}" if len(sections) > 1 else name
            try:
                runs.append(self._run(part, section, metadata))
            except LogError as error:
                self.refused.append(Refused.of(part, error))
        return runs

    def _cut_at_gaps(self, name: str, rows: np.ndarray) -> list[np.ndarray]:
        """The rows of a run in the order of time, cut where its encoders have a gap."""
        rows = self._in_order(name, self._joined(self._by_time(rows)))
        time = self._values[rows, _TIME]
        starts = gaps(time, name)
        read = np.flatnonzero(np.isfinite(self._values[rows[:, None], self._encoders]).all(axis=1))
        # before and after the encoder readings, poses may have a clock of their own
        ends = read[[0, -1]] if read.size else (0, 0)
        starts = starts[(starts > ends[0]) & (starts <= ends[1])]
        if not starts.size:
            return [rows]
        k = starts[0]
        ahead = f"goes on from {time[k - 1]:.12g} s to {time[k]:.12g} s"
        self.notes.append(
            f"run {name!r}: row {self._place(rows[k])}, column t: {ahead}: cut into "
            f"{starts.size + 1} runs there"
        )
        return np.split(rows, starts)

    def _has_both(self, rows: np.ndarray) -> bool:
        """True if the rows contain both encoder readings and poses, like a drive, not readings of a
        single sensor.
        """
        read = np.isfinite(self._values[rows])
        encoders = read[:, self._encoders].all(axis=1).sum()
        poses = read[:, [*_POSE, _GYRO]].any(axis=1).sum()
        return bool(min(encoders, poses) > 1)

    def _run(self, name: str, rows: np.ndarray, metadata: Mapping[str, Any]) -> RunLog:
        omega, covered, is_read = self._encoder(name, rows)
        is_beyond = np.zeros(len(self._values), bool)
        is_beyond[rows] = True
        is_beyond[covered] = False
        beyond = self._beyond(rows[is_beyond[rows]])
        rows = covered
        pose, valid = self._poses(name, rows)
        headed = valid & np.isfinite(pose[:, 2])
        pose[headed, 2] = unwrapped_headings(pose[headed, 2])
        all_valid = valid.all() and "valid" not in self._table.column_names
        return RunLog(
            run=name,
            time=self._values[rows, _TIME],
            omega=omega,
            pose=pose,
            **_present(self._blocks, rows),
            valid=None if all_valid else valid,
            read=None if is_read.all() else is_read,
            gyro=self._gyro(name, rows),
            truth=self._truth_of(rows),
            scans=self._scans.scans(rows, metadata),
            beyond=beyond,
            metadata=self._about(metadata),
        )

    def _about(self, metadata: Mapping[str, Any]) -> dict[str, Any]:
        """The run's description, and the odometry if that replaces encoders."""
        about = {key: value for key, value in metadata.items() if key != SCANNED}
        if self._kind.is_odometry:
            about["odometry"] = f"columns {', '.join(self._kind.value)}"
        return about

    def _left_out(
        self, name: str, rows: np.ndarray, damaged: np.ndarray, columns: list[int], what: str
    ) -> np.ndarray:
        """Mask (n,) of rows `damaged` (n, k) in any of `columns`, with a note; raises LogError if
        most rows are bad.
        """
        bad = np.asarray(damaged[:, columns].any(axis=1))
        if bad.any():
            total = int((bad | np.isfinite(self._values[rows][:, columns]).any(axis=1)).sum())
            k = int(np.argmax(bad))
            column = next(column for column in columns if damaged[k, column])
            self._note(
                name,
                int(bad.sum()),
                total,
                what,
                self._columns.complaint(self._names[column], int(rows[k])),
            )
        return bad

    def _note(self, name: str, count: int, total: int, what: str, reason: str) -> None:
        """Note that `count` rows or poses are left out; raises LogError if these are most of the
        `total`.
        """
        if count > _MOST * total:
            raise LogError(
                f"{reason}; so are {count} of its {total} {what}s" if total > 1 else reason
            )
        self.notes.append(f"run {name!r}: {counted(count, what)} left out: {reason}")

    def _by_time(self, rows: np.ndarray) -> np.ndarray:
        """Sort rows by time, as poses may be logged late; rows that break their own sensor's order
        stay in place.
        """
        time = self._values[rows, _TIME]
        if (np.diff(time) > 0).all():
            return rows
        readings = [*_POSE, _GYRO, *self._encoders]
        known = np.isfinite(self._values[rows[:, None], readings])
        place = time.copy()
        for sensor in np.unique(known, axis=0):
            of_sensor = np.flatnonzero((known == sensor).all(axis=1))
            ascending = in_order(time[of_sensor])
            before = np.searchsorted(ascending, np.arange(len(of_sensor)), side="right") - 1
            place[of_sensor] = time[of_sensor[ascending]][np.maximum(before, 0)]
        return rows[np.argsort(place, kind="stable")]

    def _joined(self, rows: np.ndarray) -> np.ndarray:
        """Merge rows of equal time, unless a column has different readings at that time.

        Encoders, gyro and pose may be logged in separate rows.
        """
        first = np.append(True, np.diff(self._values[rows, _TIME]) != 0)[: len(rows)]
        if first.all():
            return rows
        starts = np.flatnonzero(first)
        group = np.cumsum(first) - 1
        values = self._values[rows]
        damaged = self._damaged[rows].any(axis=1)
        # `valid` means nothing without a pose
        values[np.isnan(values[:, _POSE]).all(axis=1), _VALID] = np.nan
        low = np.fmin.reduceat(values, starts)
        high = np.fmax.reduceat(values, starts)
        agree = ((low == high) | np.isnan(high)).all(axis=1)
        joins = agree & ~np.logical_or.reduceat(damaged, starts)
        self._values[rows[starts[joins]]] = high[joins]
        return rows[first | ~joins[group]]

    def _in_order(self, name: str, rows: np.ndarray) -> np.ndarray:
        """Select rows with ascending times; notes the rows left out."""
        time = self._values[rows, _TIME]
        ascending = in_order(time)
        if len(ascending) < len(rows):
            k = int(np.argmax(np.diff(time) <= 0))
            order = f"{time[k + 1]:.12g} is not after {time[k]:.12g}, the time before it"
            reason = f"row {self._place(rows[k + 1])}, column t: {order}"
            self._note(name, len(rows) - len(ascending), len(rows), "row", reason)
        return rows[ascending]

    def _encoder(self, name: str, rows: np.ndarray) -> tuple[Array, np.ndarray, np.ndarray]:
        """Sprocket speeds (n, 2), the rows (n,) from the first encoder reading to the last, and a
        mask (n,) of those with a reading.

        A row without a reading gets the next reading. Speeds are means since the reading before,
        so that rows up to _GAP before the first of them are covered, too.
        """
        time = self._values[rows, _TIME]
        readings = self._values[rows[:, None], self._encoders]
        if self._kind.is_cumulative:
            read, speeds = self._speeds_between(name, rows, time, readings)
            begin = int(read[0])
        else:
            read = np.flatnonzero(np.isfinite(readings).all(axis=1))
            if not read.size:
                raise self._no_row_has_both()
            speeds = readings[read]
            if self._kind is EncoderKind.ODOMETRY_TWISTS:
                speeds = odometry_speeds(
                    speeds, known_odometry(self._layout, f"columns {', '.join(self._kind.value)}")
                )
            once = speed_readings(time[read], speeds)
            if once is not None:
                self._note_repeats(name, len(read), len(once))
                read = read[once]
                speeds = speeds[once]
            begin = int(np.searchsorted(time, time[read[0]] - _GAP))
        end = int(read[-1]) + 1
        for count, where in ((begin, "before its first"), (len(rows) - end, "after its last")):
            if count:
                self.notes.append(
                    f"run {name!r}: {counted(count, 'row')} {where} encoder reading left out"
                )
        covered = np.arange(begin, end)
        next_reading = np.searchsorted(read, covered)
        return speeds[next_reading], rows[covered], np.isin(covered, read)

    def _note_repeats(self, name: str, rows: int, readings: int) -> None:
        """Note that so many rows repeat so many encoder readings."""
        self.notes.append(
            f"run {name!r}: each encoder reading is repeated in {rows / readings:.2g} rows: it "
            "counts once, as the motion since the reading before"
        )

    def _speeds_between(
        self, name: str, rows: np.ndarray, time: Array, readings: Array
    ) -> tuple[np.ndarray, Array]:
        """The rows (n,), counted in `rows`, with readings of angles or positions, and the mean
        speeds (n, 2) since the reading before.
        """
        if self._kind is EncoderKind.ODOMETRY_POSES:
            read = np.flatnonzero(np.isfinite(readings).all(axis=1))
            if len(read) < 2:
                raise self._no_row_has_both()
            once = angle_readings(time[read], readings[read])
            if once is not None:
                self._note_repeats(name, len(read), len(once))
                read = read[once]
            jump = odometry_jump(time[read], readings[read])
            if jump is not None:
                row, distance = jump
                raise LogError(
                    f"row {self._place(rows[read[row]])}, columns odom_x, odom_y: jump by "
                    f"{distance:.3g} m: was the odometry reset? Cut the log there"
                )
            geometry = known_odometry(self._layout, f"columns {', '.join(self._kind.value)}")
            return read, mean_speeds(time[read], odometry_angles(readings[read], geometry))

        # sides may be read at different times: the side that is read more often sets the times
        known = np.isfinite(readings)
        if (known.sum(axis=0) < 2).any():
            raise self._no_row_has_both()
        self._refuse_changes(readings, known)
        known = self._without_repeats(name, time, readings, known)
        begin = max(int(np.argmax(side)) for side in known.T)
        end = min(len(side) - int(np.argmax(side[::-1])) for side in known.T)
        often = known[:, int(np.argmax(known.sum(axis=0)))]
        read = begin + np.flatnonzero(often[begin:end])
        if len(read) < 2:
            raise self._no_row_has_both()
        angles = []
        for side, column in enumerate(self._kind.value):
            of_side = np.flatnonzero(known[:, side])
            angle = self._angle(column, rows[of_side], time[of_side], readings[of_side, side])
            angles.append(np.interp(time[read], time[of_side], angle))
        return read, mean_speeds(time[read], np.stack(angles, axis=-1))

    def _refuse_changes(self, readings: Array, known: np.ndarray) -> None:
        """Raise LogError if both sides of the readings (n, 2), where `known`, are changes since the
        reading before.
        """
        sides = [readings[known[:, side], side] for side in range(2)]
        if not all(map(are_changes, sides)):
            return
        least = min(float(side.min()) for side in sides)
        largest = max(float(side.max()) for side in sides)
        raise LogError(
            f"columns {', '.join(self._kind.value)}: look like changes since the last reading, "
            f"from {least:g} to {largest:g}: give their running sums"
        )

    def _without_repeats(
        self, name: str, time: Array, readings: Array, known: np.ndarray
    ) -> np.ndarray:
        """The mask `known` (n, 2) of readings of both sides, without rows that repeat them."""
        known = known.copy()
        rows = int(known.any(axis=1).sum())
        for side in range(2):
            own = np.flatnonzero(known[:, side])
            once = angle_readings(time[own], readings[own, side][:, None])
            if once is not None:
                known[own, side] = False
                known[own[once], side] = True
        read = int(known.any(axis=1).sum())
        if read < rows:
            self._note_repeats(name, rows, read)
        return known

    def _angle(self, column: str, rows: np.ndarray, time: Array, readings: Array) -> Array:
        """Continuous angles (n,) of a sprocket [rad] from its readings; raises LogError if the
        counter restarts.
        """
        if self._kind is EncoderKind.TICKS:
            per_turn = known_ticks(self._layout)
            counts, restart = continuous(time, readings, (per_turn, *COUNTERS))
            angle = 2 * np.pi / per_turn * counts
        else:
            angle = unwrapped_angle(readings)
            counts, restart = continuous(time, 1e3 * angle, ())  # in steps of a milliradian
            angle = 1e-3 * counts
        if restart is not None:
            before, after = readings[restart - 1 : restart + 1]
            raise LogError(
                f"row {self._place(rows[restart])}, column {column}: jumps from {before:.9g} to "
                f"{after:.9g}, and by no number of ticks at which it wraps: did the counter "
                "restart? Cut the log there"
            )
        return angle

    def _no_row_has_both(self) -> LogError:
        """The error for a run without a reading of all columns of the encoders."""
        names = self._kind.value
        all_of = "both" if len(names) == 2 else f"all {len(names)}"
        needed = "fewer than 2 rows have" if self._kind.is_cumulative else "no row has"
        return LogError(f"columns {', '.join(names)}: {needed} {all_of}")

    def _beyond(self, rows: np.ndarray) -> Array | None:
        """Times and poses (B, 4) in rows outside the encoder readings, used to align clocks; None
        without poses.
        """
        poses = self._values[rows[:, None], [_TIME, *_POSE]]
        poses = poses[np.isfinite(poses[:, 1:]).any(axis=1)]
        headed = np.isfinite(poses[:, 3])
        poses[headed, 3] = unwrapped_headings(poses[headed, 3])
        return poses if len(poses) else None

    def _poses(self, name: str, rows: np.ndarray) -> tuple[Array, np.ndarray]:
        """Poses (n, 3), and a mask (n,) of measured poses."""
        pose = self._values[rows[:, None], _POSE]
        stated = self._values[rows, _VALID]
        damaged = self._damaged[rows]
        measured = np.ones(len(rows), bool)
        if (np.isfinite(stated) | damaged[:, _VALID]).any():
            measured = stated == 1
            # a pose marked as not valid may contain anything
            damaged[:, _POSE] &= measured[:, None]
        bad = self._left_out(name, rows, damaged, [*_POSE, _VALID], "pose")
        pose[np.isnan(pose[:, :2]).any(axis=1), :2] = np.nan
        return pose, np.asarray(measured & ~bad & np.isfinite(pose).any(axis=1))

    def _gyro(self, name: str, rows: np.ndarray) -> Array | None:
        """Yaw rates (n,), NaN where not measured; None without readings. Empty cells get the next
        reading.
        """
        time = self._values[rows, _TIME]
        rate = self._values[rows, _GYRO]
        self._left_out(name, rows, self._damaged[rows], [_GYRO], "gyro reading")
        read = np.flatnonzero(np.isfinite(rate))
        if not read.size:
            return None
        after = read[np.minimum(np.searchsorted(read, np.arange(len(rows))), len(read) - 1)]
        ahead = time[after] - time
        covered = np.isnan(rate) & self._gyro_empty[rows] & (ahead >= 0) & (ahead <= _GAP)
        return np.where(covered, rate[after], rate)

    def _truth_of(self, rows: np.ndarray) -> Truth | None:
        parts = _present(self._truth, rows)
        if not {"pose", "twist"} <= set(parts):
            return None
        if "lean" in parts:
            parts["lean"] = parts["lean"][:, 0]
        contact = None if self._contact is None else equal_lists(self._contact, rows)
        shear = None if self._shear is None else equal_lists(self._shear, rows)
        return Truth(
            **parts,
            contact=None if contact is None else contact.reshape(len(rows), -1, 3),
            shear=shear,
        )


def _required_columns(table: pa.Table, columns: Columns, source: str) -> EncoderKind:
    """The kind of readings of the encoders; raises LogError, if possible with the option that
    reads the table, unless it has time, encoders and poses.
    """
    given = set(table.column_names)
    try:
        kind = encoder_kind(given)
    except LogError as error:
        raise LogError(f"{source}: {error}") from error
    encoders = (kind or EncoderKind.SPEEDS).value
    turns_alone = bool(given & {"phi", "gyro"}) and not given & {"x", "y"}
    needed = ("t", *encoders) if turns_alone else ("t", *encoders, "x", "y")
    try:
        columns.require(needed)
    except LogError as error:
        option = suggested_columns(table.column_names, columns.any_numbers)
        raise LogError(f"{error}; {option} reads it" if option else str(error)) from error
    return kind or EncoderKind.SPEEDS


def require_fitting(layout: Layout, kind: EncoderKind, source: str) -> None:
    """Raise InvalidValueError for what a layout lacks to read encoders of a `kind`, and for what
    it states in vain.
    """
    if kind is EncoderKind.TICKS:
        known_ticks(layout)
    else:
        require(
            layout.ticks_per_turn is None,
            "ticks_per_turn",
            layout.ticks_per_turn,
            f"left out: {source} has no columns ticks_l, ticks_r",
        )
    if kind.is_odometry:
        known_odometry(layout, f"columns {', '.join(kind.value)}")
    else:
        require(
            layout.odometry is None,
            "odometry",
            layout.odometry,
            f"left out: {source} has no columns of odometry that replaces encoders",
        )


def _with_heading(table: pa.Table, source: str) -> pa.Table:
    """Add phi to a table that has the columns of a quaternion instead; raises LogError if z or w is
    missing.
    """
    matches = [match for name in table.column_names if (match := _QUATERNION.search(name))]
    parts = {match["part"].lower(): match.string for match in matches}
    # last case: several quaternions
    if "phi" in table.column_names or not parts or len(parts) < len(matches):
        return table
    missing = [part for part in "zw" if part not in parts]
    if missing:
        raise LogError(
            f"{source}: columns {', '.join(parts.values())} are of a quaternion without "
            f"{' and '.join(missing)}: give "
            "phi, the heading in rad, or all of it"
        )
    columns = Columns(table, source)
    x, y, z, w = (columns.cells(parts[part]).values if part in parts else 0.0 for part in "xyzw")
    phi = np.arctan2(2 * (w * z + x * y), w**2 + x**2 - y**2 - z**2)  # for any norm
    return table.append_column("phi", pa.array(phi, from_pandas=True))


def _present(blocks: Mapping[str, Array | None], rows: np.ndarray) -> dict[str, Any]:
    """Select rows of each block of columns; blocks without values in these rows are left out."""
    return {
        field: block[rows]
        for field, block in blocks.items()
        if block is not None and not np.isnan(block[rows]).all()
    }
