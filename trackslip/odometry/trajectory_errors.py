"""Relative errors of trajectories over stretches from every start, alignment, and files for other tools.

The relative error of a stretch is the estimated motion from its start to its end, seen from the start, minus the
measured one; Kuemmerle et al., "On measuring the accuracy of SLAM algorithms" (2009), and Geiger et al., "Are we ready
for autonomous driving? The KITTI vision benchmark suite" (2012).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, OutputError
from trackslip.kinematics import Array, wrap_angle
from trackslip.se2 import rotate

_TOLERANCE = 0.1  # how far the length of a stretch may be from that wanted [of that length], as evo has it
_ROUNDING = 1e-6  # of time stamps [s]


@dataclass(frozen=True)
class Trajectory:
    """Measured and estimated poses of a sensor at the same moments of a drive."""

    name: str  # name of the drive
    time: Array  # (K,) stamps of the measured poses [s]
    way: Array  # (K,) driven until then [m]
    measured: Array  # (K, 3) [m, m, rad]; NaN headings where none were measured
    estimated: Array  # (K, 3) [m, m, rad], from any start
    heading: Array  # (K,) at the start of stretches, measured or by the positions before [rad]; NaN if unknown

    @property
    def has_heading(self) -> bool:
        """True if any heading was measured."""
        return bool(np.isfinite(self.measured[:, 2]).any())

    @property
    def placed(self) -> Array:
        """Estimated poses (K, 3), moved onto the first one measured; onto all positions if no heading was."""
        if not self.has_heading:
            return best_fit(self.estimated, self.measured)
        return from_pose(self.estimated, self.measured, int(np.isfinite(self.measured[:, 2]).argmax()))


def errors_after_metres(drive: Trajectory, length: float) -> Array:
    """`errors_between` the ends of stretches, one from every start, of a way [m], to within a tenth of it."""
    return errors_between(drive, *stretches(drive.way, length, _TOLERANCE * length))


def errors_after_seconds(drive: Trajectory, length: float) -> Array:
    """`errors_between` the ends of stretches, one from every start, of a time [s], to within half an interval."""
    usual = float(np.median(np.diff(drive.time))) if len(drive.time) > 1 else 0.0
    return errors_between(drive, *stretches(drive.time, length, min(_TOLERANCE * length, usual / 2 + _ROUNDING)))


def stretches(axis: Array, length: float, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends (n,) of stretches of about this length on an ascending axis (K,): the closest end to each start.

    Of equal ends, as of a robot at rest, it is the first; starts without an end within the tolerance are left out.
    """
    if len(axis) < 2:
        return np.zeros(0, int), np.zeros(0, int)
    start = np.arange(len(axis))
    after = np.clip(np.searchsorted(axis, axis + length), 1, len(axis) - 1)
    before = np.searchsorted(axis, axis[after - 1])
    missed = np.abs(axis[[before, after]] - axis - length)
    end = np.where(missed[0] <= missed[1], before, after)
    near = (missed.min(axis=0) <= tolerance) & (end > start)
    return start[near], end[near]


def errors_between(drive: Trajectory, start: np.ndarray, end: np.ndarray) -> Array:
    """Errors (3, n) of stretches between poses `start` (n,) and `end` (n,), where the heading at the start is known.

    They are the way driven [m], the distance between the estimated and the measured end [m], and the absolute error of
    the turn [rad], NaN where it was not measured.
    """
    known = np.isfinite(drive.heading[start])
    start, end = start[known], end[known]
    turn = drive.heading[start] - drive.estimated[start, 2]
    step = drive.estimated[end] - drive.estimated[start]
    driven = np.column_stack([rotate(turn, step[:, :2]), step[:, 2]])
    error = driven - (drive.measured[end] - drive.measured[start])
    position, heading = np.hypot(error[:, 0], error[:, 1]), np.abs(wrap_angle(error[:, 2]))
    return np.stack([drive.way[end] - drive.way[start], position, heading])


def moved(pose: Array, turn: float, pivot: Array, target: Array) -> Array:
    """Poses (K, 3) turned by `turn` [rad] about the point `pivot` (2,), which gets to `target` (2,)."""
    return np.column_stack([target + rotate(turn, pose[:, :2] - pivot), pose[:, 2] + turn])


def best_fit(pose: Array, measured: Array) -> Array:
    """Poses (K, 3) moved so that their positions are closest to those measured (K, 3), in least squares.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns" (1991), without scale.
    """
    centre, target = pose[:, :2].mean(axis=0), measured[:, :2].mean(axis=0)
    here, there = (pose[:, :2] - centre) @ [1, 1j], (measured[:, :2] - target) @ [1, 1j]
    return moved(pose, float(np.angle(np.vdot(here, there))), centre, target)


def from_pose(pose: Array, measured: Array, row: int = 0) -> Array:
    """Poses (K, 3) moved so that one of them is as measured (K, 3), with its heading."""
    return moved(pose, float(measured[row, 2] - pose[row, 2]), pose[row, :2], measured[row, :2])


def write_tum(path: str | Path, time: ArrayLike, pose: ArrayLike) -> None:
    """Write poses (K, 3) [m, m, rad] at times (K,) [s] in the TUM format for tools such as evo.

    Poses lie in the plane z = 0. A heading that is NaN, as it was not measured, is written as 0.

    Raises:
        InvalidValueError: if the numbers of times and poses differ.
        OutputError: if the file cannot be written.
    """
    time, pose = np.asarray(time, float), np.asarray(pose, float)
    if time.ndim != 1 or pose.shape != (len(time), 3):
        raise InvalidValueError("pose", pose.shape, f"of shape {(*time.shape, 3)}, as there are that many times")
    half, none = np.nan_to_num(pose[:, 2], nan=0.0) / 2, np.zeros(len(time))
    rows = np.column_stack([time, pose[:, :2], none, none, none, np.sin(half), np.cos(half)])
    text = "".join(" ".join(map("{:.9f}".format, row)) + "\n" for row in rows.tolist())
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
