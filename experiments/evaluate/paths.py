"""Measured and predicted paths as files: for evo, and side by side for the rerun viewer."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.common.results import RECORDINGS_FOLDER, TRAJECTORIES_FOLDER, file_names
from experiments.evaluate.log import Log
from experiments.evaluate.prediction import Prediction
from experiments.recorder import record
from trackslip.logs.runlog import RunLog
from trackslip.odometry.trajectory_errors import Trajectory
from trackslip.odometry.tum import write_tum

_MOST = 20  # drives


def write_trajectories(found: Sequence[Prediction], folder: Path) -> None:
    """Write a file for each drive and model, and one for the measured poses."""
    (folder / TRAJECTORIES_FOLDER).mkdir()
    drives = found[0].errors.trajectories[:_MOST]
    labels = file_names([one.label for one in found])
    for drive, name in zip(drives, file_names([drive.name for drive in drives]), strict=True):
        write_tum(folder / TRAJECTORIES_FOLDER / f"{name}_measured.tum", drive.time, drive.measured)
        for one, label in zip(found, labels, strict=True):
            path = one.drive(drive.name)
            write_tum(folder / TRAJECTORIES_FOLDER / f"{name}_{label}.tum", path.time, path.placed)


def record_paths(found: Sequence[Prediction], log: Log, folder: Path) -> None:
    """Record each drive, as measured and as each model predicts it."""
    logs = {one.run: replace(one, run="measured", truth=None, scans=None) for one in log.logs}
    drives = found[0].errors.trajectories[:_MOST]
    for drive, name in zip(drives, file_names([drive.name for drive in drives], ".rrd"), strict=True):
        measured = logs[drive.name]
        predicted = [_as_log(measured, one.drive(drive.name), one.label) for one in found]
        record(folder / RECORDINGS_FOLDER / name, [measured, *predicted])


def _as_log(measured: RunLog, path: Trajectory, label: str) -> RunLog:
    """A log with the predicted poses in place of those measured."""
    valid = np.isin(measured.time, path.time)
    pose = np.full(measured.pose.shape, np.nan)
    pose[valid] = path.placed
    return replace(measured, run=label, pose=pose, valid=valid, covariance=None)
