"""A log with everything that a log can hold."""

import numpy as np

from trackslip.localization.scan import Cluster, Plate, Scan
from trackslip.logs.runlog import RunLog, ScanLog, Truth

ROWS = 40
BEAMS = 31
MOUNT = np.array([-1.0, 2.0, 0.3])
"""Of the scanner."""


def full_log():
    """Every optional field, uneven times and full-precision numbers; a beam of each scan is the
    plate's.
    """
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.02, 0.08, ROWS))
    root = rng.normal(0, 0.1, (ROWS, 3, 3))
    two = rng.normal(0, 3, (ROWS, 2))
    three = rng.normal(0, 2, (ROWS, 3))
    ranges = rng.uniform(1, 5, (ROWS, BEAMS)).astype(np.float32)
    ranges[:, ::4] = np.nan
    bearings = np.linspace(-1.5, 1.5, BEAMS)
    scan = Scan(bearings, np.empty((0, BEAMS)), noise=0.005, mount=MOUNT, max_range=20.0)
    cluster = Cluster(
        bearing=np.full(ROWS, bearings[1]),
        range=ranges[:, 1],
        count=np.ones(ROWS, int),
        lost=np.zeros(ROWS, int),
        hidden=np.zeros((ROWS, 2)),
    )
    scans = ScanLog(scan, Plate(), cluster, ranges)
    covariance = root @ root.swapaxes(1, 2)
    valid = rng.random(ROWS) < 0.7
    metadata = {"seed": 1, "geometry": {"half_gauge": 0.168}}
    truth = Truth(
        pose=three + 1,
        twist=three,
        traction=two,
        torque=two,
        power=two,
        saturated=two,
        sinkage=two,
        resistance=two,
        lean=three[:, 0],
        contact=np.ones((ROWS, 20, 3)),
        shear=np.ones((ROWS, 20)),
    )
    return RunLog(
        run="a",
        time=time,
        omega=two,
        pose=three,
        command=two + 1,
        twist_command=two + 2,
        icr=two + 3,
        covariance=covariance,
        valid=valid,
        load=two + 4,
        truth=truth,
        scans=scans,
        metadata=metadata,
    )
