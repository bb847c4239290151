"""Groups of repeated runs, and the test for lack of fit that they allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trackslip.identification.fit import Fits
from trackslip.kinematics import Array, RobotGeometry, body_twist

_TOLERANCE = 0.02  # maximum relative difference of the commanded curvatures (or speeds) of repeated runs
_MAX_FOLDS = 10
_FOLDS = 5  # number of folds for values that do not form groups
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
    """Factor on standard errors, because repeated runs share the errors of the law, which are therefore fewer than the
    runs; 1 if the law fits [-]."""


def group_labels(values: Array) -> np.ndarray:
    """Group labels (n,) of values (n,), separated by gaps in their order."""
    order = np.argsort(values, kind="stable")
    ranked = values[order]
    gap = np.diff(ranked) > _TOLERANCE * np.maximum(np.abs(ranked[1:]), np.abs(ranked[:-1]))
    labels = np.empty(len(values), int)
    labels[order] = np.concatenate([[0], np.cumsum(gap)])
    return labels


def by_command(omega: Array, geometry: RobotGeometry) -> np.ndarray:
    """Labels (n,) of runs with the same ratio of sprocket speeds (n, 2) and thus the same radius."""
    ideal = body_twist(omega, 0.0, geometry)
    return group_labels(np.arctan2(geometry.half_gauge * ideal[:, 1], ideal[:, 0]))


def folds(values: Array) -> np.ndarray:
    """Labels (n,) of the folds of a cross-validation: groups of equal values, else equal numbers of neighbours."""
    labels = group_labels(values)
    if labels.max(initial=0) < _MAX_FOLDS:
        return labels
    rank = np.argsort(np.argsort(values, kind="stable"), kind="stable")
    return rank * _FOLDS // len(values)


def lack_of_fit(fits: Fits, measured: bool) -> list[LackOfFit] | None:
    """Tests for lack of fit of M sets of runs; None if there is nothing to compare the law with.

    With repeated runs: the F-test of the misfit of the law relative to the scatter of the repeats about their own mean
    slip, with the weights of the fit. Otherwise, if the measurement errors are known (`measured`), the chi-square test
    of whether they explain the residuals.
    """
    runs, parameters = fits.runs, fits.values.shape[1]
    labels = by_command(runs.omega, runs.geometry)
    groups = int(labels.max()) + 1
    within, between = 2 * (runs.runs - groups), 2 * groups - parameters
    if within >= 2 and between >= 1:
        pure = _pure_error(fits, labels)  # (M,)
        missed = np.maximum(fits.cost - pure, 0.0) / between
        ratio = missed / np.maximum(pure / within, 1e-300)
        chance = scipy.stats.f.sf(ratio, between, within)
        inflation = np.where(chance < SIGNIFICANT, np.maximum(1.0, missed**0.5), 1.0)
        found = zip(ratio.tolist(), chance.tolist(), inflation.tolist(), strict=True)
        return [LackOfFit("F", f, (between, within), p, factor) for f, p, factor in found]
    freedom = fits.freedom
    if not measured or freedom < 1:
        return None
    squares = np.sum(runs.whiten(runs.deviation(fits.law), np.zeros(len(fits.values))) ** 2, axis=1)
    chance = scipy.stats.chi2.sf(squares, freedom)
    return [LackOfFit("chi2", c, (freedom,), p, 1.0) for c, p in zip(squares.tolist(), chance.tolist(), strict=True)]


def _pure_error(fits: Fits, labels: np.ndarray) -> Array:
    """Weighted squares (M,) of the speeds about those of the best slips of each group: the minimum for any law."""
    runs, sets = fits.runs, len(fits.values)
    root = 1 / np.sqrt(runs.eigenvalues + fits.scatter[:, None, None] ** 2)  # (M, n, 2)
    design = root[..., None] * (runs.turn * (runs.geometry.sprocket_radius * runs.omega)[:, None, :])  # of 1 - slip
    target = root * np.einsum("nij,mnj->mni", runs.turn, runs.speeds)
    total = np.zeros(sets)
    for label in range(int(labels.max()) + 1):
        rows = labels == label
        a, b = design[:, rows].reshape(sets, -1, 2), target[:, rows].reshape(sets, -1)
        normal, right = np.einsum("mki,mkj->mij", a, a), np.einsum("mki,mk->mi", a, b)
        best = np.linalg.solve(normal, right[..., None])[..., 0]
        total += np.sum((np.einsum("mki,mi->mk", a, best) - b) ** 2, axis=1)
    return total
