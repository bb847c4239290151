"""Drives prepared for the estimator: encoder intervals and poses of one or several logs, each on its own clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.drive.whitening import whitening
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

MAX_POSES = 24_000  # poses that are all used
MAX_ROWS = 100_000  # encoder intervals used in all; more are merged
_THINNED = 10_000  # poses used out of more than MAX_POSES
MIN_POSES = 10  # of a drive
_MAX_STEP = 2.5  # time between nodes [median time between poses]
_MAX_SPEED = 1e4  # of a sprocket [rad/s]
_STANDING = 1e-3  # sprocket speed of a robot at rest [rad/s]


@dataclass(frozen=True)
class Drive:
    """One drive: encoder intervals, and nodes of the trajectory, most of which have a measured pose."""

    name: str
    edges: Array  # (M + 1,) ends of the encoder intervals, encoder clock [s]
    omega: Array  # (M, 2) mean sprocket speeds in the intervals [rad/s]
    time: Array  # (K,) of the nodes, pose clock [s]
    pose: Array  # (K, 3) measured [m, m, rad]; NaN where not measured, heading unwrapped
    rows: np.ndarray  # (K,) int: row of the log of each node; -1 for nodes inserted into gaps
    interval: float  # usual time between poses [s]
    whitening: Array | None = None  # (K, 3, 3) see `whitening`; None where the poses' covariances are not known

    @property
    def has_heading(self) -> bool:
        """Whether any heading was measured."""
        return bool(np.isfinite(self.pose[:, 2]).any())

    @property
    def shapes(self) -> Array:
        """(K, 3, 3) the whitening, or nothing to whiten."""
        return np.broadcast_to(np.eye(3), (len(self.time), 3, 3)) if self.whitening is None else self.whitening

    def kept(self, nodes: np.ndarray) -> Drive:
        """The drive with the nodes of (K,) bool alone."""
        shape = None if self.whitening is None else self.whitening[nodes]
        return replace(self, time=self.time[nodes], pose=self.pose[nodes], rows=self.rows[nodes], whitening=shape)


def drives_of(logs: Sequence[RunLog], max_poses: int = MAX_POSES) -> tuple[list[Drive], list[str]]:
    """The drives that can be used, and a line for each that cannot be; raises LogError if there is none.

    Of more than `max_poses` poses in all, a part is used.
    """
    drives, refused = [], []
    share = max(len(logs), 1)
    if sum(int(log.is_valid.sum()) for log in logs) > max_poses:
        max_poses = min(max_poses, _THINNED)
    for log in logs:
        try:
            drives.append(drive_of(log, max_poses // share, MAX_ROWS // share))
        except LogError as error:
            refused.append(str(error))
    if not drives:
        raise LogError(refused[0] if refused else "no drives")
    return drives, refused


def drive_of(log: RunLog, max_poses: int = MAX_POSES, max_rows: int = MAX_ROWS) -> Drive:
    """A drive prepared; raises LogError if it stands still or has too few poses."""
    rows = np.flatnonzero(log.is_valid)
    if len(rows) > 1:
        rows = rows[_changing(log.pose[rows], _moving(log, rows))]
    if len(rows) < MIN_POSES:
        raise LogError(f"run {log.run!r}: {len(rows)} pose(s) while it drives, needs at least {MIN_POSES}")
    if not np.abs(log.omega[1:]).max() > _STANDING:
        raise LogError(f"run {log.run!r}: the sprockets stand still")
    wild = np.flatnonzero(np.abs(log.omega).max(axis=1) > _MAX_SPEED)
    if len(wild):
        k = int(wild[0])
        side = int(np.argmax(np.abs(log.omega[k])))
        name, speed = ("omega_l", "omega_r")[side], log.omega[k, side]
        raise LogError(
            f"run {log.run!r}: {name} = {speed:g} rad/s in its row {k + 1}, at most {_MAX_SPEED:g} is allowed"
        )
    rows = rows[:: -(-len(rows) // max(max_poses, MIN_POSES))]
    edges, omega = merged(log.time, log.omega[1:], max_rows)
    time, pose = log.time[rows], log.pose[rows].copy()
    known = np.isfinite(pose[:, 2])
    pose[known, 2] = np.unwrap(pose[known, 2])
    usual = float(np.median(np.diff(time)))
    nodes = _filled(time, pose, rows, usual)
    stated = None if log.covariance is None else log.covariance[nodes[2]]
    return Drive(log.run, edges, omega, *nodes, usual, whitening(nodes[1], stated))


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
