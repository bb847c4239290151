"""The measured motion, smoothed for the eye: local polynomials after Savitzky and Golay."""

from __future__ import annotations

import numpy as np
import scipy

from trackslip.logs.runlog import RunLog
from trackslip.motion.base import Motion
from trackslip.motion.filtered import even_poses

_DEGREE = 4  # of the polynomials
_MAX_WINDOW = 3.0  # [s]
_MAX_TURN = 0.5  # within a window, so that the polynomials follow the circle [rad]


def smooth_motion(log: RunLog) -> Motion:
    """Poses and twists at even times from polynomials fitted to a sliding window.

    Raises:
        LogError: if `even_poses` cannot resample the run.
    """
    time, pose = even_poses(log)
    step = float(time[1] - time[0])
    rate = abs(pose[-1, 2] - pose[0, 2]) / (time[-1] - time[0])
    rows = int(min(_MAX_WINDOW, _MAX_TURN / max(rate, 1e-9)) / step)
    window = int(np.clip(rows, _DEGREE + 3, len(time) - 1)) // 2 * 2 - 1
    smooth, slope = (
        scipy.signal.savgol_filter(pose, window, _DEGREE, deriv=order, delta=step, axis=0) for order in (0, 1)
    )
    v = slope[:, 0] * np.cos(smooth[:, 2]) + slope[:, 1] * np.sin(smooth[:, 2])
    return Motion(time, smooth, np.stack([v, slope[:, 2]], axis=-1))
