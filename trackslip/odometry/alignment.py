"""Trajectories moved as a whole onto measured ones."""

from __future__ import annotations

import numpy as np

from trackslip.se2 import Array, rotate


def moved(pose: Array, turn: float, pivot: Array, target: Array) -> Array:
    """Poses (K, 3) turned by `turn` [rad] about the point `pivot` (2,), which gets to `target` (2,)."""
    return np.column_stack([target + rotate(turn, pose[:, :2] - pivot), pose[:, 2] + turn])


def best_fit(pose: Array, measured: Array) -> Array:
    """Poses (K, 3) moved so that their positions are closest to those measured (K, 3), in least squares.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns" (1991), without scale.
    """
    centre, target = pose[:, :2].mean(axis=0), measured[:, :2].mean(axis=0)
    here, there = pose[:, :2] - centre, measured[:, :2] - target
    along = float(np.sum(here * there))
    across = float(np.sum(here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]))
    return moved(pose, float(np.arctan2(across, along)), centre, target)


def from_pose(pose: Array, measured: Array, row: int = 0) -> Array:
    """Poses (K, 3) moved so that one of them is as measured (K, 3), with its heading."""
    return moved(pose, float(measured[row, 2] - pose[row, 2]), pose[row, :2], measured[row, :2])
