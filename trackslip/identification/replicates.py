"""Runs that repeat each other, and the test for lack of fit that they allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trackslip.identification.fit import Fits
from trackslip.kinematics import Array, RobotGeometry, body_twist

_ALIKE = 0.02  # relative difference of the commanded curvatures (or speeds) of runs that repeat each other
_MAX_FOLDS = 10
_FOLDS = 5  # of values that don't come in groups
SIGNIFICANT = 0.01
"""Probability below which lack of fit isn't put down to chance."""


@dataclass(frozen=True)
class LackOfFit:
    """Whether a law misses the runs by more than they miss each other, or than their measurement errors."""

    test: str
    """F: against the scatter of repeated runs; chi2: against the errors of measurement."""
    statistic: float
    freedom: tuple[int, ...]
    probability: float
    """Of a statistic as large by chance."""
    inflation: float
    """Factor on standard errors: the law's misses are shared by runs that repeat each other, so there are fewer
    independent ones than runs; 1 where the law fits."""

    @property
    def significant(self) -> bool:
        """Whether the law is to be doubted."""
        return self.probability < SIGNIFICANT


def alike(values: Array, tolerance: float = _ALIKE) -> np.ndarray:
    """Labels (n,) of values (n,) that are about the same: gaps in their order part them."""
    order = np.argsort(values, kind="stable")
    ranked = values[order]
    gap = np.diff(ranked) > tolerance * np.maximum(np.abs(ranked[1:]), np.abs(ranked[:-1]))
    labels = np.empty(len(values), int)
    labels[order] = np.concatenate([[0], np.cumsum(gap)])
    return labels


def by_command(omega: Array, geometry: RobotGeometry) -> np.ndarray:
    """Labels (n,) of runs whose sprocket speeds (n, 2) have the same ratio, and so the same radius."""
    ideal = body_twist(omega, 0.0, geometry)
    direction = np.arctan2(geometry.half_gauge * ideal[:, 1], ideal[:, 0])
    return alike(direction)


def folds(values: Array) -> np.ndarray:
    """Labels (n,) of groups to leave out one at a time: those that are alike, else neighbours in equal numbers."""
    labels = alike(values)
    if labels.max(initial=0) < _MAX_FOLDS:
        return labels
    rank = np.argsort(np.argsort(values, kind="stable"), kind="stable")
    return rank * _FOLDS // len(values)


def lack_of_fit(fits: Fits, measured: bool) -> list[LackOfFit] | None:
    """Of each of M sets of runs; None where there is nothing to hold the law against.

    Where runs repeat each other: the F-test of what the law misses beyond the scatter of the repeats about a slip of
    their own, all in the fit's own weights. Else, where the errors of measurement are known, whether these explain
    the residuals.

    Args:
        fits: a family fitted to the sets.
        measured: whether the runs came with errors of measurement.
    """
    runs, parameters = fits.runs, fits.values.shape[1]
    labels = by_command(runs.omega, runs.geometry)
    groups = int(labels.max()) + 1
    within, between = 2 * (runs.runs - groups), 2 * groups - parameters
    if within >= 2 and between >= 1:
        pure = _pure_error(fits, labels)  # (M,)
        missed = np.maximum(fits.cost - pure, 0.0) / between
        ratio = missed / np.maximum(pure / within, 1e-300)
        return [
            LackOfFit(
                "F", float(f), (between, within), float(p), float(max(1.0, excess**0.5)) if p < SIGNIFICANT else 1.0
            )
            for f, p, excess in zip(ratio, scipy.stats.f.sf(ratio, between, within), missed, strict=True)
        ]
    freedom = fits.freedom
    if not measured or freedom < 1:
        return None
    whitened = runs.whiten(runs.deviation(fits.law), np.zeros(len(fits.values)))
    squares = np.sum(whitened**2, axis=1)
    return [
        LackOfFit("chi2", float(c), (freedom,), float(p), 1.0)
        for c, p in zip(squares, scipy.stats.chi2.sf(squares, freedom), strict=True)
    ]


def _pure_error(fits: Fits, labels: np.ndarray) -> Array:
    """Weighted squares (M,) of the runs' speeds about those of their group's best slips: the least a law can leave."""
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
