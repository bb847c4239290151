"""A session as a RunLog: a row for each reading of the encoders and for each scan."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.scan import Cluster, Plate
from trackslip.logs.runlog import RunLog
from trackslip.logs.scanlog import ScanLog
from trackslip.rangefinder.session import Sighting


def scanned_log(
    run: str,
    time: Array,
    omega: Array,
    seen: Sighting,
    plate: Plate,
    mount: Array,
    metadata: dict[str, Any] | None = None,
) -> RunLog:
    """The log of a session, with the ranges from the plate.

    A scan's row has the time at which the beams met the plate, and the sprocket speeds of the next reading, which are
    the mean over the interval that contains it. Poses are the plate's, not the robot's.

    Args:
        run: name of the run.
        time: of the encoders' readings (E,), ascending [s].
        omega: sprocket speeds (E, 2), mean since the previous reading [rad/s].
        seen: the plate in the scans.
        plate: its size.
        mount: pose of the scanner (3,) in the frame of the log [m, m, rad].
        metadata: of the log.
    """
    rows = np.flatnonzero((seen.time > time[0]) & (seen.time <= time[-1]))
    rows = rows[np.append(True, np.diff(np.maximum.accumulate(seen.time[rows])) > 0)]
    union = np.union1d(time, seen.time[rows])
    place = np.searchsorted(union, seen.time[rows])
    scanner = replace(seen.scan, mount=np.asarray(mount, float), background=None, tolerance=None)
    valid = seen.estimate.valid[rows]
    pose, covariance = np.full((len(union), 3), np.nan), np.full((len(union), 3, 3), np.nan)
    at = place[valid]
    pose[at] = scanner.to_world(seen.estimate.pose[rows][valid])
    covariance[at] = scanner.covariance_to_world(seen.estimate.covariance[rows][valid])
    measured = np.zeros(len(union), bool)
    measured[at] = True
    scans = ScanLog(scanner, plate, _spread(seen.cluster, rows, place, len(union)))
    after = np.searchsorted(time, union)
    return RunLog(
        run, union, omega[after], pose, covariance=covariance, valid=measured, scans=scans, metadata=metadata or {}
    )


def _spread(cluster: Cluster, rows: np.ndarray, place: np.ndarray, count: int) -> Cluster:
    """Clusters (count,): the scans `rows` in the rows `place`, and no returns in the others."""
    width = cluster.hit.shape[1]
    bearing, distance = np.zeros((count, width)), np.ones((count, width))
    whole = Cluster(bearing, distance, np.zeros((count, width), bool), *_empty(count))
    whole.put(place, replace(cluster, **{name: values[rows] for name, values in vars(cluster).items()}))
    return whole


def _empty(count: int) -> tuple[np.ndarray, np.ndarray, Array]:
    return np.zeros(count, int), np.zeros(count, int), np.zeros((count, 2))
