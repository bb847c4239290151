"""Results of motion methods, and the covariance of means of correlated series."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

_MOST = 0.5  # share of valid poses that is no lack of them
_TWIST, _LATERAL = np.array([3, 5]), 4  # indices of v and w, and of u, among the parameters x, y, phi, v, u, w


@dataclass(frozen=True)
class SteadyTwist:
    """The mean twist of a steady run."""

    twist: Array  # (2,) [m/s, rad/s]
    covariance: Array  # (2, 2) of its error, accounting for correlation in time
    lateral: float | None = None
    """Speed to the left in the frame of the measured heading [m/s]; None if the method does not measure it."""

    @classmethod
    def of_arc(cls, parameters: Array, covariance: Array) -> SteadyTwist:
        """From the parameters x, y, phi, v, u, w (6,) of an arc and their covariance (6, 6)."""
        return cls(parameters[_TWIST], covariance[np.ix_(_TWIST, _TWIST)], float(parameters[_LATERAL]))


MotionMethod = Callable[[RunLog, tuple[float, float]], SteadyTwist]
"""From a run and its steady window [s] to its twist; raises LogError for a run that it cannot be applied to."""


def within(time: Array, window: tuple[float, float]) -> np.ndarray:
    """(T,) bool: the times [s] in a window."""
    return (time > window[0]) & (time < window[1])


def require_poses(usable: np.ndarray, least: int, log: RunLog, window: tuple[float, float]) -> None:
    """Raise LogError if fewer than `least` rows of (T,) bool are usable; it says whether poses lack or time."""
    count, rows = int(usable.sum()), int(within(log.time, window).sum())
    if count >= least:
        return
    between = f"between {window[0]:.12g} s and {window[1]:.12g} s"
    if count > _MOST * rows:
        raise LogError(
            f"run {log.run!r}: its steady window {between} is short: it has {count} poses, needs at least {least}"
        )
    raise LogError(f"run {log.run!r}: hardly any valid pose {between}, where it is steady ({count} of {rows})")


def long_run_covariance(series: Array, share: float | None = None) -> Array:
    """Covariance (K, K) of the sum of a series (T, K) of mean zero, over T, accounting for correlation in time.

    Uses a Bartlett window, after Newey and West (1987): the covariance at a lag l has the weight 1 - |l| / (L + 1),
    which is the mean square of the sums of any L + 1 successive values, with zeros before and after the series, over
    L + 1. L is a `share` of the series or, by default, Andrews' (1991) for a first-order autoregression: the largest of
    the K, at most a quarter of the series.
    """
    rows, width = series.shape
    if share is None:
        power = np.sum(series**2, axis=0)
        memory = np.clip(np.sum(series[:-1] * series[1:], axis=0) / np.where(power > 0, power, 1.0), -0.97, 0.97)
        spread = (2 * memory / (1 - memory**2)) ** 2
        lags = int(min(1.1447 * (spread.max() * rows) ** (1 / 3), rows / 4))
    else:
        lags = int(share * rows)
    total = np.zeros((rows + 2 * lags + 1, width))
    np.cumsum(series, axis=0, out=total[lags + 1 : lags + 1 + rows])
    total[lags + 1 + rows :] = total[lags + rows]
    sums = total[lags + 1 :] - total[: -lags - 1]
    return np.asarray(sums.T @ sums / ((lags + 1) * rows))
