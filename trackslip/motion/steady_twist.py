"""The result of motion methods, covariances of sums of correlated values, and the paper's method:
filtered poses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from trackslip import se2
from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

_MOST: Final = 0.5  # share of valid poses above which a lack of poses is due to too short a window
# indices of v and w, and of u, among the parameters x, y, phi, v, u, w
_TWIST: Final = np.array([3, 5])
_LATERAL: Final = 4
_MAX_CORRELATION: Final = 0.97  # of successive values, above which the number of lags explodes [-]
_MIN_STEPS: Final = 20  # minimum number of steps for a mean twist
# width of the lag window for the error of a mean twist, relative to the number of rows [-]
_LAGS: Final = 0.5
# turn per row at which the filter reduces a circle's radius by 8e-5 [rad]
_MAX_TURN_PER_ROW: Final = 0.15
# most evenly spaced poses for a row of the log: rows may be missing, but not most of them
_MAX_RESAMPLING: Final = 10
_MAX_GAP_TURN: Final = 2.5  # largest turn in a gap that an arc can bridge [rad]


@dataclass(frozen=True)
class SteadyTwist:
    """The mean twist of a steady run, with its covariance."""

    twist: Array  # (2,) [m/s, rad/s]
    covariance: Array  # (2, 2) covariance of the twist's error, accounting for correlation in time
    lateral: float | None = None
    """Speed to the left in the frame of the measured heading [m/s]; None if the method does not
    measure this speed.
    """

    @classmethod
    def of_arc(cls, parameters: Array, covariance: Array) -> SteadyTwist:
        """Build a result from an arc's parameters x, y, phi, v, u, w (6,) and their covariance (6,
        6).
        """
        return cls(
            parameters[_TWIST], covariance[np.ix_(_TWIST, _TWIST)], float(parameters[_LATERAL])
        )


MotionMethod = Callable[[RunLog, tuple[float, float]], SteadyTwist]
"""Function that returns the twist of a run in a steady window [s], or raises LogError if the run is
unsuitable.
"""


def within(time: Array, window: tuple[float, float]) -> np.ndarray:
    """Mask (T,) of the times [s] in the window."""
    return (time > window[0]) & (time < window[1])


def require_poses(usable: np.ndarray, least: int, log: RunLog, window: tuple[float, float]) -> None:
    """Raise LogError, with the reason, if fewer than `least` rows are `usable` (T,)."""
    count = int(usable.sum())
    rows = int(within(log.time, window).sum())
    if count >= least:
        return
    between = f"between {window[0]:.12g} s and {window[1]:.12g} s"
    if count > _MOST * rows:
        raise LogError(
            f"run {log.run!r}: its steady window {between} is short: it has {count} poses, needs "
            f"at least {least}"
        )
    raise LogError(
        f"run {log.run!r}: hardly any valid pose {between}, where it is steady ({count} of {rows})"
    )


def long_run_covariance(series: Array, share: float | None = None) -> Array:
    """Covariance (K, K) of the sum of a zero-mean series (T, K), divided by T, accounting for
    correlation in time.

    The method is that of Newey and West (1987), with a Bartlett window: the covariance at lag l has
    the weight 1 - |l| / (L + 1). The result is computed from sums over L + 1 successive values of
    the series padded with zeros. L is a `share` of the series' length or, by default, the value
    from Andrews (1991) for a first-order autoregression, where the column with the largest L
    decides, up to a quarter of the length.
    """
    rows, width = series.shape
    lags = _lags(series) if share is None else int(share * rows)

    # sums over L + 1 successive values of the padded series, from cumulative sums
    total = np.zeros((rows + 2 * lags + 1, width))
    np.cumsum(series, axis=0, out=total[lags + 1 : lags + 1 + rows])
    total[lags + 1 + rows :] = total[lags + rows]
    sums = total[lags + 1 :] - total[: -lags - 1]
    return np.asarray(sums.T @ sums / ((lags + 1) * rows))


def _lags(series: Array) -> int:
    """The number L of lags for a series (T, K), after Andrews (1991): 1.1447 (a T)^(1/3) with
    a = (2 r / (1 - r²))² and the correlation r of successive values.
    """
    rows = len(series)
    power = np.sum(series**2, axis=0)
    products = np.sum(series[:-1] * series[1:], axis=0)
    correlation = products / np.where(power > 0, power, 1.0)
    correlation = np.clip(correlation, -_MAX_CORRELATION, _MAX_CORRELATION)
    memory = (2 * correlation / (1 - correlation**2)) ** 2
    return int(min(1.1447 * (memory.max() * rows) ** (1 / 3), rows / 4))


def paper(log: RunLog, window: tuple[float, float]) -> SteadyTwist:
    """Compute the mean twist by the paper's method (Sec. III-B): smooth the poses, then divide
    displacements by time.

    The paper does not specify the low-pass filter; here, position and heading are filtered. The
    filter's delay does not matter in a steady turn, but noise lengthens the displacements. Noise in
    the twists cancels in the mean except at the ends, which only a wide lag window accounts for.
    Raises LogError if there are too few valid poses, or the robot turns too far from row to row or
    within a gap.
    """
    time, pose = even_poses(log)
    smooth = low_pass(pose)

    # displacements, negative where the robot drives backwards, and turns
    dx, dy, turn = np.diff(smooth, axis=0).T
    along = se2.log(se2.steps(smooth))[:, 0]
    forwards = np.copysign(np.hypot(dx, dy), along)
    twist = np.stack([forwards, turn], axis=-1) / np.diff(time)[:, None]

    # their mean in the window
    middle = (time[1:] + time[:-1]) / 2
    rows = within(middle, window)
    require_poses(rows, _MIN_STEPS, log, window)
    in_window = twist[rows]
    mean = in_window.mean(axis=0)
    covariance = long_run_covariance(in_window - mean, _LAGS) / rows.sum()
    return SteadyTwist(mean, covariance)


def low_pass(values: Array) -> Array:
    """Filter values (T, k) as if all earlier values had equalled the first row.

    The filter is a second-order Butterworth filter with a cut-off at half the Nyquist frequency.
    """
    sections = scipy.signal.butter(2, 0.5, output="sos")
    settled = scipy.signal.sosfilt_zi(sections)[..., None] * values[0]
    filtered, _ = scipy.signal.sosfilt(sections, values, axis=0, zi=settled)
    return np.asarray(filtered)


def even_poses(log: RunLog) -> tuple[Array, Array]:
    """Evenly spaced times (M,) [s], and the valid poses resampled along arcs (M, 3). Raises
    LogError like `paper`.
    """
    valid = log.has_heading
    if valid.sum() < _MIN_STEPS:
        raise LogError(
            f"run {log.run!r}: {int(valid.sum())} valid poses, needs at least {_MIN_STEPS}"
        )
    time = log.time[valid]
    pose = log.pose[valid]

    # an arc bridges a gap, and the filter flattens a circle, only if the robot turns little there
    turn = np.abs(np.diff(pose[:, 2]))
    if turn.max() > _MAX_GAP_TURN:
        k = int(np.argmax(turn))
        raise LogError(
            f"run {log.run!r}: turns by {turn[k]:.1f} rad between the valid poses at t = "
            f"{time[k]:.12g} s and "
            f"{time[k + 1]:.12g} s: at most {_MAX_GAP_TURN:.1f} rad can be bridged"
        )
    per_step = float(np.median(turn))
    if per_step > _MAX_TURN_PER_ROW:
        raise LogError(
            f"run {log.run!r}: turns by {per_step:.2f} rad from row to row, which the filter "
            "would flatten: "
            f"at most {_MAX_TURN_PER_ROW:g} rad, log it more often"
        )

    # even times
    step = float(np.median(np.diff(log.time)))
    count = int((time[-1] - time[0]) / step + 1e-6) + 1
    if count > _MAX_RESAMPLING * len(log.time):
        raise LogError(
            f"run {log.run!r}: rows are {step:.3g} s apart, but so unevenly that the filter would "
            f"need {count:,} of them"
        )
    even = time[0] + step * np.arange(count)

    # the pose on the arc between the measured poses before and after each of them
    before = np.searchsorted(time, even, side="right") - 1
    before = np.clip(before, 0, len(time) - 2)
    share = (even - time[before]) / (time[before + 1] - time[before])
    arcs = se2.log(se2.steps(pose))[before]
    return even, se2.compose(pose[before], se2.exp(share[:, None] * arcs))
