"""Poses over time -> smooth poses and the body twist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from trackslip.errors import LogError
from trackslip.kinematics import Array, advance
from trackslip.runlog import RunLog

CUTOFF = 0.5
"""Normalised cutoff of the paper's Butterworth filter: half of half the sampling rate."""
_SHORTEST = 16  # rows a filter without transients needs
_FASTEST_TURN = 0.15  # from row to row: the filter then shortens a circle by 8e-5 [rad]
_WIDEST_TURN = 2.5  # of a gap that an arc bridges [rad]


@dataclass(frozen=True)
class Motion:
    """Motion of a robot between the rows of its log."""

    time: Array  # (M,) [s]
    pose: Array  # (M, 3) [m, m, rad]
    twist: Array  # (M, 2) [m/s, rad/s]


def butterworth_motion(log: RunLog) -> Motion:
    """The paper's smoothing (Sec. III-B), run forwards and backwards so that it has no delay, then differences.

    The heading and, since the paper doesn't say which low-pass it used, the coordinates too go through a second-order
    Butterworth filter. The speed is the displacement between neighbouring rows projected on the mean heading, not its
    length, which noise makes longer. Rows with no valid pose are bridged by arcs, along which unequal time steps are
    resampled too.

    Raises:
        LogError: for a run with too few valid poses to filter, one that turns too far from row to row, or a gap in
            which it turned too far to bridge.
    """
    valid = log.is_valid
    if valid.sum() < _SHORTEST:
        raise LogError(f"run {log.run!r}: {int(valid.sum())} valid poses, needs at least {_SHORTEST}")
    time = log.time[valid]
    step = float(np.median(np.diff(log.time)))
    even = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
    pose = log.pose[valid]
    turn = np.abs(np.diff(pose[:, 2]))
    if turn.max() > _WIDEST_TURN:
        k = int(np.argmax(turn))
        raise LogError(
            f"run {log.run!r}: turns by {turn[k]:.1f} rad between the valid poses at t = {time[k]:g} s and "
            f"{time[k + 1]:g} s: at most {_WIDEST_TURN:.1f} rad can be bridged"
        )
    per_step = float(np.median(turn))
    if per_step > _FASTEST_TURN:
        raise LogError(
            f"run {log.run!r}: turns by {per_step:.2f} rad from row to row, which the filter would flatten: "
            f"at most {_FASTEST_TURN:g} rad, log it more often"
        )
    if len(even) < _SHORTEST:
        raise LogError(f"run {log.run!r}: {len(even)} even time steps, needs at least {_SHORTEST}")
    smooth = sosfiltfilt(butter(2, CUTOFF, output="sos"), _along_arcs(time, pose, even), axis=0)
    return difference(even, smooth)


def _along_arcs(time: Array, pose: Array, at: Array) -> Array:
    """Poses (M, 3) at times `at` (M,), on the arcs that join neighbouring poses (T, 3) at times (T,)."""
    motion = difference(time, pose)
    k = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    elapsed, whole = at - time[k], time[k + 1] - time[k]
    arc = advance(pose[k], motion.twist[k], elapsed)
    missed = pose[k + 1] - advance(pose[k], motion.twist[k], whole)  # the arc is tangent to the mean heading only
    return arc + (elapsed / whole)[:, None] * missed


def difference(time: Array, pose: Array) -> Motion:
    """Twists between neighbouring poses (T, 3): exact for arcs."""
    duration = np.diff(time)
    dx, dy, turn = np.diff(pose, axis=0).T
    middle = (pose[1:] + pose[:-1]) / 2
    chord = dx * np.cos(middle[:, 2]) + dy * np.sin(middle[:, 2])
    v = chord / np.sinc(turn / (2 * np.pi)) / duration
    return Motion((time[1:] + time[:-1]) / 2, middle, np.stack([v, turn / duration], axis=-1))
