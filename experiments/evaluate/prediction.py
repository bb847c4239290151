"""The prediction errors of several models on the same log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from experiments.evaluate.models import Model
from trackslip.errors import LogError
from trackslip.identification.prediction import PredictionErrors
from trackslip.logs.runlog import RunLog
from trackslip.odometry.evaluation import LENGTHS, OdometryErrors, Trajectory, errors_of

AHEAD: Final = (*((length, "s") for length in LENGTHS), (10.0, "m"))
"""Times [s] and distances [m] ahead; models are compared at the last entry that all models
reach.
"""
_MIN_PAIRS: Final = 10  # number of pairs of poses needed for a median and a 90 % quantile
_MARGIN: Final = 1e-3  # time added at both ends, so that times ascend [s]


@dataclass(frozen=True)
class Prediction:
    """A model's predictions for a log, and their errors."""

    model: Model
    """The model of the log's first part; models of the other parts have the same label and name."""
    errors: OdometryErrors

    def ahead(self, length: float, unit: str) -> PredictionErrors | None:
        """Errors after a distance [m] or a time [s]; None if there are too few pairs of poses."""
        by_length = self.errors.after_metres if unit == "m" else self.errors.after_seconds
        errors = by_length.get(length)
        if errors is None or errors.count < _MIN_PAIRS:
            return None
        return errors

    def drive(self, name: str) -> Trajectory:
        """Measured and predicted poses of a drive."""
        return next(drive for drive in self.errors.trajectories if drive.name == name)

    @property
    def summary(self) -> dict[str, Any]:
        """The prediction as an entry in summary.json."""
        errors = self.errors
        model = self.model
        return {
            "law": model.name,
            "sensor": model.sensor,
            "clock_offset": model.clock_offset,
            "after_metres": _by_text(errors.after_metres),
            "after_seconds": _by_text(errors.after_seconds),
        }


def _by_text(errors: Mapping[float, PredictionErrors]) -> dict[str, PredictionErrors]:
    """Errors by length, as text for JSON."""
    return {f"{length:g}": ahead for length, ahead in errors.items()}


def predict(
    drives: Sequence[RunLog], part: np.ndarray, models: Sequence[Sequence[Model]]
) -> list[Prediction]:
    """Predict each drive by the models for its `part` (n,) of the log; all models predict the same
    poses.

    Without folds, these are the poses at which encoders were read according to every model's clock
    offset. With folds, where windows may be short, encoders continue at their last speeds. Raises
    LogError if there are no such poses.
    """
    # for each part, its drives with the poses to predict, and with encoders as read
    compared: list[tuple[list[RunLog], list[RunLog]]] = []
    notes: list[str] = []
    for k, models_of_part in enumerate(models):
        read = [drive for drive, label in zip(drives, part, strict=True) if label == k]
        clocks = [model.clock_offset for model in models_of_part]
        if len(models) > 1:
            compared.append(([_continued(drive, clocks) for drive in read], read))
            continue
        covered = [_covered(drive, clocks) for drive in read]
        known = [drive for drive in covered if drive.is_valid.sum() > 1]
        short = [drive.run for drive in covered if drive.is_valid.sum() <= 1]
        notes = [f"run {run!r}: encoders were read at less than two of its poses" for run in short]
        compared.append((known, known))

    # one prediction per model, over all parts
    predictions = []
    for same in zip(*models, strict=True):
        trajectories: list[Trajectory] = []
        for model, (seen, read) in zip(same, compared, strict=True):
            if seen:
                trajectories += model.trajectories(seen, read)
        predictions.append(Prediction(same[0], errors_of(trajectories, notes)))
    return predictions


def _covered(log: RunLog, clocks: Sequence[float]) -> RunLog:
    """The log with only the poses that encoders cover at all clock offsets `clocks`, encoder minus
    pose clock [s].
    """
    after_begin = log.time + min(clocks) >= log.time[0]
    before_end = log.time + max(clocks) <= log.time[-1]
    return replace(log, valid=log.is_valid & after_begin & before_end)


def _continued(log: RunLog, clocks: Sequence[float]) -> RunLog:
    """The log with encoders continued at their first and last speeds, to cover all poses at all
    clock offsets.
    """
    last = len(log.time) - 1
    rows = np.array([0, *range(last + 1), last])  # the first and the last row twice
    time = log.time[rows]
    time[0] += min(-_MARGIN, *clocks)
    time[-1] += max(_MARGIN, *clocks)
    valid = log.is_valid[rows]
    valid[[0, -1]] = False  # the added rows have no poses
    return RunLog(
        log.run, time, log.omega[rows], log.pose[rows], valid=valid, read=log.is_read[rows]
    )


def winner(predictions: Sequence[Prediction]) -> tuple[Prediction, float, str]:
    """The prediction with the smallest median position error, and the compared time or distance
    ahead with its unit. Without positions, headings are compared.
    """
    for what in ("position", "heading"):
        for length, unit in reversed(AHEAD):
            errors = [prediction.ahead(length, unit) for prediction in predictions]
            parts = [getattr(each, what) for each in errors if each is not None]
            medians = [part.median for part in parts if part is not None]
            if len(medians) == len(predictions):
                return predictions[int(np.argmin(medians))], length, unit
    raise LogError(
        f"fewer than {_MIN_PAIRS} pairs of poses are {LENGTHS[0]:g} s apart: too few to compare "
        "models"
    )
