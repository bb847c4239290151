"""95 % intervals of parameters from fits that each leave out one block of the data."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.special import stdtrit

from trackslip.kinematics import Array

DEVIATION_PER_MEDIAN: Final = 1.4826
"""Ratio of the standard deviation of normal errors to the median of their absolute values."""
FEWEST_BLOCKS: Final = 6  # least number of independent parts of driving for an interval
_SINGULAR: Final = 1e-12  # ratio to the largest eigenvalue below which the data determine nothing
# least number of effective blocks for which Student's t is meaningful
_FEWEST_EFFECTIVE: Final = 3.0


class Gain(NamedTuple):
    """A value with a 95 % interval; both ends are NaN if there is too little driving."""

    value: float
    low: float
    high: float

    @property
    def error(self) -> float:
        """Half the width of the interval."""
        return (self.high - self.low) / 2

    def to_json(self) -> dict[str, float | None]:
        """The value and both ends of the interval, with None for NaN."""
        return {name: None if np.isnan(value) else value for name, value in self._asdict().items()}


def mean_of_groups(values: Array, variance: Array) -> tuple[Array, Array]:
    """Means (f,) of the values (n, f) of n groups, and their covariance (f, f), if the true values
    scatter between groups.

    With y_i the value of a group and s_i² the variance of its error, the scatter between groups is
    estimated by moments (R. DerSimonian and N. Laird, 1986):

        tau² = (sum_i (y_i - m)² / s_i² - (n - 1)) / (S_1 - S_2 / S_1),   S_k = sum_i s_i^(-2 k)

    where m is the mean with the weights 1 / s_i². The groups then have the weights
    w_i = 1 / (s_i² + tau²). The covariance of the weighted means is from the scatter about them,

        C_ab = sum_i sqrt(w_ia w_ib) (y_ia - m_a) (y_ib - m_b) / (n - 1),   sum_i w_ia = 1

    so that Student's t with n - 1 degrees of freedom gives intervals (G. Knapp and J. Hartung,
    *Improved tests for a random effects meta-regression*, 2003).
    """
    freedom = len(values) - 1
    precision = 1 / np.maximum(variance, 1e-300)
    mean = np.average(values, axis=0, weights=precision)
    excess = np.sum(precision * (values - mean) ** 2, axis=0) - freedom
    total = precision.sum(axis=0)
    between = np.maximum(excess, 0.0) / (total - np.sum(precision**2, axis=0) / total)

    weight = 1 / (variance + between)
    weight = weight / weight.sum(axis=0)
    mean = np.sum(weight * values, axis=0)
    apart = np.sqrt(weight) * (values - mean)
    return mean, apart.T @ apart / freedom


def newton_steps(rest: Array, score: np.ndarray) -> np.ndarray:
    """Newton steps (G, f) of f parameters from the minimum without each of G data parts to the
    minimum with all data.

    `rest` (G, f, f) has the normal equations without each part, `score` (G, f) the right-hand side
    from each part. Steps are 0 where the remaining data determine nothing.
    """
    scale = np.sqrt(np.maximum(np.einsum("gaa->ga", rest), 1e-200))
    inverse = np.linalg.pinv(
        rest / scale[:, :, None] / scale[:, None, :], rcond=_SINGULAR, hermitian=True
    )
    return np.asarray(np.einsum("gab,gb->ga", inverse, score / scale) / scale)


def cr3(apart: Array) -> Array:
    """Covariance (f, f) of parameters from their changes `apart` (G, f) without each block; NaN for
    too few blocks.

    CR3: A. C. Cameron and D. L. Miller, *A Practitioner's Guide to Cluster-Robust Inference*, 2015.
    """
    if len(apart) < FEWEST_BLOCKS:
        return np.full((apart.shape[1],) * 2, np.nan)
    return (1 - 1 / len(apart)) * apart.T @ apart


def student(blocks: Array, normal: Array) -> Array:
    """Student's t (f,) for 95 % intervals of f parameters, from normal equations: per block (G, f,
    f) and total (f, f).

    A parameter that few blocks determine has few degrees of freedom: the effective number of
    blocks, from their shares of the information, minus one (G. W. Imbens and M. Kolesár, *Robust
    Standard Errors in Small Samples*, 2016).
    """
    inverse = np.linalg.inv(normal)
    share = np.einsum("ab,gbc,ca->ga", inverse, blocks, inverse)
    effective = share.sum(axis=0) ** 2 / np.maximum(np.sum(share**2, axis=0), 1e-300)
    return np.asarray(stdtrit(np.maximum(effective, _FEWEST_EFFECTIVE) - 1, 0.975))
