"""Start values for drives whose poses are far apart, such as those at the start and end of squares.

Between such poses the robot turns by whole circles, so that fits in windows, which follow the slope
of the loss, may end in a wrong minimum. Here the relative motions from pose to pose, each in the
frame of its first pose, are fitted from several starts by a trust-region method, which stays near
the minimum it starts at. Priors keep the parameters small that the motions don't determine.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from trackslip.identification.path import DriveModel
from trackslip.identification.prediction import Pairs
from trackslip.identification.preparation import Drives
from trackslip.kinematics import Array

FAR: Final = 10.0
"""Time between poses above which a first look knows no gains of distances and turns [s]."""
_OFFSETS: Final = (0.0, 0.3, 0.8)  # start values of D [half gauges], up to skid steering
_ROUNDS: Final = 3  # number of fits with scales from the residuals of the fit before
_ROUGH: Final = 0.02  # slip that the first fit expects, relative to distances and turns [-]
# least scale of residuals: no tape measure is better [m, m, rad]
_LEAST: Final = np.array([0.001, 0.001, 0.001])


def are_far_apart(drives: Drives) -> bool:
    """True if the poses of all drives are far apart, and positions and headings were measured."""
    measured = drives.known.any(axis=1).all()
    return bool(measured) and all(drive.interval > FAR for drive in drives.drives)


def start_between_far_poses(
    model: DriveModel, drives: Drives, values: Array, held: Collection[str], mean: Array
) -> Array:
    """Values (p,) of a model's parameters that fit the relative motions between poses.

    `values` (p,) are start values, of which those in `held` don't change; `mean` (p,) are the means
    of the priors. D is tried at several values, too, and the fit with the least loss is the result.
    """
    first = np.flatnonzero(np.diff(drives.drive) == 0)
    way = np.diff(drives.way(model.geometry.sprocket_radius))[first]
    pairs = Pairs(drives, first, first + 1, np.diff(drives.time)[first], way)
    unit = np.array([1.0, 1.0, 1 / model.geometry.half_gauge])
    rough = np.maximum(_ROUGH * float(np.median(way)) * unit, _LEAST)

    # first with the same scales for all starts, so that their losses can be compared
    free = np.array([name not in held for name in model.names])
    starts = [values]
    offsets = np.array([name.startswith("offset") for name in model.names]) & free
    for offset in _OFFSETS:
        start = values.copy()
        start[offsets] = offset * model.geometry.half_gauge
        starts.append(start)
    fits = [_fitted(model, pairs, start, free, mean, rough) for start in starts]
    best = min(fits, key=lambda fit: fit[0])[1]

    # then with the scatter of the residuals
    for _ in range(_ROUNDS):
        size = np.abs(pairs.errors(model, best[None]))
        scale = 1.4826 * np.nanmedian(size, axis=0)
        scale[:2] = scale[:2].max()
        best = _fitted(model, pairs, best, free, mean, np.maximum(scale, _LEAST))[1]
    return best


def _fitted(
    model: DriveModel, pairs: Pairs, start: Array, free: np.ndarray, mean: Array, scale: Array
) -> tuple[float, Array]:
    """The least loss near `start` (p,), and the values (p,) of the parameters there.

    Only the parameters `free` (p,) change. `scale` (3,) are the scales of residuals forwards, to
    the left and of headings [m, m, rad].
    """
    low, high, unit = model.limits[:, free]

    def whole(fitted: Array) -> Array:
        values = start.copy()
        values[free] = fitted
        return values

    def residual(fitted: Array) -> Array:
        values = whole(fitted)
        missed = np.nan_to_num(pairs.errors(model, values[None]) / scale)
        of_prior = (fitted - mean[free]) / model.prior[free]
        return np.append(missed.ravel(), of_prior)

    begin = np.clip(start[free], low, high)
    result = least_squares(residual, begin, bounds=(low, high), x_scale=unit, loss="soft_l1")
    return float(result.cost), whole(result.x)
