"""What a teleoperated drive is made of."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from trackslip.errors import LogError
from trackslip.logs.runlog import RunLog

_AT_REST = 1e-3  # mean speed of the tracks below which a robot stands [m/s]


@dataclass(frozen=True)
class DriveContents:
    """The true motion of a drive, and what was measured of it."""

    run: str
    readings: int
    """Rows of its log."""
    poses: int
    """Rows with a pose."""
    way: float
    """Length of the true path [m]."""
    turned_left: float
    """Sum of all turns to the left [rad]."""
    turned_right: float
    """Sum of all turns to the right [rad]."""
    standing: float
    """Share of the time at rest [-]."""

    @classmethod
    def of(cls, log: RunLog) -> Self:
        """Sum up a log with truth; raises LogError for one without."""
        if log.truth is None:
            raise LogError(f"run {log.run!r}: has no truth")
        step = np.diff(log.truth.pose, axis=0)
        duration, turn = np.diff(log.time), step[:, 2]
        way = np.hypot(step[:, 0], step[:, 1])
        resting = (way + np.abs(turn)) < _AT_REST * duration
        return cls(
            run=log.run,
            readings=len(log.time),
            poses=int(log.is_valid.sum()),
            way=float(way.sum()),
            turned_left=float(turn[turn > 0].sum()),
            turned_right=float(-turn[turn < 0].sum()),
            standing=float(duration[resting].sum() / duration.sum()),
        )
