"""How well a law predicts other drives by dead reckoning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.driving.plan import Driven
from trackslip.identification.drive.drives import drive_of
from trackslip.identification.drive.estimate import DriveFit
from trackslip.identification.drive.reckoning import rotated
from trackslip.kinematics import Array, wrap_angle
from trackslip.metrics import rms
from trackslip.planning.information import with_extras
from trackslip.planning.strokes import RATE

_HORIZON = 5.0  # of predictions [s]
_EVERY = 0.5  # between those [s]


def ahead(fit: DriveFit, others: Sequence[Driven]) -> tuple[float, float]:
    """Root mean square errors of the position [m] and heading [rad] of drives, predicted 5 s ahead by the law alone."""
    values = with_extras(fit.fit.values[: len(fit.values)])
    missed = []
    for other in others:
        drive = drive_of(other.log)
        path, real = fit.fit.model.sensor_path(values, drive), drive.pose
        start = np.arange(0, len(real) - round(_HORIZON * RATE), round(_EVERY * RATE))
        end = start + round(_HORIZON * RATE)
        wrong = _moved(path, start, end) - _moved(real, start, end)
        missed.append(np.column_stack([wrong[:, :2], wrap_angle(wrong[:, 2])]))
    every = np.concatenate(missed)
    return rms(np.hypot(every[:, 0], every[:, 1])), rms(every[:, 2])


def _moved(pose: Array, start: np.ndarray, end: np.ndarray) -> Array:
    """Motion (n, 3) between poses, in the frame of the first."""
    way = rotated(-pose[start, 2], pose[end, :2] - pose[start, :2])
    return np.column_stack([way, pose[end, 2] - pose[start, 2]])
