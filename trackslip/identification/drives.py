"""Drives prepared for fits: encoder intervals and poses of one or several logs, each on its own clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from trackslip.doubts import refuse
from trackslip.errors import LogError, counted
from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.logs.runlog import Refused, RunLog, none_usable

MAX_POSES = 12_000  # poses that are all used
MAX_ROWS = 100_000  # encoder intervals used in all; more are merged
_THINNED = 10_000  # poses used out of more than MAX_POSES
MIN_POSES, _FEWEST = 10, 3  # of a drive, and if the user insists
_INFORMATIVE, _NEARLY = 0.05, 0.1  # time between poses below which more tell little more [s]; tolerance [-]
_MAX_STEP = 2.5  # time between nodes [median time between poses]
_MAX_SPEED = 1e4  # of a sprocket [rad/s]
_MIN_HELD, _MAX_HELD = 1.5, 0.5  # time between readings of an encoder that is read less often than logged [rows, s]
_MIN_READINGS = 4
_SMALLEST, _EXACT, _MOSTLY = 0.002, 0.02, 0.97  # ticks of encoders: quantile that is one, tolerance, share within it
_FEW, _OFTEN = 40, 0.05  # few ticks in a row's interval, the share of rows in which their number changes
_STANDING = 1e-3  # sprocket speed of a robot at rest [rad/s]
_PAUSE = 1.0  # between drives [s]
_MOST_UNLIKE = 10.0  # ratio of a standard deviation to the usual one, and of that to it, at most [-]
_MIN_STATED = 0.5  # share of the poses that must state a covariance


@dataclass(frozen=True)
class PreparedDrive:
    """One drive: encoder intervals, and nodes of the trajectory, most of which have a measured pose."""

    name: str
    edges: Array  # (M + 1,) ends of the encoder intervals, encoder clock [s]
    omega: Array  # (M, 2) mean sprocket speeds in the intervals [rad/s]
    time: Array  # (K,) of the nodes, pose clock [s]
    pose: Array  # (K, 3) measured [m, m, rad]; NaN where not measured, heading unwrapped
    rows: np.ndarray  # (K,) int: row of the log of each node; -1 for nodes inserted into gaps
    interval: float  # usual time between poses [s]
    whitening: Array | None = None  # (K, 3, 3) see `whitening`; None where the poses' covariances are not known
    coarse: bool = False  # encoders with few ticks: smoothing helps, as a lag would, though nothing lags
    accept: tuple[str, ...] = ()  # doubts to ignore
    gyro: Array | None = None  # (T, 3) encoder clock [s], and sums as in RunLog

    @property
    def has_heading(self) -> bool:
        """True if any heading was measured."""
        return bool(np.isfinite(self.pose[:, 2]).any())

    @property
    def shapes(self) -> Array:
        """(K, 3, 3) the whitening, or nothing to whiten."""
        return np.broadcast_to(np.eye(3), (len(self.time), 3, 3)) if self.whitening is None else self.whitening

    def kept(self, nodes: np.ndarray) -> PreparedDrive:
        """The drive with the nodes of (K,) bool alone."""
        shape = None if self.whitening is None else self.whitening[nodes]
        return replace(self, time=self.time[nodes], pose=self.pose[nodes], rows=self.rows[nodes], whitening=shape)


def drives_of(logs: Sequence[RunLog], max_poses: int = MAX_POSES) -> tuple[list[PreparedDrive], list[Refused]]:
    """The drives that can be used, and those that cannot be; raises LogError if there is none.

    Of more than `max_poses` poses in all, a part is used.
    """
    drives, refused = [], list[Refused]()
    share = max(len(logs), 1)
    if sum(int(log.is_valid.sum()) for log in logs) > max_poses:
        max_poses = min(max_poses, _THINNED)
    for log in logs:
        try:
            drives.append(drive_of(log, max_poses // share, MAX_ROWS // share))
        except LogError as error:
            refused.append(Refused.of(log.run, error))
    if not drives:
        raise LogError(none_usable(refused) if refused else "no drives")
    return drives, refused


def drive_of(log: RunLog, max_poses: int = MAX_POSES, max_rows: int = MAX_ROWS) -> PreparedDrive:
    """A drive prepared; raises LogError if it stands still or has too few poses."""
    rows = np.flatnonzero(log.is_valid)
    if len(rows) > 1:
        rows = rows[_changing(log.pose[rows], _moving(log, rows))]
    if len(rows) < (_FEWEST if "short" in log.accept else MIN_POSES):
        refuse("short", run=log.run, poses=counted(len(rows), "pose"), least=MIN_POSES)
    if not np.abs(log.omega[1:]).max() > _STANDING:
        refuse("still", run=log.run)
    wild = np.flatnonzero(np.abs(log.omega).max(axis=1) > _MAX_SPEED)
    if len(wild):
        k = int(wild[0])
        side = int(np.argmax(np.abs(log.omega[k])))
        name, speed = ("omega_l", "omega_r")[side], log.omega[k, side]
        raise LogError(
            f"run {log.run!r}: {name} = {speed:g} rad/s in its row {k + 1}, at most {_MAX_SPEED:g} is allowed"
        )
    often = int(_INFORMATIVE / np.median(np.diff(log.time[rows])) + _NEARLY)
    rows = rows[:: max(-(-len(rows) // max(max_poses, MIN_POSES)), min(often, len(rows) // MIN_POSES), 1)]
    coarse = counts_few_ticks(log.time, log.omega)
    edges, omega = merged(log.time, interval_means(log.time, log.omega, coarse), max_rows)
    time, pose = log.time[rows], log.pose[rows].copy()
    known = np.isfinite(pose[:, 2])
    pose[known, 2] = np.unwrap(pose[known, 2])
    usual = float(np.median(np.diff(time)))
    nodes = _filled(time, pose, rows, usual)
    stated = None if log.covariance is None else log.covariance[nodes[2]]
    shape = whitening(nodes[1], stated)
    turned = None if log.gyro_sums is None else np.column_stack([log.time, log.gyro_sums])
    return PreparedDrive(log.run, edges, omega, *nodes, usual, shape, coarse, log.accept, turned)


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
    if rows < _MIN_HELD or usual > _MAX_HELD:
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
    """(n,) bool: false for poses that were held, equal to the one before although the sprockets turned."""
    known = np.nan_to_num(pose, nan=0.0)
    same = np.append(False, (known[1:] == known[:-1]).all(axis=1))
    return np.asarray(~(same & moving))


def _filled(time: Array, pose: Array, rows: np.ndarray, usual: float) -> tuple[Array, Array, np.ndarray]:
    """The nodes, with more in gaps: errors of the headings within a long step would otherwise be neglected."""
    step = np.diff(time)
    count = np.where(step > _MAX_STEP * usual, np.ceil(step / (2 * usual)).astype(int), 1)
    count = np.minimum(count, 1000)
    if (count == 1).all():
        return time, pose, rows
    at = np.concatenate([[0], np.cumsum(count)])
    nodes = np.interp(np.arange(at[-1] + 1), at, time)
    poses = np.full((len(nodes), 3), np.nan)
    poses[at] = pose
    of = np.full(len(nodes), -1)
    of[at] = rows
    return nodes, poses, of


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

    @cached_property
    def gyro_turn(self) -> Any:
        """The gyro's turn as a function of time, smooth, so that it has no kinks in the clock offset."""
        assert self.gyro is not None
        return PchipInterpolator(*self.gyro.T[:2])

    def intervals(self, time: Array) -> np.ndarray:
        """The interval (K,) that each node is in at other times (K,); beyond the ends of its drive, the nearest one."""
        return np.clip(np.searchsorted(self.edges, time, side="right") - 1, self.first, self.last)

    def within(self, time: Array) -> Array:
        """Times (K,) of the nodes, limited to their drives."""
        return np.clip(time, self.edges[self.first], self.edges[self.last + 1])


