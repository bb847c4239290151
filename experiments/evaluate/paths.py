"""Measured and predicted paths as files: for evo, and side by side for the rerun viewer."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.common.results import RECORDINGS_FOLDER, TRAJECTORIES_FOLDER, file_names
from experiments.evaluate.log import Log
from experiments.evaluate.prediction import Prediction
from experiments.recorder import record
from trackslip.odometry.tum import write_tum

_MOST = 20  # drives


def write_paths(found: Sequence[Prediction], log: Log, folder: Path, tum: bool, rrd: bool) -> None:
    """Write the paths of the first drives: with `tum` a file for each model, with `rrd` a recording of all models."""
    drives = found[0].errors.trajectories[:_MOST]
    labels = file_names([one.label for one in found])
    trajectories = folder / TRAJECTORIES_FOLDER
    if tum:
        trajectories.mkdir()
    logs = {one.run: one for one in log.logs}
    for drive, file in zip(drives, file_names([drive.name for drive in drives]), strict=True):
        if tum:
            write_tum(trajectories / f"{file}_measured.tum", drive.time, drive.measured)
        recorded = [replace(logs[drive.name], run="measured", truth=None, scans=None, covariance=None)]
        for one, label in zip(found, labels, strict=True):
            path = one.drive(drive.name)
            if tum:
                write_tum(trajectories / f"{file}_{label}.tum", path.time, path.placed)
            valid = np.isin(recorded[0].time, path.time)
            pose = np.full(recorded[0].pose.shape, np.nan)
            pose[valid] = path.placed
            recorded.append(replace(recorded[0], run=one.label, pose=pose, valid=valid))
        if rrd:
            record(folder / RECORDINGS_FOLDER / f"{file}.rrd", recorded)
