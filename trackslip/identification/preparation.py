"""Drives prepared for fits: encoder intervals and poses of one or several logs, each on its own clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.logs.checks import unwrapped
from trackslip.logs.runlog import Refused, RunLog, none_usable

MAX_ROWS = 200_000
"""Encoder intervals that are used in all; more are merged."""
MIN_POSES = 2
"""Of a drive: start and end."""
TOO_OFTEN = 0.05
"""Time between poses below which more tell little more [s]: paths hardly bend in it."""
_HELD_ROWS, _HELD_SECONDS = 1.5, 0.5  # an encoder is read less often than logged if it holds for more rows, less time
_MIN_READINGS = 4
_SMALLEST, _EXACT, _MOSTLY = 0.002, 0.02, 0.97  # ticks of encoders: quantile that is one, tolerance, share within it
_FEW, _OFTEN = 40, 0.05  # few ticks in a row's interval, the share of rows in which their number changes
_SLOWEST = 10.0  # time between rows of any log of a robot that drives [s]
_STANDING = 1e-3  # sprocket speed of a robot at rest [rad/s]
_PAUSE = 1.0  # between drives [s]
_SAME_SLOPE = 1e-3  # relative difference of slopes on both sides of an interpolated pose [-]


@dataclass(frozen=True)
class PreparedDrive:
    """One drive: encoder intervals, and nodes of the trajectory, most of which have a measured pose."""

    name: str
    edges: Array  # (M + 1,) ends of the encoder intervals, encoder clock [s]
    omega: Array  # (M, 2) mean sprocket speeds in the intervals [rad/s]
    time: Array  # (K,) of the poses, pose clock [s]
    pose: Array  # (K, 3) measured [m, m, rad]; NaN where not measured, heading unwrapped
    interval: float  # usual time between poses [s]
    coarse: bool = False  # encoders with few ticks: smoothing helps, as a lag would, though nothing lags
    gyro: Array | None = None  # (T, 3) encoder clock [s], and sums as in RunLog
    command: tuple[float, ...] | None = None  # constant one that it was driven by [rad/s]
    beyond: Array | None = None  # (B, 4) time and pose, measured where no encoder was read: tells how clocks differ
    logged: int = 0
    """Poses in the log, of which these are left out:"""
    repeated: int = 0
    interpolated: int = 0
    held: bool = False
    """Encoders are read less often than logged."""

    @property
    def every_pose(self) -> tuple[Array, Array]:
        """Times (K + B,) and poses of all that was measured, those beyond the encoders included."""
        if self.beyond is None:
            return self.time, self.pose
        time = np.concatenate([self.time, self.beyond[:, 0]])
        order = np.argsort(time, kind="stable")
        return time[order], np.concatenate([self.pose, self.beyond[:, 1:]])[order]

    @property
    def has_heading(self) -> bool:
        """True if any heading was measured."""
        return bool(np.isfinite(self.pose[:, 2]).any())


def drives_of(logs: Sequence[RunLog]) -> tuple[list[PreparedDrive], list[Refused]]:
    """The drives that can be used, and those that cannot be; raises LogError if there is none."""
    drives, refused = [], list[Refused]()
    most = MAX_ROWS // max(len(logs), 1)
    for log in logs:
        try:
            drives.append(drive_of(log, most))
        except LogError as error:
            refused.append(Refused.of(log.run, error))
    if not drives:
        raise LogError(none_usable(refused) if refused else "no drives")
    return drives, refused


def drive_of(log: RunLog, max_rows: int = MAX_ROWS) -> PreparedDrive:
    """A drive prepared; raises LogError if it stands still, has too few poses, or times that can't be seconds."""
    step = float(np.median(np.diff(log.time)))
    if step > _SLOWEST:
        raise LogError(f"run {log.run!r}: t rises by {step:.3g} per row: are these ms or ns? It must be in seconds")
    rows = np.flatnonzero(log.is_valid)
    logged = len(rows)
    if logged > 1:
        rows = rows[_changing(log.pose[rows], _moving(log, rows))]
    if len(rows) < MIN_POSES and (log.beyond is None or len(log.beyond) < MIN_POSES):
        poses = counted(len(rows), "pose")
        raise LogError(f"run {log.run!r}: {poses} while it drives, needs at least {MIN_POSES}")
    if not np.abs(log.omega[1:]).max() > _STANDING:
        raise LogError(f"run {log.run!r}: the sprockets stand still")
    time, pose = log.time[rows], log.pose[rows].copy()
    time, pose = measured_poses(time, pose)
    measured = len(time)
    usual = float(np.median(np.diff(time if len(time) > 1 or log.beyond is None else log.beyond[:, 0])))
    often = int(TOO_OFTEN / usual + 0.1)
    kept = slice(None, None, max(1, often))
    time, pose = time[kept], pose[kept]
    known = np.isfinite(pose[:, 2])
    pose[known, 2] = unwrapped(pose[known, 2])
    coarse = counts_few_ticks(log.time, log.omega)
    means = interval_means(log.time, log.omega, coarse)
    edges, omega = merged(log.time, means, max_rows)
    turned = None if log.gyro_sums is None else np.column_stack([log.time, log.gyro_sums])
    return PreparedDrive(
        log.run,
        edges,
        omega,
        time,
        pose,
        float(np.median(np.diff(time))) if len(time) > 1 else usual,
        coarse,
        turned,
        _constant(log.command),
        log.beyond,
        logged,
        logged - len(rows),
        len(rows) - measured,
        not coarse and bool((means != log.omega[1:]).any()),
    )


