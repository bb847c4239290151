"""`trackslip evaluate`: measure how well slip laws and simulated robots predict a log."""

import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

import numpy as np

from experiments.calibrate.calibration import fit_summary
from experiments.common.manifest import command_line, origin
from experiments.common.plain_json import plain
from experiments.common.results import (
    RECORDINGS_FOLDER,
    REPORT_FILE,
    TRAJECTORIES_FOLDER,
    file_names,
)
from experiments.common.run import Run
from experiments.evaluate.config import Config
from experiments.evaluate.data_set import load_data_set
from experiments.evaluate.log import parts, read_log
from experiments.evaluate.models import known_geometry, models_of, notes_on_motors, robots_of
from experiments.evaluate.page import Report
from experiments.evaluate.prediction import Prediction, predict
from experiments.recorder import record
from trackslip.errors import require
from trackslip.identification.source import Source
from trackslip.logs.runlog import RunLog
from trackslip.odometry.evaluation import write_tum

_MOST_PATHS: Final = 20  # largest number of drives whose paths are written


def run(config: Config) -> None:
    """Predict a log, and compare, store and report; exits with 1 if a bound in a data set is
    exceeded.
    """
    given = config
    data = None
    if config.path.suffix == ".toml":
        data = load_data_set(config.path)
        config = data.options(config)
    known = known_geometry(config)
    with Run(given) as run, run.progress("evaluation", 2, "stages") as step:
        log = read_log(config, known)
        if log.rows is not None:
            allowed = f"left out: {log.name} holds steady samples, which have no clock"
            require(config.clock_offset is None, "clock_offset", config.clock_offset, allowed)
            config = replace(config, clock_offset=0.0)
        for line in log.taken:
            print(line)
        part = parts(log.logs, config.folds or 1, log.name)
        with run.watch.stage("fits"):
            robots, fit = robots_of(config, log, part)
            models = [models_of(config, log, part, k, robots) for k in range(config.folds or 1)]
        step(1.0)
        with run.watch.stage("predictions"):
            predictions = predict(log.logs, part, models)
        step(1.0)
        # windows of folds are short
        notes = [*log.notes, *(() if config.folds else predictions[0].errors.notes)]
        notes += notes_on_motors(config)
        checks = data.checks(predictions) if data else []
        title = data.title if data else f"Predictions of “{config.path.resolve().name}”"
        report = Report(
            title, f"{data.source}; {data.licence}" if data else "", predictions, checks, fit, notes
        )
        manifest = run.manifest(**origin(log.logs), **({"data_set": plain(data)} if data else {}))
        summary = {
            "geometry": asdict(log.geometry),
            "models": {prediction.model.label: prediction.summary for prediction in predictions},
            "checks": [check.to_json() for check in checks],
            "calibrated": fit_summary(fit) if fit else {},
            "warnings": notes,
        }
        run.write(summary, manifest=manifest)
        _write_paths(predictions, log, run.folder, config.rrd)
        report.page(manifest, command_line("evaluate")).write(run.folder, config.pdf)
    report.print()
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")
    if not all(check.holds for check in checks):
        sys.exit(1)


def _write_paths(predictions: Sequence[Prediction], log: Source, folder: Path, rrd: bool) -> None:
    """Write measured and predicted paths of the first drives for evo and, with `rrd`, for the rerun
    viewer.
    """
    drives = predictions[0].errors.trajectories[:_MOST_PATHS]
    labels = file_names([prediction.model.label for prediction in predictions])
    trajectories = folder / TRAJECTORIES_FOLDER
    logs = {drive.run: drive for drive in log.logs}
    trajectories.mkdir()
    for drive, file in zip(drives, file_names([drive.name for drive in drives]), strict=True):
        write_tum(trajectories / f"{file}_measured.tum", drive.time, drive.measured)
        measured = replace(
            logs[drive.name], run="measured", truth=None, scans=None, covariance=None
        )
        recorded = [measured]
        for prediction, label in zip(predictions, labels, strict=True):
            path = prediction.drive(drive.name)
            write_tum(trajectories / f"{file}_{label}.tum", path.time, path.placed)
            omega = measured.omega[np.searchsorted(measured.time[:-1], path.time)]
            known = RunLog(
                prediction.model.label, path.time, omega, path.placed, metadata=measured.metadata
            )
            recorded.append(known)
        if rrd:
            record(folder / RECORDINGS_FOLDER / f"{file}.rrd", recorded)
