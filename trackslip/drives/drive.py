"""A drive: encoder intervals and measured poses, and drives in succession on one time axis.

Encoders and poses have their own clocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from trackslip.kinematics import Array

BLOCK: Final = 10.0
"""Least duration of a block of driving; slip in different blocks is assumed to be independent
[s].
"""


@dataclass(frozen=True)
class Drive:
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


@dataclass(frozen=True)
class Drives:
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
