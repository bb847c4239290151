"""Values with 95 % intervals, and laws that have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from trackslip.kinematics import Array
from trackslip.laws.base import SlipLaw

FEWEST_BLOCKS = 6  # independent parts of driving from which an interval can be told
_SINGULAR = 1e-12  # smallest eigenvalue over the largest of what data tell
_FEWEST_EFFECTIVE = 3.0  # with fewer, Student's t says nothing of a parameter, as of the sensor's place


class Gain(NamedTuple):
    """A value with a 95 % interval, NaN for too little driving."""

    value: float
    low: float
    high: float

    @property
    def error(self) -> float:
        """Half the width of the interval."""
        return (self.high - self.low) / 2

    def to_json(self) -> dict[str, float | None]:
        """The three numbers; None for NaN."""
        return {name: None if np.isnan(value) else value for name, value in self._asdict().items()}


@dataclass(frozen=True, kw_only=True)
class FittedLaw:
    """A law with values that were identified, from steady samples or whole drives."""

    name: str  # name of the family
    law: SlipLaw  # the law with the values below
    values: dict[str, float]  # parameters of the law by name, in their units
    stderr: dict[str, float]  # standard errors of the fitted parameters
    interval95: dict[str, tuple[float, float]]  # 95 % intervals of the fitted parameters
    correlation: Array  # of the fitted parameters, in the order of stderr


def uncertainty(
    names: Sequence[str], values: Array, covariance: Array, quantile: Array | float, limits: Array
) -> dict[str, Any]:
    """The fields stderr, interval95 and correlation of a FittedLaw, of fitted parameters (f,) with limits (2, f)."""
    error = np.sqrt(np.diag(covariance))
    low, high = np.maximum(values - quantile * error, limits[0]), np.minimum(values + quantile * error, limits[1])
    with np.errstate(invalid="ignore"):
        correlation = covariance / np.outer(error, error)
    return {
        "stderr": dict(zip(names, error.tolist(), strict=True)),
        "interval95": dict(zip(names, zip(low.tolist(), high.tolist(), strict=True), strict=True)),
        "correlation": correlation,
    }


def newton_steps(rest: Array, score: np.ndarray) -> np.ndarray:
    """Steps (G, f) of f parameters from minima without G parts of the data to the minimum of all, by Newton's method.

    `rest` (G, f, f) are the normal equations without each part, `score` (G, f) their right sides of each part. Steps
    are 0 where the rest tells nothing.
    """
    scale = np.sqrt(np.maximum(np.einsum("gaa->ga", rest), 1e-200))
    inverse = np.linalg.pinv(rest / scale[:, :, None] / scale[:, None, :], rcond=_SINGULAR, hermitian=True)
    return np.asarray(np.einsum("gab,gb->ga", inverse, score / scale) / scale)


def cr3(apart: Array) -> Array:
    """Covariance (f, f) of parameters, from how far apart (G, f) they are without each block; NaN for few blocks.

    CR3: A. C. Cameron and D. L. Miller, *A Practitioner's Guide to Cluster-Robust Inference*, 2015.
    """
    count = len(apart)
    if count < FEWEST_BLOCKS:
        return np.full((apart.shape[1],) * 2, np.nan)
    return (count - 1) / count * apart.T @ apart


def student(blocks: Array, normal: Array) -> Array:
    """Student's t (f,) for 95 % intervals of f parameters, by the normal equations (G, f, f) of blocks and in all.

    A parameter that few blocks determine has few degrees of freedom: one less than the effective number of blocks, by
    their shares of its information (G. W. Imbens and M. Kolesár, *Robust Standard Errors in Small Samples*, 2016).
    """
    inverse = np.linalg.inv(normal)
    share = np.einsum("ab,gbc,ca->ga", inverse, blocks, inverse)
    effective = share.sum(axis=0) ** 2 / np.maximum(np.sum(share**2, axis=0), 1e-300)
    return np.asarray(stdtrit(np.maximum(effective, _FEWEST_EFFECTIVE) - 1, 0.975))
