"""Groups of repeated runs: of the same radius or speed, and folds of a cross-validation."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array, RobotGeometry, body_twist

_TOLERANCE = 0.02  # maximum relative difference of the commands (curvatures or speeds) of repeated runs
_MIN_ANGLE = 0.1  # angle of a command below which the tolerance no longer shrinks with it [rad]
_MIN_SPEED = 0.05  # likewise of the speed, relative to the fastest run
_WIDEST = 5.0  # width of a group of commands, in tolerances, above which they are no repeats but a range
_FOLDS = 10  # maximum number of folds of a cross-validation


def group_labels(values: Array, least: float) -> np.ndarray:
    """Group labels (n,) of values (n,), separated by gaps in their order that exceed the tolerance.

    The tolerance is relative for values beyond `least`, and no smaller for the others. Values that range evenly,
    without gaps, are cut into groups as wide as the tolerance.
    """
    size = np.abs(values) / least
    place = np.sign(values) * np.where(size < 1, size, 1 + np.log(np.maximum(size, 1))) / _TOLERANCE  # in tolerances
    order = np.argsort(place, kind="stable")
    ranked = place[order]
    first = np.concatenate([[True], np.diff(ranked) > 1])
    cluster = np.cumsum(first) - 1
    since = ranked - ranked[first][cluster]
    width = np.maximum.reduceat(since, np.flatnonzero(first))[cluster]
    piece = np.where(width > _WIDEST, np.floor(since), 0.0)
    new = first | (np.diff(piece, prepend=piece[:1]) != 0)
    labels = np.empty(len(values), int)
    labels[order] = np.cumsum(new) - 1
    return labels


def by_command(omega: Array, geometry: RobotGeometry) -> np.ndarray:
    """Labels (n,) of runs with the same ratio of sprocket speeds (n, 2) and thus the same radius."""
    ideal = body_twist(omega, 0.0, geometry)
    return group_labels(np.arctan2(geometry.half_gauge * ideal[:, 1], ideal[:, 0]), _MIN_ANGLE)


def by_speed(omega: Array) -> np.ndarray:
    """Labels (n,) of runs with the same speed of the faster sprocket (n, 2)."""
    speed = np.abs(omega).max(axis=1)
    return group_labels(speed, _MIN_SPEED * float(speed.max()))


def folds(labels: np.ndarray) -> np.ndarray:
    """Folds (n,) of a cross-validation: groups (n,) or, where there are many, about equal numbers of neighbours."""
    size = np.bincount(labels)
    if len(size) <= _FOLDS:
        return labels
    fold = (np.cumsum(size) - size) * _FOLDS // len(labels)
    return np.unique(fold[labels], return_inverse=True)[1]