def whitening(pose: Array, covariance: Array | None) -> Array | None:
    """Lower left blocks W (K, 3, 3) for poses (K, 3) with covariances (K, 3, 3), NaN where not measured or stated.

    W times a residual of a pose is uncorrelated, and as large as a usual one: two components in m, and the heading's in
    rad, which depends on nothing else. A pose without covariance counts as a usual one. None if hardly any has one, or
    all are alike.
    """
    if covariance is None:
        return None
    known = np.asarray(np.isfinite(pose[:, :2]).all(axis=1))
    stated = known & np.isfinite(covariance[:, :2, :2]).all(axis=(1, 2))
    headed = stated & np.isfinite(pose[:, 2]) & np.isfinite(covariance).all(axis=(1, 2))
    headed &= covariance[:, 2, 2] > 0
    turn = np.where(headed, covariance[:, 2, 2], 1.0)
    lever = np.where(headed[:, None], covariance[:, :2, 2], 0.0) / turn[:, None]
    block = covariance[:, :2, :2] - turn[:, None, None] * lever[:, :, None] * lever[:, None, :]
    block = np.where(stated[:, None, None], block, np.eye(2))
    values, axes = np.linalg.eigh((block + block.swapaxes(1, 2)) / 2)
    stated &= values[:, 0] > 0
    if stated.sum() < _MIN_STATED * known.sum():
        return None
    usual = float(np.sqrt(np.median(values[stated].mean(axis=1))))
    scale = np.where(stated[:, None], _limited_ratio(usual / np.sqrt(np.maximum(values, 1e-300))), 1.0)
    found = np.zeros((len(pose), 3, 3))
    found[:, :2, :2] = np.einsum("kij,kj,klj->kil", axes, scale, axes)
    found[:, :2, 2] = -np.einsum("kij,kj->ki", found[:, :2, :2], np.where(stated[:, None], lever, 0.0))
    heading = float(np.sqrt(np.median(turn[headed]))) if headed.any() else 1.0
    found[:, 2, 2] = np.where(headed, _limited_ratio(heading / np.sqrt(turn)), 1.0)
    return None if np.allclose(found, np.eye(3)) else found


def _limited_ratio(ratio: Array) -> Array:
    return np.clip(ratio, 1 / _MOST_UNLIKE, _MOST_UNLIKE)
