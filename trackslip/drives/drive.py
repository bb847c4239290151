"""A drive: encoder intervals and measured poses, and drives in succession on one time axis.

Encoders and poses have their own clocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from trackslip.drives.encoders import Encoders
from trackslip.kinematics import Array
from trackslip.viewable import ShortRepr

BLOCK: Final = 10.0
"""Least duration of a block of driving; slip in different blocks is assumed to be independent
[s].
"""
MOST_INTERVALS: Final = 200_000
"""Most encoder intervals in a fit, to limit memory."""
_POSES_PER_SECOND: Final = 2.0  # rate at which windows of poses have their usual duration [Hz]
_PAUSE: Final = 5.0  # pause between drives on the common time axis [s]
_STANDING: Final = np.zeros((1, 2))  # speeds in a pause [rad/s]


@dataclass(frozen=True, repr=False)
class Drive(ShortRepr):
    """A drive: encoder intervals and measured poses."""

    name: str
    edges: Array  # (M + 1,) ends of the encoder intervals, by the encoder clock [s]
    omega: Array  # (M, 2) mean sprocket speeds in the intervals [rad/s]
    time: Array  # (K,) times of the poses, by the pose clock [s]
    pose: Array  # (K, 3) measured poses [m, m, rad]; NaN where not measured, heading unwrapped
    interval: float  # usual time between poses [s]
    # (T, 3) times by the encoder clock [s], and sums up to them as in `gyro.turn_sums`
    gyro: Array | None = None
    # commanded sprocket speeds, if constant throughout [rad/s]
    command: tuple[float, ...] | None = None
    # (B, 4) times and poses outside the encoder readings, used to align clocks
    beyond: Array | None = None
    repeated: int = 0  # number of poses left out because they repeat the previous pose
    # number of poses left out because they lie on the line between other poses
    interpolated: int = 0
    by_ticks: bool = False  # true if the angles change linearly from tick to tick
    has_whole_speeds: bool = (
        False  # true if the logged sprocket speeds are whole numbers, like counts
    )
    notes: tuple[str, ...] = ()  # parts of the log that were left out, one line each

    @property
    def has_heading(self) -> bool:
        """True if any heading was measured."""
        return bool(np.isfinite(self.pose[:, 2]).any())

    def angles(self, time: Array) -> Array:
        """Angles (2, n) turned by the sprockets from the start to encoder times (n,) [rad]."""
        sides = Encoders(self.edges, self.omega).angles.T
        return np.stack([np.interp(time, self.edges, side) for side in sides])

    def smooth(self) -> Drive:
        """The drive with `Encoders.smooth`, for fits."""
        encoders = Encoders(self.edges, self.omega).smooth()
        return replace(self, edges=encoders.edges, omega=encoders.omega)

    def blocks(self, time: Array, least: float = BLOCK) -> np.ndarray:
        """Number (n,) of the block of driving at each pose time (n,).

        Blocks have equal durations of about `least` [s]; none contains both ends of a drive that
        lasts much longer. A block without poses has a number, too: `Drives.blocks` leaves it out.
        """
        begin = self.time[0]
        duration = max(self.time[-1] - begin, 1e-9)
        count = max(1, round(duration / least))
        number = ((time - begin) / duration * count).astype(int)
        return np.minimum(number, count - 1)

    def span(self, length: float) -> float:
        """Duration of windows in the drive [s]: `length`, or longer to hold as many poses as
        `length` does at 2 Hz.
        """
        return length * max(1.0, _POSES_PER_SECOND * self.interval)

    def with_poses(self, rows: np.ndarray) -> Drive:
        """The drive with the poses in `rows` (n,) only."""
        pose = self.pose[rows].copy()
        headed = np.isfinite(pose[:, 2])
        pose[headed, 2] = np.unwrap(pose[headed, 2])  # a heading left out may have added a turn
        return replace(self, time=self.time[rows], pose=pose)

    def turned(self, angle: float) -> Drive:
        """The drive with all headings larger by an angle [rad]."""
        if angle == 0.0:
            return self
        of_heading = np.array([0.0, 0.0, angle])
        beyond = None if self.beyond is None else self.beyond + np.append(0.0, of_heading)
        return replace(self, pose=self.pose + of_heading, beyond=beyond)

    def cut(self, begin: float, end: float, clock: float = 0.0, around: float = 0.0) -> Drive:
        """The drive from `begin` to `end`, by the pose clock [s].

        `clock` is the encoder clock minus the pose clock; encoders and gyro continue for `around`
        before and after the poses, if they were read there [s]. An interval that contains an end is
        shortened to it, so that the angles between any two times within remain the same.
        """
        # poses, by their own clock
        drive = self.with_poses(_within(self.time, begin, end))
        beyond = None
        if self.beyond is not None:
            rows = _within(self.beyond[:, 0], begin, end)
            beyond = self.beyond[rows] if len(rows) else None

        # encoders and gyro, by the encoder clock
        read = self.edges[0], self.edges[-1]
        first = float(np.clip(begin + clock - around, *read))
        last = float(np.clip(end + clock + around, *read))
        edges = _cut_times(self.edges, first, last)
        interval = np.searchsorted(self.edges, edges[1:]) - 1
        omega = self.omega[interval]
        gyro = None if self.gyro is None else _cut_sums(self.gyro, first, last)
        return replace(drive, edges=edges, omega=omega, gyro=gyro, beyond=beyond)


def _within(time: Array, begin: float, end: float) -> np.ndarray:
    """Rows of the times (n,) from `begin` to `end` [s]."""
    return np.flatnonzero((time >= begin) & (time <= end))


def _cut_times(time: Array, begin: float, end: float) -> Array:
    """The times (n,) from `begin` to `end` [s], with both."""
    inner = time[_within(time, begin, end)]
    return np.unique(np.concatenate([[begin], inner, [end]]))


def _cut_sums(gyro: Array, begin: float, end: float) -> Array:
    """Times and sums (T, 3) from `begin` to `end` [s], interpolated at both."""
    time = _cut_times(gyro[:, 0], begin, end)
    turned, measured = (np.interp(time, gyro[:, 0], sums) for sums in gyro.T[1:])
    return np.column_stack([time, turned, measured])


@dataclass(frozen=True, repr=False)
class Drives(ShortRepr):
    """Drives in succession on a common time axis: encoder intervals, with pauses between drives,
    and poses.
    """

    drives: tuple[Drive, ...]
    edges: Array  # (M + 1,) ends of the encoder intervals, pauses included [s]
    omega: Array  # (M, 2) mean sprocket speeds in the intervals [rad/s], 0 in pauses
    begins: np.ndarray  # (D,) first interval of each drive
    # (G, 3) `Drive.gyro` of drives with a gyro; sums continue across drives
    gyro: Array | None
    time: Array  # (K,) times of the poses [s]
    place: np.ndarray  # (K,) measured positions, x + i y [m]; 0 where not measured
    heading: Array  # (K,) measured headings [rad]; 0 where not measured
    known: np.ndarray  # (2, K) bool: whether positions and headings were measured
    first: np.ndarray  # (D + 1,) index of each drive's first pose, and K

    @classmethod
    def of(cls, drives: Sequence[Drive]) -> Drives:
        """Join drives in succession."""
        # the time axis begins at 0 with the first drive; the next begins after a pause
        starts = np.array([drive.edges[0] for drive in drives])
        ends = np.array([drive.edges[-1] for drive in drives])
        durations = ends - starts + _PAUSE
        new_starts = np.cumsum(durations) - durations
        shifts = (new_starts - starts).tolist()
        shifted = list(zip(drives, shifts, strict=True))

        # encoders: the interval from the last edge of a drive to the first of the next is the pause
        edges = [drive.edges + shift for drive, shift in shifted]
        speeds = list[Array]()
        for drive in drives:
            speeds += [drive.omega, _STANDING]
        without_last_pause = speeds[:-1]

        # poses
        times = [drive.time + shift for drive, shift in shifted]
        poses = np.concatenate([drive.pose for drive in drives])
        x, y, heading = np.nan_to_num(poses).T
        is_placed = np.isfinite(poses[:, 0])
        is_headed = np.isfinite(poses[:, 2])
        return cls(
            drives=tuple(drives),
            edges=np.concatenate(edges),
            omega=np.concatenate(without_last_pause),
            begins=_first_indices(edges)[:-1],
            gyro=_joined_sums(shifted),
            time=np.concatenate(times),
            place=x + 1j * y,
            heading=heading,
            known=np.stack([is_placed, is_headed]),
            first=_first_indices(times),
        )

    @classmethod
    def smooth(cls, drives: Sequence[Drive]) -> Drives:
        """Join drives with smooth encoders, for fits; as they are, if that took too much memory."""
        smooth = [drive.smooth() for drive in drives]
        intervals = sum(len(drive.omega) for drive in smooth)
        return cls.of(smooth if intervals <= MOST_INTERVALS else drives)

    def intervals(self, time: Array) -> np.ndarray:
        """Index (K,) of the encoder interval in each pose's drive that contains `time` (K,), or is
        nearest to it.
        """
        # a drive's last interval lies before the pause, which lies before the next drive
        last = np.append(self.begins[1:] - 2, len(self.omega) - 1)
        interval = np.searchsorted(self.edges, time, side="right") - 1
        return np.clip(interval, self.begins[self.drive], last[self.drive])

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

    def belt_distance(self, radius: float) -> Array:
        """Mean distance (K,) driven by the belts up to each pose [m], for a sprocket radius [m]."""
        speed = np.abs(self.omega).mean(axis=1)
        turned = np.append(0.0, np.cumsum(speed * np.diff(self.edges)))
        return radius * np.interp(self.time, self.edges, turned)

    def middle_distance(self, radius: float) -> Array:
        """Distance (K,) driven by the middle of the tracks up to each pose [m], without slip, for a
        sprocket radius [m].
        """
        speed = np.abs(self.omega.mean(axis=1))
        turned = np.append(0.0, np.cumsum(speed * np.diff(self.edges)))
        return radius * np.interp(self.time, self.edges, turned)

    def blocks(self, length: float) -> np.ndarray:
        """Number (K,) of each pose's block of driving, from 0 without gaps: each has poses.

        Blocks are no shorter than windows of `length` [s]. A drive with a single block shares the
        previous drive's last block if both have the same constant command.
        """
        blocks = list[np.ndarray]()
        count = 0
        command: tuple[float, ...] | None = None  # of the previous drive
        for drive in self.drives:
            number = drive.blocks(drive.time, max(BLOCK, drive.span(length)))
            _, own = np.unique(number, return_inverse=True)  # without blocks that have no poses
            shared = own[-1] == 0 and drive.command is not None and drive.command == command
            first = count - 1 if shared else count
            blocks.append(first + own)
            count = first + int(own[-1]) + 1
            command = drive.command
        return np.concatenate(blocks)


def _first_indices(parts: Sequence[Array]) -> np.ndarray:
    """Indices (D + 1,) of the first entries of D parts among all entries, and their number."""
    lengths = [len(part) for part in parts]
    return np.append(0, np.cumsum(lengths))


def _joined_sums(shifted: Sequence[tuple[Drive, float]]) -> Array | None:
    """`Drive.gyro` of drives (G, 3), each later by its shift [s]; sums continue across drives."""
    parts = list[Array]()
    before: Array = np.zeros(2)  # sums up to the end of the previous drive
    for drive, shift in shifted:
        if drive.gyro is not None:
            parts.append(drive.gyro + np.append(shift, before))
            before = parts[-1][-1, 1:]
    return np.concatenate(parts) if parts else None