def _constant(command: Array | None) -> tuple[float, ...] | None:
    """The command (2,) of a drive, from that in each row (T, 2); None if it changes."""
    if command is None or not len(command) or np.ptp(command, axis=0).max() > 0:
        return None
    return tuple(command[0].tolist())


def measured_poses(time: Array, pose: Array) -> tuple[Array, Array]:
    """The poses that were measured, of which others were interpolated linearly: the knots, where the slope changes."""
    rates = np.diff(np.nan_to_num(pose), axis=0) / np.diff(time)[:, None]
    change, size = np.abs(np.diff(rates, axis=0)), np.abs(rates[1:]) + np.abs(rates[:-1])
    moving = size.max(axis=1) > 1e-6
    straight = (change <= _SAME_SLOPE * size.max(axis=1, keepdims=True)).all(axis=1)
    if moving.sum() < 10 or straight[moving].mean() < 0.5:
        return time, pose
    knots = np.concatenate([[0], 1 + np.flatnonzero(~straight | ~moving), [len(time) - 1]])
    return time[knots], pose[knots]


def reckoned(drive: PreparedDrive, geometry: RobotGeometry, ratio: float, time: Array) -> tuple[np.ndarray, Array]:
    """Complex places [m] and headings [rad] (K,) at encoder times, from sprocket speeds whose turns are scaled."""
    v, w = body_twist(drive.omega, 0.0, geometry).T
    step = np.diff(drive.edges)
    heading = np.concatenate([[0.0], np.cumsum(ratio * w * step)])
    middle = (heading[1:] + heading[:-1]) / 2
    place = np.concatenate([[0.0], np.cumsum(v * step * np.exp(1j * middle))])
    return np.interp(time, drive.edges, place), np.interp(time, drive.edges, heading)


def interval_means(time: Array, omega: Array, coarse: bool = False) -> Array:
    """Mean sprocket speeds (T - 1, 2) between rows at `time` (T,), from the speeds logged there (T, 2).

    A row has the mean since the row before. But many robots log each reading of an encoder several times: such a
    reading counts once, in the middle of the time that has it, and speeds change linearly between readings. With
    `coarse`, of encoders with few ticks, the angle changes linearly from tick to tick.
    """
    return np.column_stack([(_between_ticks if coarse else _of_side)(time, side) for side in omega.T])


def _between_ticks(time: Array, omega: Array) -> Array:
    """Mean speeds (T - 1,) of one sprocket whose ticks came in the middle of the intervals that count them."""
    step = np.diff(time)
    angle = np.concatenate([[0.0], np.cumsum(omega[1:] * step)])
    ticked = np.flatnonzero(omega[1:])
    middle, half = (time[ticked] + time[ticked + 1]) / 2, (angle[ticked] + angle[ticked + 1]) / 2
    ends = np.concatenate([time[:1], middle, time[-1:]]), np.concatenate([angle[:1], half, angle[-1:]])
    return np.diff(np.interp(time, *ends)) / step


def _of_side(time: Array, omega: Array) -> Array:
    """Mean speeds (T - 1,) of one sprocket."""
    read = np.flatnonzero(np.diff(omega, prepend=np.nan) != 0)  # first rows of readings
    turning = np.flatnonzero(np.diff(read) * (np.abs(omega[read[:-1]]) > _STANDING))
    if len(turning) < _MIN_READINGS:
        return omega[1:]
    rows, usual = np.median(np.diff(read)[turning]), float(np.median(np.diff(time[read])[turning]))
    if rows < _HELD_ROWS or usual > _HELD_SECONDS:
        return omega[1:]
    begin = time[np.maximum(read - 1, 0)]
    end = np.append(begin[1:], time[-1])
    inside = np.minimum(end - begin, usual) / 2  # a value that lasts longer was read again
    knots = np.column_stack([begin + inside, end - inside]).ravel()
    at_rows = np.interp(time, knots, np.repeat(omega[read], 2))
    return np.asarray(at_rows[1:] + at_rows[:-1]) / 2


