"""Drives prepared for fits: encoder intervals and poses from logs; encoders and poses have their
own clocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.checks import unwrapped
from trackslip.logs.runlog import Refused, RunLog, none_usable
from trackslip.motion.steady import STANDING

BLOCK: Final = 10.0
"""Least duration of a block of driving; slip in different blocks is assumed to be independent
[s].
"""
FEW: Final = 5  # number of rows or windows that may occur by chance
# most encoder intervals in total, to limit memory; surplus intervals are merged
_MAX_ROWS: Final = 200_000


@dataclass(frozen=True)
class PreparedDrive:
    """A drive: encoder intervals and measured poses."""

    name: str
    edges: Array  # (M + 1,) ends of the encoder intervals, by the encoder clock [s]
    omega: Array  # (M, 2) mean sprocket speeds in the intervals [rad/s]
    time: Array  # (K,) times of the poses, by the pose clock [s]
    pose: Array  # (K, 3) measured poses [m, m, rad]; NaN where not measured, heading unwrapped
    interval: float  # usual time between poses [s]
    gyro: Array | None = None  # (T, 3) times by the encoder clock [s] and `RunLog.gyro_sums`
    # commanded sprocket speeds, if constant throughout [rad/s]
    command: tuple[float, ...] | None = None
    # (B, 4) times and poses outside the encoder readings, used to align clocks
    beyond: Array | None = None
    repeated: int = 0  # number of poses left out because they repeat the previous pose
    # number of poses left out because they lie on the line between other poses
    interpolated: int = 0
    held: bool = False  # true if encoders are read less often than they are logged
    whole: bool = False  # true if the logged sprocket speeds are whole numbers, like counts

    @property
    def has_heading(self) -> bool:
        """True if any heading was measured."""
        return bool(np.isfinite(self.pose[:, 2]).any())

    def angles(self, time: Array) -> Array:
        """Angles (2, n) turned by the sprockets from the start to encoder times (n,) [rad]."""
        turned = np.cumsum(self.omega * np.diff(self.edges)[:, None], axis=0)
        return np.stack([np.interp(time, self.edges, np.append(0.0, side)) for side in turned.T])

    def blocks(self, time: Array, least: float = BLOCK) -> np.ndarray:
        """Index (n,) of the block of driving at each pose time (n,); blocks last about `least`
        [s].
        """
        begin, end = self.time[[0, -1]]
        count = max(1, round((end - begin) / least))
        return np.minimum(((time - begin) / max(end - begin, 1e-9) * count).astype(int), count - 1)

    def span(self, length: float) -> float:
        """Duration of windows in the drive [s]: `length`, or longer to hold as many poses as
        `length` does at 2 Hz.
        """
        return length * max(1.0, 2 * self.interval)


def drives_of(logs: Sequence[RunLog]) -> tuple[list[PreparedDrive], list[Refused]]:
    """Prepare the usable drives and list the refused logs; raises LogError if no drive is
    usable.
    """
    drives, refused, names = [], list[Refused](), dict[bytes, str]()
    rows = max(sum(len(log.time) for log in logs), _MAX_ROWS)
    for log in logs:
        try:
            drive = drive_of(log, len(log.time) * _MAX_ROWS // rows)
            if (
                twin := names.setdefault(drive.omega.tobytes() + drive.pose.tobytes(), log.run)
            ) != log.run:
                raise LogError(f"run {log.run!r}: a copy of run {twin!r}")
            drives.append(drive)
        except LogError as error:
            refused.append(Refused.of(log.run, error))
    if not drives:
        raise LogError(none_usable(refused) if refused else "no drives")
    return drives, refused


def drive_of(log: RunLog, max_rows: int = _MAX_ROWS) -> PreparedDrive:
    """Prepare the drive in a log; raises LogError for a robot at rest or too few poses."""
    if not log.is_valid.any() and log.gyro is not None and log.beyond is None:
        log = replace(log, pose=_turned_by(log.gyro, log), valid=None, gyro=None)
    valid = np.flatnonzero(log.is_valid)
    rows = valid[_changing(log, valid)]
    if len(rows) < 2 and (log.beyond is None or len(log.beyond) < 2):
        raise LogError(
            f"run {log.run!r}: {counted(len(rows), 'pose')} while it drives, needs at least 2"
        )
    if not np.abs(log.omega[1:]).max() > STANDING:
        raise LogError(f"run {log.run!r}: the sprockets stand still")
    headed = np.isfinite(log.pose[rows, 2]).any()
    zero = (np.nan_to_num(log.pose[rows]) == 0).all(axis=1)
    _refuse_zeros(log.run, "x, y and phi" if headed else "x and y", zero, "pose was measured")
    time, pose = measured_poses(log.time[rows], log.pose[rows])
    measured = len(time)
    usual = float(
        np.median(np.diff(time if len(time) > 1 or log.beyond is None else log.beyond[:, 0]))
    )
    every = slice(None, None, max(1, int(0.05 / usual + 0.1)))  # paths hardly bend within 0.05 s
    time, pose = time[every], pose[every].copy()
    headed = np.isfinite(pose[:, 2])
    pose[headed, 2] = unwrapped(pose[headed, 2])
    ticks = counts_few_ticks(log.time, log.omega)
    means = interval_means(log.time, log.omega, ticks)
    _refuse_zeros(log.run, "omega_l and omega_r", (means == 0).all(axis=1), "encoder was read")
    edges, omega = merged(log.time, means, max_rows)
    interval = float(np.median(np.diff(time))) if len(time) > 1 else usual
    command = (
        None
        if log.command is None or np.ptp(log.command, axis=0).any()
        else tuple(log.command[0].tolist())
    )
    gyro = None if log.gyro_sums is None else np.column_stack([log.time, log.gyro_sums])
    return PreparedDrive(
        log.run,
        edges,
        omega,
        time,
        pose,
        interval,
        gyro,
        command,
        beyond=log.beyond,
        repeated=len(valid) - len(rows),
        interpolated=len(rows) - measured,
        held=bool((means != log.omega[1:]).any()) and not ticks,
        whole=bool((log.omega == log.omega.round()).all()),
    )


def _turned_by(gyro: Array, log: RunLog) -> Array:
    """Poses (T, 3) with headings from a gyro (T,) [rad/s] and NaN positions; the bias comes from
    sprocket turns.
    """
    columns = np.column_stack([log.omega @ [-1, 1], np.ones(len(log.time))])
    read = np.isfinite(gyro)
    fit = np.linalg.lstsq(columns[read], gyro[read])[0]
    rate = np.where(read, gyro - fit[1], columns[:, 0] * fit[0])
    heading = np.append(0.0, np.cumsum(rate[1:] * np.diff(log.time)))
    return np.column_stack([np.full((len(heading), 2), np.nan), heading])


def _refuse_zeros(run: str, columns: str, zero: np.ndarray, measured: str) -> None:
    """Refuse columns that repeatedly drop to 0 for a single row; `zero` (n,) is true where the
    columns are 0.
    """
    alone = int(((zero[1:-1] != zero[:-2]) & (zero[1:-1] != zero[2:])).sum())
    if alone > max(FEW, 0.1 * len(zero)):
        raise LogError(
            f"run {run!r}: columns {columns} go to 0 and back {alone:,} times: leave cells empty "
            f"where no {measured}"
        )


def _changing(log: RunLog, rows: np.ndarray) -> np.ndarray:
    """(n,) bool: false for a held pose in `rows` (n,), which equals the previous pose although the
    sprockets turned.

    Poses without positions always count as changing, since headings are constant on a straight.
    """
    turned = np.append(0.0, np.cumsum(np.abs(log.omega[1:]).max(axis=1) * np.diff(log.time)))[rows]
    pose = np.nan_to_num(log.pose[rows])
    same = (np.diff(pose, axis=0) == 0).all(axis=1) & np.isfinite(log.pose[rows[1:], 0])
    return np.append(True, ~(same & (np.diff(turned) > STANDING)))[: len(rows)]


def measured_poses(time: Array, pose: Array) -> tuple[Array, Array]:
    """Drop poses that were interpolated linearly between measured poses: only ends of straight
    stretches are kept.

    If a stretch ends between two rows, the measured pose is where the lines through both stretches
    meet.
    """
    finite = np.nan_to_num(pose)
    first, last = _straight_stretches(time, finite, _resolution(finite))
    inside = last - first > 1
    if (last - first)[inside].sum() < max(10, 0.5 * len(time)):
        return time, pose
    time, pose = time.copy(), pose.copy()
    rate = (finite[last] - finite[first]) / np.maximum(time[last] - time[first], 1e-300)[:, None]
    for k in np.flatnonzero(inside[:-1] & inside[1:]):
        end, begin, bend = last[k], first[k + 1], rate[k] - rate[k + 1]
        step = finite[begin] - finite[end] - rate[k + 1] * (time[begin] - time[end])
        later = np.clip(step @ bend / max(bend @ bend, 1e-300), 0.0, time[begin] - time[end])
        time[end] += later
        pose[end] += rate[k] * later
    rows = np.unique(np.concatenate([first[:1], last, first[1:][~(inside[:-1] & inside[1:])]]))
    return time[rows], pose[rows]


def _straight_stretches(
    time: Array, pose: Array, resolution: Array
) -> tuple[np.ndarray, np.ndarray]:
    """First and last rows of the longest stretches of poses (n, 3) that lie on a line to within
    `resolution` (3,).

    A stretch continues as long as some line from its first pose passes through all later poses (J.
    O'Rourke, *An on-line algorithm for fitting straight lines between data ranges*, 1981).
    """
    firsts, begin, bounds = [0], 0, [(-np.inf, np.inf)] * 3
    times, poses, spans = time.tolist(), pose.tolist(), resolution.tolist()
    for row in range(1, len(times)):
        step = times[row] - times[begin]
        changes = zip(bounds, poses[row], poses[begin], spans, strict=True)
        narrower = [
            (max(low, (now - then - span) / step), min(high, (now - then + span) / step))
            for (low, high), now, then, span in changes
        ]
        if any(low > high for low, high in narrower):
            firsts.append(row)
            begin, narrower = row, [(-np.inf, np.inf)] * 3
        bounds = narrower
    begins = np.array(firsts)
    return begins, np.append(begins[1:], len(times)) - 1


def _resolution(pose: Array) -> Array:
    """Unit (3,) to which each column of poses (n, 3) was rounded, between 1e-2 and 1e-6."""
    # headings may be rounded before or after unwrapping
    columns = np.column_stack([pose, wrap_angle(pose[:, 2])])
    places = 10.0 ** -np.arange(2, 7)
    rounded = [
        (np.abs(columns - place * np.round(columns / place)) < 1e-8).all(axis=0) for place in places
    ]
    x, y, *phi = places[np.where(np.any(rounded, axis=0), np.argmax(rounded, axis=0), -1)]
    return np.array([x, y, max(phi)])


def interval_means(time: Array, omega: Array, ticks: bool | None = None) -> Array:
    """Mean sprocket speeds (T - 1, 2) between rows at `time` (T,), from the logged speeds (T, 2).

    A row has the mean speed since the previous row. But many robots log each encoder reading
    several times: such a reading counts once, in the middle of the rows that repeat it, and speeds
    change linearly between readings. For encoders with few ticks, the angle changes linearly from
    tick to tick.
    """
    ticks = counts_few_ticks(time, omega) if ticks is None else ticks
    means_of_side = _between_ticks if ticks else _between_readings
    return np.column_stack([means_of_side(time, side) for side in omega.T])


def _between_ticks(time: Array, omega: Array) -> Array:
    """Mean speeds (T - 1,) of a sprocket, as if each tick came in the middle of the interval that
    counts the tick.
    """
    step = np.diff(time)
    angle = np.concatenate([[0.0], np.cumsum(omega[1:] * step)])
    ticked = np.flatnonzero(omega[1:])
    middle, half = (time[ticked] + time[ticked + 1]) / 2, (angle[ticked] + angle[ticked + 1]) / 2
    ends = (
        np.concatenate([time[:1], middle, time[-1:]]),
        np.concatenate([angle[:1], half, angle[-1:]]),
    )
    return np.diff(np.interp(time, *ends)) / step


def _between_readings(time: Array, omega: Array) -> Array:
    """Mean speeds (T - 1,) of a sprocket whose readings may each be logged several times."""
    read = np.flatnonzero(np.diff(omega, prepend=np.nan) != 0)  # first rows of readings
    turning = np.abs(omega[read[:-1]]) > STANDING
    if turning.sum() < 4:
        return omega[1:]
    rows, usual = np.median(np.diff(read)[turning]), float(np.median(np.diff(time[read])[turning]))
    if rows < 1.5 or usual > 0.5:  # a new reading in every row, or a long-held command
        return omega[1:]
    begin = time[np.maximum(read - 1, 0)]
    end = np.append(begin[1:], time[-1])
    inside = np.minimum(end - begin, usual) / 2  # a longer-lasting value was read several times
    knots = np.column_stack([begin + inside, end - inside]).ravel()
    at_rows = np.interp(time, knots, np.repeat(omega[read], 2))
    return np.asarray(at_rows[1:] + at_rows[:-1]) / 2


def counts_few_ticks(time: Array, omega: Array) -> bool:
    """True if nearly all speeds (T, 2) of a sprocket are small multiples of a fixed speed, or a
    fixed angle per row.
    """
    for size in (np.abs(side * by) for side in omega[1:].T for by in (np.diff(time), 1.0)):
        turning = np.sort(size[size > 1e-9])
        if len(turning):
            # in units of the smallest, except for outliers
            ticks = size / turning[len(turning) // 500]
            near = np.round(ticks)
            exact = np.abs(ticks - near) < 0.02
            if (
                exact.mean() > 0.97
                and near[exact].max() <= 40
                and (np.diff(near) != 0).mean() > 0.05
            ):
                return True
    return False


def merged(time: Array, omega: Array, most: int) -> tuple[Array, Array]:
    """Merge the intervals between `time` (T,) into at most `most`; returns their ends (M + 1,) and
    means (M, 2).
    """
    stride = -(-len(omega) // max(most, 1))
    if stride == 1:
        return time, omega
    ends = np.unique(np.append(np.arange(0, len(time), stride), len(time) - 1))
    turned = np.add.reduceat(omega * np.diff(time)[:, None], ends[:-1])
    return time[ends], turned / np.diff(time[ends])[:, None]


@dataclass(frozen=True)
class Drives:
    """Drives in succession on a common time axis: encoder intervals, with pauses between drives,
    and poses.
    """

    drives: tuple[PreparedDrive, ...]
    edges: Array  # (M + 1,) ends of the encoder intervals, pauses included [s]
    omega: Array  # (M, 2) mean sprocket speeds in the intervals [rad/s], 0 in pauses
    begins: np.ndarray  # (D,) first interval of each drive
    # (G, 3) `PreparedDrive.gyro` of drives with a gyro; sums continue across drives
    gyro: Array | None
    time: Array  # (K,) times of the poses [s]
    place: np.ndarray  # (K,) measured positions, x + i y [m]; 0 where not measured
    heading: Array  # (K,) measured headings [rad]; 0 where not measured
    known: np.ndarray  # (2, K) bool: whether positions and headings were measured
    first: np.ndarray  # (D + 1,) index of each drive's first pose, and K

    @classmethod
    def of(cls, drives: Sequence[PreparedDrive]) -> Drives:
        """Join drives in succession."""
        # with a pause
        length = np.array([drive.edges[-1] - drive.edges[0] + 5.0 for drive in drives])
        shifts = np.cumsum(length) - length - [drive.edges[0] for drive in drives]
        shifted, gyros = [*zip(drives, shifts.tolist(), strict=True)], list[Array]()
        for drive, later in shifted:
            if drive.gyro is not None:
                gyros.append(
                    drive.gyro + np.append(later, gyros[-1][-1, 1:] if gyros else (0.0, 0.0))
                )
        pose = np.concatenate([drive.pose for drive in drives])
        return cls(
            tuple(drives),
            edges=np.concatenate([drive.edges + later for drive, later in shifted]),
            omega=np.concatenate(
                [np.append(drive.omega, np.zeros((1, 2)), axis=0) for drive in drives]
            )[:-1],
            begins=np.cumsum([0, *(len(drive.edges) for drive in drives[:-1])]),
            gyro=np.concatenate(gyros) if gyros else None,
            time=np.concatenate([drive.time + later for drive, later in shifted]),
            place=np.nan_to_num(pose[:, 0]) + 1j * np.nan_to_num(pose[:, 1]),
            heading=np.nan_to_num(pose[:, 2]),
            known=np.isfinite(pose[:, [0, 2]]).T,
            first=np.cumsum([0, *(len(drive.time) for drive in drives)]),
        )

    def intervals(self, time: Array) -> np.ndarray:
        """Index (K,) of the encoder interval in each pose's drive that contains `time` (K,), or is
        nearest to it.
        """
        last = np.append(self.begins[1:] - 2, len(self.omega) - 1)
        row = np.searchsorted(self.edges, time, side="right") - 1
        return np.clip(row, self.begins[self.drive], last[self.drive])

    @cached_property
    def drive(self) -> np.ndarray:
        """Index (K,) of the drive that contains each pose."""
        return np.repeat(np.arange(len(self.drives)), np.diff(self.first))

    @cached_property
    def headings(self) -> Array:
        """Headings (K,), measured or interpolated [rad]; NaN in drives with fewer than two measured
        headings.
        """
        headings = np.full(len(self.time), np.nan)
        for begin, end in pairwise(self.first):
            rows = begin + np.flatnonzero(self.known[1, begin:end])
            if len(rows) > 1:
                headings[begin:end] = np.interp(
                    self.time[begin:end], self.time[rows], self.heading[rows]
                )
        return headings

    def way(self, radius: float) -> Array:
        """Mean distance (K,) driven by the belts up to each pose [m], for a sprocket radius [m]."""
        turned = np.append(0.0, np.cumsum(np.abs(self.omega).mean(axis=1) * np.diff(self.edges)))
        return radius * np.interp(self.time, self.edges, turned)

    def blocks(self, length: float) -> np.ndarray:
        """Index (K,) of each pose's block of driving; blocks are no shorter than windows of
        `length` [s].

        A drive with a single block shares the previous drive's last block if both have the same
        constant command.
        """
        blocks, count, before = [], 0, None
        for drive in self.drives:
            block = drive.blocks(drive.time, max(BLOCK, drive.span(length)))
            if block[-1] == 0 and drive.command is not None and drive.command == before:
                count -= 1
            blocks.append(count + block)
            count, before = int(blocks[-1][-1]) + 1, drive.command
        return np.concatenate(blocks)
