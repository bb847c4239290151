"""A log with every optional field."""

from __future__ import annotations

import numpy as np

from trackslip.localization.scan import Cluster, Plate, Scan
from trackslip.logs.runlog import RunLog, ScanLog, Truth

ROWS, BEAMS = 40, 31
MOUNT = np.array([-1.0, 2.0, 0.3])
"""Of the scanner."""


def full_log():
    """A log with every optional field, uneven times and full-precision numbers."""
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.02, 0.08, ROWS))
    root = rng.normal(0, 0.1, (ROWS, 3, 3))
    ranges = rng.uniform(1, 5, (ROWS, BEAMS)).astype(np.float32)
    ranges[:, ::4] = np.nan
    scan = Scan(np.linspace(-1.5, 1.5, BEAMS), np.empty((0, BEAMS)), 0.005, MOUNT, 20.0)
    none, zero = np.zeros(0), np.zeros(ROWS, int)
    cluster = Cluster(none, none, zero, zero, np.zeros((ROWS, 2)))
    return RunLog(
        run="a run",
        time=time,
        omega=rng.normal(0, 3, (ROWS, 2)),
        pose=rng.normal(0, 2, (ROWS, 3)),
        command=rng.normal(0, 3, (ROWS, 2)),
        covariance=root @ root.swapaxes(1, 2),
        valid=rng.random(ROWS) < 0.7,
        truth=Truth(rng.normal(0, 2, (ROWS, 3)), rng.normal(0, 1, (ROWS, 3))),
        scans=ScanLog(scan, Plate(), cluster, ranges),
    )
