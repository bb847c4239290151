"""Which part of a run is steady."""

from __future__ import annotations

import numpy as np

from trackslip.errors import LogError
from trackslip.runlog import RunLog

SETTLE = 1.5
"""Default time after the start of a run before which it is not steady [s]."""
MARGIN = 0.5
"""Time at either end of a run that a smoothing filter spoils [s]."""
_DRIFT = 0.05  # change of a sprocket's mean speed from third to third, relative to the faster sprocket


def steady_window(log: RunLog, settle: float = SETTLE) -> tuple[float, float]:
    """Begin and end of the steady part of a run [s].

    Raises:
        LogError: for a run too short, at rest, or whose sprocket speeds are not constant.
    """
    begin, end = log.time[0] + max(settle, MARGIN), log.time[-1] - MARGIN
    rows = (log.time > begin) & (log.time < end)
    if rows.sum() < 3:
        raise LogError(
            f"run {log.run!r}: lasts from {log.time[0]:g} s to {log.time[-1]:g} s, "
            f"too short: its first {begin - log.time[0]:g} s and last {MARGIN:g} s are left out"
        )
    thirds = np.array([part.mean(axis=0) for part in np.array_split(log.omega[rows], 3)])
    fastest = np.abs(thirds).max()
    if fastest == 0:
        raise LogError(f"run {log.run!r}: the sprockets stand still")
    drift = np.ptp(thirds, axis=0).max() / fastest
    if drift > _DRIFT:
        raise LogError(
            f"run {log.run!r}: sprocket speeds change by {drift:.0%} between {begin:g} s and {end:g} s; "
            f"slip is identified from steady runs (at most {_DRIFT:.0%})"
        )
    return float(begin), float(end)
