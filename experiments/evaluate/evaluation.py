"""The evaluation of one log: its models, their predictions, and what is stored of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.calibrate.calibration import fit_summary
from experiments.common.check import Check
from experiments.common.results import RECORDINGS_FOLDER, TRAJECTORIES_FOLDER, file_names
from experiments.evaluate.config import Config
from experiments.evaluate.log import parts, read_log
from experiments.evaluate.models import models_of, notes_on_motors, robots_of
from experiments.evaluate.prediction import Prediction, predict
from experiments.recorder import record
from sim.calibration.calibration import Calibration
from sim.runs.stopwatch import Stopwatch
from trackslip.errors import require
from trackslip.identification.source import Source
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.odometry.evaluation import write_tum

_MOST_PATHS: Final = 20  # largest number of drives whose paths are written


@dataclass(frozen=True)
class Evaluation:
    """Predictions of one log by several models."""

    log: Source
    predictions: Sequence[Prediction]
    fit: Calibration | None
    """The fit of the calibrated robot."""
    notes: Sequence[str]

    def summary(self, checks: Sequence[Check] = ()) -> Mapping[str, Any]:
        """The content of summary.json, with checks of bounds."""
        return {
            "geometry": asdict(self.log.geometry),
            "models": {each.model.label: each.summary for each in self.predictions},
            "checks": [check.to_json() for check in checks],
            "calibrated": fit_summary(self.fit) if self.fit else {},
            "warnings": self.notes,
        }

    def write_paths(self, folder: Path, rrd: bool) -> None:
        """Write measured and predicted paths of the first drives for evo and, with `rrd`, for the
        rerun viewer.
        """
        drives = self.predictions[0].errors.trajectories[:_MOST_PATHS]
        labels = file_names([prediction.model.label for prediction in self.predictions])
        trajectories = folder / TRAJECTORIES_FOLDER
        logs = {drive.run: drive for drive in self.log.logs}
        trajectories.mkdir()
        for drive, file in zip(drives, file_names([drive.name for drive in drives]), strict=True):
            write_tum(trajectories / f"{file}_measured.tum", drive.time, drive.measured)
            measured = replace(
                logs[drive.name], run="measured", truth=None, scans=None, covariance=None
            )
            recorded = [measured]
            for prediction, label in zip(self.predictions, labels, strict=True):
                path = prediction.drive(drive.name)
                write_tum(trajectories / f"{file}_{label}.tum", path.time, path.placed)
                omega = measured.omega[np.searchsorted(measured.time[:-1], path.time)]
                known = RunLog(
                    prediction.model.label,
                    path.time,
                    omega,
                    path.placed,
                    metadata=measured.metadata,
                )
                recorded.append(known)
            if rrd:
                record(folder / RECORDINGS_FOLDER / f"{file}.rrd", recorded)


def evaluated(
    config: Config,
    log: Path,
    known: RobotGeometry | None,
    watch: Stopwatch,
    step: Callable[[float], None],
) -> Evaluation:
    """Predict a `log` by the models of the options; `step(1.0)` is called after fits, and after
    predictions.
    """
    source = read_log(config, log, known)
    if source.rows is not None:
        allowed = f"left out: {source.name} holds steady samples, which have no clock"
        require(config.clock_offset is None, "clock_offset", config.clock_offset, allowed)
        config = replace(config, clock_offset=0.0)
    for line in source.taken:
        print(line)
    part = parts(source.logs, config.folds or 1, source.name)
    with watch.stage("fits"):
        robots, fit = robots_of(config, source, part)
        models = [models_of(config, source, part, k, robots) for k in range(config.folds or 1)]
    step(1.0)
    with watch.stage("predictions"):
        predictions = predict(source.logs, part, models)
    step(1.0)
    # windows of folds are short
    notes = [*source.notes, *(() if config.folds else predictions[0].errors.notes)]
    notes += notes_on_motors(config)
    return Evaluation(source, predictions, fit, notes)
