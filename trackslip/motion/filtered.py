"""Low-pass filters of poses, and the body twist from their differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trackslip import se2
from trackslip.errors import LogError
from trackslip.kinematics import Array, advance
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady_twist import SteadyTwist, long_run_covariance, require_poses, within

_MIN_STEPS = 20  # minimum number of steps for a mean twist
_LAGS = 0.5  # width of the lag window for the error of a mean twist, relative to the number of rows
_MIN_FILTERED_ROWS = 16  # rows needed to filter without transients
_MAX_TURN_PER_ROW = 0.15  # turn per row at which the filter shrinks a circle by 8e-5 [rad]
_MAX_GAP_TURN = 2.5  # turn in a gap that an arc can bridge [rad]


@dataclass(frozen=True)
class SmoothedMotion:
    """Smoothed motion of a robot."""

    time: Array  # (M,) [s]
    pose: Array  # (M, 3) [m, m, rad]
    twist: Array  # (M, 2) [m/s, rad/s]


def paper_motion(log: RunLog) -> SmoothedMotion:
    """The paper's smoothing (Sec. III-B), followed by differences; the speed is the length of the displacement.

    A second-order Butterworth filter is applied to the heading and, since the paper does not specify its low-pass, to
    the coordinates too. Its delay does not matter in a steady turn, but noise increases the lengths. Arcs bridge rows
    without a valid pose and resample unequal time steps. Raises LogError if there are too few valid poses, or the robot
    turns too far from row to row or within a gap.
    """
    even, pose = even_poses(log)
    smooth = low_pass(pose)
    motion = difference(even, smooth)
    dx, dy, turn = np.diff(smooth, axis=0).T
    v = np.copysign(np.hypot(dx, dy), motion.twist[:, 0])
    return SmoothedMotion(motion.time, motion.pose, np.stack([v, turn], axis=-1) / np.diff(even)[:, None])


def low_pass(values: Array) -> Array:
    """Values (T, k) through the paper's Butterworth filter, as if they had always been as in the first row.

    It passes half of the frequencies that a log can show.
    """
    sections = scipy.signal.butter(2, 0.5, output="sos")
    settled = scipy.signal.sosfilt_zi(sections)[..., None] * values[0]
    return np.asarray(scipy.signal.sosfilt(sections, values, axis=0, zi=settled)[0])


def mean_twist(motion: SmoothedMotion, log: RunLog, window: tuple[float, float]) -> SteadyTwist:
    """The mean of the twists of a motion in a window; raises LogError if there are too few.

    Twists are differences of poses, so their noise cancels in the mean except at the ends, which takes a wide lag
    window to account for.
    """
    rows = within(motion.time, window)
    require_poses(rows, _MIN_STEPS, log, window)
    twist = motion.twist[rows]
    mean = twist.mean(axis=0)
    return SteadyTwist(mean, long_run_covariance(twist - mean, _LAGS) / rows.sum())


def even_poses(log: RunLog) -> tuple[Array, Array]:
    """Evenly spaced times (M,) [s] and the poses (M, 3), resampled along arcs; raises LogError like the filters."""
    valid = log.has_heading
    if valid.sum() < _MIN_FILTERED_ROWS:
        raise LogError(f"run {log.run!r}: {int(valid.sum())} valid poses, needs at least {_MIN_FILTERED_ROWS}")
    time = log.time[valid]
    step = float(np.median(np.diff(log.time)))
    even = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
    pose = log.pose[valid]
    turn = np.abs(np.diff(pose[:, 2]))
    if turn.max() > _MAX_GAP_TURN:
        k = int(np.argmax(turn))
        raise LogError(
            f"run {log.run!r}: turns by {turn[k]:.1f} rad between the valid poses at t = {time[k]:.12g} s and "
            f"{time[k + 1]:.12g} s: at most {_MAX_GAP_TURN:.1f} rad can be bridged"
        )
    per_step = float(np.median(turn))
    if per_step > _MAX_TURN_PER_ROW:
        raise LogError(
            f"run {log.run!r}: turns by {per_step:.2f} rad from row to row, which the filter would flatten: "
            f"at most {_MAX_TURN_PER_ROW:g} rad, log it more often"
        )
    if len(even) < _MIN_FILTERED_ROWS:
        raise LogError(f"run {log.run!r}: {len(even)} even time steps, needs at least {_MIN_FILTERED_ROWS}")
    return even, _along_arcs(time, pose, even)


def _along_arcs(time: Array, pose: Array, at: Array) -> Array:
    """Poses (M, 3) at times `at` (M,) on the arcs between neighbouring poses (T, 3) at times (T,)."""
    motion = difference(time, pose)
    k = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    elapsed, whole = at - time[k], time[k + 1] - time[k]
    arc = advance(pose[k], motion.twist[k], elapsed)
    missed = pose[k + 1] - advance(pose[k], motion.twist[k], whole)  # the arc only matches the mean heading
    return arc + (elapsed / whole)[:, None] * missed


def difference(time: Array, pose: Array) -> SmoothedMotion:
    """Twists between neighbouring poses (T, 3), exact for arcs."""
    duration = np.diff(time)
    motion = se2.log(se2.steps(pose))
    return SmoothedMotion((time[1:] + time[:-1]) / 2, (pose[1:] + pose[:-1]) / 2, motion[:, ::2] / duration[:, None])
