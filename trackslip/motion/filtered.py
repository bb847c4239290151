"""The paper's low-pass filter of poses, and the body twist from their differences."""

from __future__ import annotations

import numpy as np
import scipy

from trackslip import se2
from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady_twist import SteadyTwist, long_run_covariance, require_poses, within

_MIN_STEPS = 20  # minimum number of steps for a mean twist
_LAGS = 0.5  # width of the lag window for the error of a mean twist, relative to the number of rows
_MAX_TURN_PER_ROW = 0.15  # turn per row at which the filter shrinks a circle by 8e-5 [rad]
_MAX_GAP_TURN = 2.5  # turn in a gap that an arc can bridge [rad]


def paper(log: RunLog, window: tuple[float, float]) -> SteadyTwist:
    """The mean twist by the paper's smoothing (Sec. III-B) and differences; the speed is the displacement's length.

    The filter is applied to the heading and, since the paper does not specify its low-pass, to the coordinates too. Its
    delay does not matter in a steady turn, but noise increases the lengths. Noise of twists cancels in the mean except
    at the ends, which takes a wide lag window to account for. Raises LogError if there are too few valid poses, or the
    robot turns too far from row to row or within a gap.
    """
    time, pose = even_poses(log)
    smooth = low_pass(pose)
    dx, dy, turn = np.diff(smooth, axis=0).T
    forwards = np.copysign(np.hypot(dx, dy), se2.log(se2.steps(smooth))[:, 0])
    rows = within((time[1:] + time[:-1]) / 2, window)
    require_poses(rows, _MIN_STEPS, log, window)
    twist = (np.stack([forwards, turn], axis=-1) / np.diff(time)[:, None])[rows]
    mean = twist.mean(axis=0)
    return SteadyTwist(mean, long_run_covariance(twist - mean, _LAGS) / rows.sum())


def low_pass(values: Array) -> Array:
    """Values (T, k) through a second-order Butterworth filter, as if they had always been as in the first row.

    It passes half of the frequencies that a log can show.
    """
    sections = scipy.signal.butter(2, 0.5, output="sos")
    settled = scipy.signal.sosfilt_zi(sections)[..., None] * values[0]
    return np.asarray(scipy.signal.sosfilt(sections, values, axis=0, zi=settled)[0])


def even_poses(log: RunLog) -> tuple[Array, Array]:
    """Evenly spaced times (M,) [s] and the valid poses (M, 3), resampled along arcs; raises LogError like `paper`."""
    valid = log.has_heading
    if valid.sum() < _MIN_STEPS:
        raise LogError(f"run {log.run!r}: {int(valid.sum())} valid poses, needs at least {_MIN_STEPS}")
    time, pose = log.time[valid], log.pose[valid]
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
    step = float(np.median(np.diff(log.time)))
    even = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
    k = np.clip(np.searchsorted(time, even, side="right") - 1, 0, len(time) - 2)
    share = (even - time[k]) / (time[k + 1] - time[k])
    return even, se2.compose(pose[k], se2.exp(share[:, None] * se2.log(se2.steps(pose))[k]))
