"""Quantities over time, derived from a run's log."""

import contextlib
from typing import Final

import numpy as np
import scipy

from experiments.common.paths import path_of
from trackslip import se2
from trackslip.errors import TrackslipError
from trackslip.kinematics import Array, RobotGeometry, track_slip
from trackslip.logs.runlog import MALFORMED, RunLog, stored_geometry
from trackslip.metrics import body_errors
from trackslip.motion.steady_twist import even_poses
from trackslip.trajectory.base import Reference

_MIN_SPROCKET_SPEED: Final = 0.3  # sprocket speed below which slip is mostly noise [rad/s]
_DEGREE: Final = 4  # degree of the polynomials that smooth poses, after Savitzky and Golay
_WINDOW: Final = 3.0  # window that each polynomial is fitted to [s]


class Traces:
    """A run of T rows, ready to draw. Quantities missing from the log are None; values missing in a
    row are NaN.
    """

    def __init__(self, log: RunLog) -> None:
        truth = log.truth
        self.log = log
        self.time = log.time - log.time[0]  # (T,) [s]
        self.estimate = np.where(log.is_valid[:, None], log.pose, np.nan)
        """Measured poses (T, 3), NaN in rows without a pose."""
        self.pose = _filled(self.estimate) if truth is None else truth.pose
        """True poses (T, 3), or measured poses with gaps filled if the log has no true poses."""
        path = reference_of(log)
        self.reference = None if path is None else path.pose(log.time)
        """Desired poses (T, 3)."""
        self.error = None if self.reference is None else body_errors(self.pose, self.reference)
        """Pose errors (T, 3) in the body frame [m, m, rad]."""
        self.slip: Array | None = None
        """True slips (T, 2) [-]."""
        self.identified: Array | None = None
        """Slips (T, 2) from the smoothed measured poses [-]."""
        self.assumed: Array | None = None
        """Slips (T, 2) that compensation assumes: with these slips, the set points yield the
        commanded twists [-].
        """
        if (geometry := stored_geometry(log)) is not None:
            measured = _smooth_twist(log)
            self.identified = None if measured is None else _slip(log.omega, measured, geometry)
            if log.command is not None and log.twist_command is not None:
                self.assumed = _slip(log.command, log.twist_command, geometry)
            if truth is not None:
                twist = truth.twist[:, [0, 2]]
                previous = np.concatenate([twist[:1], twist[:-1]])
                means = (twist + previous) / 2  # measured sprocket speeds are means, too
                self.slip = _slip(log.omega, means, geometry)


def reference_of(log: RunLog) -> Reference | None:
    """The reference of a run; None if the log names none, or one that does not exist any more."""
    with contextlib.suppress(*MALFORMED):
        return path_of(log.metadata)
    return None


def _slip(omega: Array, twist: Array, geometry: RobotGeometry) -> Array:
    """Slips (T, 2), NaN where a sprocket hardly turns."""
    turns = np.abs(omega) > _MIN_SPROCKET_SPEED
    return np.where(turns, track_slip(omega, twist, geometry), np.nan)


def _smooth_twist(log: RunLog) -> Array | None:
    """Mean twists (T, 2) since the previous row, from polynomials fitted to a sliding window of
    measured poses.

    NaN before the first and after the last pose; None if there are too few poses.
    """
    try:
        time, pose = even_poses(log)
    except TrackslipError:
        return None
    step = float(time[1] - time[0])
    rows = int(np.clip(_WINDOW / step, _DEGREE + 3, len(time) - 1))
    odd = rows // 2 * 2 - 1

    def derivative(order: int) -> Array:
        """Derivative (n, 3) of the fitted polynomials, by time."""
        filtered = scipy.signal.savgol_filter(pose, odd, _DEGREE, order, delta=step, axis=0)
        return np.asarray(filtered)

    heading = derivative(0)[:, 2]
    rates = derivative(1)
    v = se2.rotate(-heading, rates[:, :2])[:, 0]
    w = rates[:, 2]
    # measured sprocket speeds are means since the previous row, too
    middle = log.time - np.diff(log.time, prepend=log.time[0]) / 2
    columns = [np.interp(middle, time, column, np.nan, np.nan) for column in (v, w)]
    return np.stack(columns, axis=-1)


def _filled(pose: Array) -> Array:
    """Poses (T, 3) with NaN interpolated between neighbours, or replaced by the nearest pose at the
    ends.
    """
    rows = np.arange(len(pose))
    known = np.isfinite(pose).all(axis=1)
    if not known.any():
        return np.zeros_like(pose)
    columns = [np.interp(rows, rows[known], column[known]) for column in pose.T]
    return np.column_stack(columns)
