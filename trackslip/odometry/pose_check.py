"""A check of measured poses: how many jump away and back, and how often they jump lastingly."""

from __future__ import annotations

import numpy as np

from trackslip.identification.outliers import outlying
from trackslip.odometry.trajectory_errors import Trajectory, errors_between

_FAR = 6.0  # error of the step across a lasting jump [median of all steps]


def jumps(drive: Trajectory) -> tuple[int, int]:
    """Number of outlying poses of a drive, and of lasting jumps, as odometry shows them."""
    state = np.column_stack([drive.measured[:, :2], drive.heading])
    bad, lasting = outlying(drive.measured, state, drive.estimated)
    row = np.arange(len(drive.time))
    usual = errors_between(drive, row[:-1], row[1:]).position
    after = np.flatnonzero(lasting)
    across = errors_between(drive, after - 1, after).position
    return int(bad.sum()), int((across > _FAR * np.median(usual)).sum()) if len(usual) else 0
