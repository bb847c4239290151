"""Start values for drives whose poses are far apart, such as those at the start and end of squares.

Between such poses the robot turns by whole circles, so that fits in windows, which follow the slope
of the loss, may end in a wrong minimum. Here the relative motions from pose to pose, each in the
frame of its first pose, are fitted from several starts by a trust-region method, which stays near
the minimum it starts at. Priors keep the parameters small that the motions don't determine.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from trackslip.drives.drive import Drives
from trackslip.identification.path import DriveModel
from trackslip.identification.prediction import Pairs
from trackslip.identification.windows import WindowFit
from trackslip.kinematics import Array

FAR: Final = 10.0
"""Time between poses above which a first look knows no gains of distances and turns [s]."""
OFFSETS: Final = (0.0, 0.3, 0.8)
"""Start values of D, up to those of skid steering [half gauges]."""
_ROUNDS: Final = 3  # number of fits with scales from the residuals of the fit before
_ROUGH: Final = 0.02  # slip that the first fit expects, relative to distances and turns [-]
_AS_GOOD: Final = 1.5  # largest ratio of losses that explain the poses equally well
# least scale of residuals: no tape measure is better [m, m, rad]
_LEAST: Final = np.array([0.001, 0.001, 0.001])


def are_far_apart(drives: Drives) -> bool:
    """True if the poses of all drives are far apart."""
    return all(drive.interval > FAR for drive in drives.drives)


def start_between_far_poses(
    model: DriveModel,
    drives: Drives,
    values: Array,
    held: Collection[str],
    mean: Array,
    offsets: Sequence[float] = (),
) -> Array:
    """Values (p,) of a model's parameters that fit the relative motions between poses.

    `values` (p,) are start values, of which those in `held` don't change; `mean` (p,) are the means
    of the priors. D is tried at `offsets` [half gauges], too, and the fit with the least loss is
    the result.
    """
    pairs = _neighbours(model, drives)
    unit = np.array([1.0, 1.0, 1 / model.geometry.half_gauge])
    rough = np.maximum(_ROUGH * float(np.median(pairs.distance)) * unit, _LEAST)

    # first with the same scales for all starts, so that their losses can be compared
    free = np.array([name not in held for name in model.names])
    starts = [values]
    for offset in offsets:
        start = values.copy()
        start[model.index("offset")] = offset * model.geometry.half_gauge
        starts.append(start)
    fits = [_fitted(model, pairs, start, free, mean, rough) for start in starts]
    best = min(fits, key=lambda fit: fit[0])[1]

    # then with the scatter of the residuals
    for _ in range(_ROUNDS):
        scale = _scatter(model, pairs, best)
        best = _fitted(model, pairs, best, free, mean, scale)[1]
    return best


def other_separations(fit: WindowFit, mean: Array) -> list[float]:
    """Other wheel_separation_multipliers that explain poses far apart as well as a fit does, with
    other numbers of whole turns in between; `mean` (p,) are the means of the priors.
    """
    model = fit.model
    pairs = _neighbours(model, fit.drives)
    scale = _scatter(model, pairs, fit.values)
    free = np.isin(np.arange(len(fit.values)), fit.free)
    offset, half_gauge = model.index("offset"), model.geometry.half_gauge
    loss, best = _fitted(model, pairs, fit.values, free, mean, scale)
    found = list[float]()
    for start in OFFSETS:
        values = fit.values.copy()
        values[offset] = start * half_gauge
        other_loss, other = _fitted(model, pairs, values, free, mean, scale)
        apart = abs(other[offset] - best[offset]) > 0.1 * half_gauge
        if apart and other_loss <= _AS_GOOD * loss + 1.0 and other[offset] > -0.25 * half_gauge:
            found.append(float(1 + other[offset] / half_gauge))
    return found


def _neighbours(model: DriveModel, drives: Drives) -> Pairs:
    """All pairs of neighbouring poses in the same drive."""
    first = np.flatnonzero(np.diff(drives.drive) == 0)
    duration = np.diff(drives.time)[first]
    distance = np.diff(drives.belt_distance(model.geometry.sprocket_radius))[first]
    return Pairs(drives, first, first + 1, duration, distance)


def _scatter(model: DriveModel, pairs: Pairs, values: Array) -> Array:
    """Robust standard deviations (3,) of positions, the same forwards and to the left, and of
    headings, at parameters (p,) [m, m, rad].
    """
    size = np.abs(pairs.errors(model, values[None]))
    scale = 1.4826 * np.nanmedian(size, axis=0)
    scale[:2] = scale[:2].max()
    return np.maximum(scale, _LEAST)


def _fitted(
    model: DriveModel, pairs: Pairs, start: Array, free: np.ndarray, mean: Array, scale: Array
) -> tuple[float, Array]:
    """The least loss near `start` (p,), and the values (p,) of the parameters there.

    Only the parameters `free` (p,) change. `scale` (3,) are the scales of residuals forwards, to
    the left and of headings [m, m, rad].
    """
    low, high, unit = model.limits[:, free]

    def all_values(fitted: Array) -> Array:
        """Values (p,) of all parameters, given those that are fitted."""
        values = start.copy()
        values[free] = fitted
        return values

    def residual(fitted: Array) -> Array:
        values = all_values(fitted)
        missed = np.nan_to_num(pairs.errors(model, values[None]) / scale)
        of_prior = (fitted - mean[free]) / model.prior[free]
        return np.append(missed.ravel(), of_prior)

    begin = np.clip(start[free], low, high)
    result = least_squares(residual, begin, bounds=(low, high), x_scale=unit, loss="soft_l1")
    return float(result.cost), all_values(result.x)