def counts_few_ticks(time: Array, omega: Array) -> bool:
    """True if sprocket speeds (T, 2) are multiples of one angle a row, or of one speed, and few of them."""
    step = np.diff(time)
    return any(_of_few(np.abs(side * by)) for side in omega[1:].T for by in (step, 1.0))


def _of_few(size: Array) -> bool:
    """True if sizes (n,) are multiples of the smallest one, and few of them, and change often."""
    turning = size[size > 1e-9]
    if not len(turning):
        return False
    ticks = size / np.quantile(turning, _SMALLEST)
    near = np.round(ticks)
    exact, changing = np.abs(ticks - near) < _EXACT, np.diff(near) != 0
    return bool(exact.mean() > _MOSTLY and near[exact].max() <= _FEW and changing.mean() > _OFTEN)


def merged(time: Array, omega: Array, most: int) -> tuple[Array, Array]:
    """At most `most` intervals out of those between `time` (T,), with the mean of `omega` (T - 1, 2); ends (M + 1,)."""
    stride = -(-len(omega) // max(most, 1))
    if stride == 1:
        return time, omega
    ends = np.unique(np.append(np.arange(0, len(time), stride), len(time) - 1))
    turned = np.concatenate([np.zeros((1, 2)), np.cumsum(omega * np.diff(time)[:, None], axis=0)])
    return time[ends], np.diff(turned[ends], axis=0) / np.diff(time[ends])[:, None]


def _moving(log: RunLog, rows: np.ndarray) -> np.ndarray:
    """(n,) bool: whether the sprockets turned on the way to each pose."""
    turned = np.concatenate([[0.0], np.cumsum(np.abs(log.omega[1:]).max(axis=1) * np.diff(log.time))])
    return np.diff(turned[rows], prepend=turned[rows[0]]) > _STANDING


def _changing(pose: Array, moving: np.ndarray) -> np.ndarray:
    """(n,) bool: false for poses that were held, equal to the one before although the sprockets turned.

    Headings alone may stay the same on a straight.
    """
    known = np.nan_to_num(pose, nan=0.0)
    same = np.append(False, (known[1:] == known[:-1]).all(axis=1) & np.isfinite(pose[1:, 0]))
    return np.asarray(~(same & moving))


@dataclass(frozen=True)
class Timeline:
    """Encoder intervals and times of nodes of several drives in a row, with a pause between them."""

    edges: Array  # (M + 1,) ends of the encoder intervals, pauses included [s]
    omega: Array  # (M, 2) mean sprocket speeds in the intervals [rad/s], 0 in pauses
    begins: np.ndarray  # (D,) first interval of each drive
    time: Array  # (K,) of the nodes [s]
    first: np.ndarray  # (K,) first interval of the drive that each node belongs to
    last: np.ndarray  # (K,) and its last one
    between: np.ndarray  # (D - 1,) steps between nodes that lead from one drive to the next
    gyro: Array | None  # (G, 3) of the drives that have one, as theirs, sums going on

    @classmethod
    def of(cls, drives: Sequence[PreparedDrive]) -> Timeline:
        """The drives in a row."""
        edges, omega, times, begins, ends = [], [], [], [], []
        gyros: list[Array] = []
        clock, interval = 0.0, 0
        for k, drive in enumerate(drives):
            shift = clock - float(drive.edges[0])
            edges.append(drive.edges + shift)
            omega.append(drive.omega if k == len(drives) - 1 else np.append(drive.omega, np.zeros((1, 2)), axis=0))
            times.append(drive.time + shift)
            if drive.gyro is not None:
                gyros.append(drive.gyro + np.append(shift, gyros[-1][-1, 1:] if gyros else (0.0, 0.0)))
            begins.append(interval)
            ends.append(interval + len(drive.omega) - 1)
            clock, interval = float(edges[-1][-1]) + _PAUSE, interval + len(drive.omega) + 1
        nodes = [len(time) for time in times]
        return cls(
            np.concatenate(edges),
            np.concatenate(omega),
            np.array(begins),
            np.concatenate(times),
            np.repeat(begins, nodes),
            np.repeat(ends, nodes),
            np.cumsum(nodes)[:-1] - 1,
            np.concatenate(gyros) if gyros else None,
        )

    def intervals(self, time: Array) -> np.ndarray:
        """The interval (K,) that each node is in at other times (K,); beyond the ends of its drive, the nearest one."""
        return np.clip(np.searchsorted(self.edges, time, side="right") - 1, self.first, self.last)

    def within(self, time: Array) -> Array:
        """Times (K,) of the nodes, limited to their drives."""
        return np.clip(time, self.edges[self.first], self.edges[self.last + 1])
