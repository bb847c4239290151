"""Groups of repeated runs, and the test for lack of fit that they allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trackslip.identification.steady_fit import Fits
from trackslip.kinematics import Array, RobotGeometry, body_twist

_TOLERANCE = 0.02  # maximum relative difference of the commands (curvatures or speeds) of repeated runs
_MIN_ANGLE = 0.1  # angle of a command below which the tolerance no longer shrinks with it [rad]
_MIN_SPEED = 0.05  # likewise of the speed, relative to the fastest run
_MIN_LOAD = 0.05  # likewise of the traction per unit load [-]
_WIDEST = 5.0  # width of a group of commands, in tolerances, above which they are no repeats but a range
_FOLDS = 10  # maximum number of folds of a cross-validation
SIGNIFICANT = 0.01  # significance level of lack of fit [-]


@dataclass(frozen=True)
class LackOfFit:
    """Test of whether a law misses the runs by more than their scatter or their measurement errors."""

    test: str
    """F: relative to the scatter of repeated runs; chi2: relative to the measurement errors."""
    statistic: float
    """The test statistic [-]."""
    freedom: tuple[int, ...]
    """Degrees of freedom of the statistic."""
    probability: float
    """Probability of at least this statistic by chance, the p-value [-]."""
    inflation: float
    """Typical factor on standard errors, because repeated runs share the errors of the law, which are therefore fewer
    than the runs; 1 if the law fits [-]."""
    factors: tuple[float, ...]
    """This factor for each parameter: the deviations of the groups of runs from the law are a random effect [-]."""


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


def by_equal_command(omega: Array, geometry: RobotGeometry) -> np.ndarray:
    """Labels (n,) of runs with the same sprocket speeds (n, 2)."""
    pairs = np.column_stack([by_command(omega, geometry), by_speed(omega)])
    return np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)


def by_load(labels: np.ndarray, load: Array | None) -> np.ndarray:
    """The groups (n,) of runs, divided by the tractions per unit load (n, 2) where these are known."""
    if load is None:
        return labels
    divided = np.column_stack([labels, *(group_labels(component, _MIN_LOAD) for component in load.T)])
    return np.unique(divided, axis=0, return_inverse=True)[1].reshape(-1)


def folds(labels: np.ndarray) -> np.ndarray:
    """Folds (n,) of a cross-validation: groups (n,) or, where there are many, about equal numbers of neighbours."""
    size = np.bincount(labels)
    if len(size) <= _FOLDS:
        return labels
    fold = (np.cumsum(size) - size) * _FOLDS // len(labels)
    return np.unique(fold[labels], return_inverse=True)[1]


def lack_of_fit(fits: Fits, measured: bool) -> list[LackOfFit] | None:
    """Tests for lack of fit of M sets of runs; None if there is nothing to compare the law with.

    With repeated runs: the F-test of the misfit of the law relative to the scatter of the repeats about their own mean
    deviation from the law, with the weights of the fit. Repeats have the same radius or, where these scatter less, the
    same command. Otherwise, if the measurement errors are known (`measured`), the chi-square test of whether they
    explain the residuals.
    """
    runs = fits.runs
    same_radius, same_speeds = by_command(runs.omega, runs.geometry), by_equal_command(runs.omega, runs.geometry)
    groupings = by_load(same_radius, runs.load), by_load(same_speeds, runs.load)
    tests = [test for labels in groupings if (test := _by_repeats(fits, labels)) is not None]
    if tests:
        return [max(of_set, key=lambda test: test.inflation) for of_set in zip(*tests, strict=True)]
    freedom = fits.freedom
    if not measured or freedom < 1:
        return None
    squares = np.sum(runs.whiten(fits.deviation, np.zeros(len(fits.values))) ** 2, axis=1)
    chance = scipy.special.chdtrc(freedom, squares)
    none = (1.0,) * fits.values.shape[1]
    return [
        LackOfFit("chi2", c, (freedom,), p, 1.0, none) for c, p in zip(squares.tolist(), chance.tolist(), strict=True)
    ]


def _by_repeats(fits: Fits, labels: np.ndarray) -> list[LackOfFit] | None:
    """The F-tests for M sets of runs in groups (n,); None without repeats or more groups than the law can follow."""
    runs, sets, parameters = fits.runs, *fits.values.shape
    groups = int(labels.max()) + 1
    within, between = 2 * (runs.runs - groups), 2 * groups - parameters
    if within < 2 or between < 1:
        return None
    order = np.argsort(labels, kind="stable")
    first = np.searchsorted(labels[order], np.arange(groups))

    def of_groups(values: Array) -> Array:
        """Sums (M, groups, ...) of values (M, n, ...) over the runs of each group."""
        return np.add.reduceat(values[:, order], first, axis=1)

    axes = runs.axes  # (n, 2, 2)
    precision = 1 / (runs.eigenvalues + fits.scatter[:, None, None] ** 2)  # (M, n, 2)
    deviation = fits.deviation
    normal = of_groups(np.einsum("mna,nai,naj->mnij", precision, axes, axes))
    right = of_groups(np.einsum("mna,nai->mni", precision * deviation, axes))
    common = np.linalg.solve(normal, right[..., None])[..., 0]  # (M, groups, 2) mean deviation of a group
    missed = np.einsum("mgi,mgi->m", common, right)
    pure = np.maximum(np.sum(precision * deviation**2, axis=(1, 2)) - missed, 0.0) / within
    ratio = missed / between / np.maximum(pure, 1e-300)
    chance = scipy.special.fdtrc(between, within, ratio)
    jacobian = fits.jacobian.reshape(sets, runs.runs, 2, parameters)
    pull = of_groups(np.einsum("mna,nai,mnap->mnip", precision, axes, jacobian))  # (M, groups, 2, p)
    covariance = fits.covariance
    variance = np.einsum("mpp->mp", covariance)
    with np.errstate(invalid="ignore"):
        shift = np.einsum("mpq,mgiq->mgip", covariance, pull)  # of the values, per deviation of a group
        own = np.einsum("mgii->m", normal) - np.einsum("mgip,mgip->m", shift, pull)
        spread = np.maximum(missed - between * pure, 0.0) / own  # variance of the groups' deviations from the law
        factor = pure[:, None] + spread[:, None] * np.sum(shift**2, axis=(1, 2)) / variance
    known = np.isfinite(factor) & (chance < SIGNIFICANT)[:, None]
    factors = np.sqrt(np.where(known, np.maximum(factor, 1.0), 1.0))
    overall = np.sqrt(np.where(chance < SIGNIFICANT, np.maximum(missed / between, 1.0), 1.0))
    found = zip(ratio.tolist(), chance.tolist(), overall.tolist(), factors.tolist(), strict=True)
    return [LackOfFit("F", f, (between, within), p, most, tuple(each)) for f, p, most, each in found]
