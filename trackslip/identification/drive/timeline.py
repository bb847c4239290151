"""Drives one after another on one clock: dead reckoning of all of them takes hardly longer than that of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.identification.drive.drives import Drive
from trackslip.kinematics import Array

_PAUSE = 1.0  # between drives [s]


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

    @classmethod
    def of(cls, drives: Sequence[Drive]) -> Timeline:
        """The drives in a row."""
        edges, omega, times, begins, ends = [], [], [], [], []
        clock, interval = 0.0, 0
        for k, drive in enumerate(drives):
            shift = clock - float(drive.edges[0])
            edges.append(drive.edges + shift)
            omega.append(drive.omega if k == len(drives) - 1 else np.append(drive.omega, np.zeros((1, 2)), axis=0))
            times.append(drive.time + shift)
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
        )

    def intervals(self, time: Array) -> np.ndarray:
        """The interval (K,) that each node is in at other times (K,); beyond the ends of its drive, the nearest one."""
        return np.clip(np.searchsorted(self.edges, time, side="right") - 1, self.first, self.last)

    def within(self, time: Array) -> Array:
        """Times (K,) of the nodes, limited to their drives."""
        return np.clip(time, self.edges[self.first], self.edges[self.last + 1])
