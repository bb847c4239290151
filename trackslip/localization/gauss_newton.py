"""Evaluations of a likelihood at many poses, and the Gauss-Newton steps and covariances that follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.rows import Rows
from trackslip.localization.view import Points, in_axes

UNKNOWN = 1e6
"""Variance of what a scan does not determine."""
_MATRIX = np.array([0, 5, 4, 5, 1, 3, 4, 3, 2])  # Voigt's elements (xx, yy, zz, yz, xz, xy) in the rows of a matrix
_VOIGT = np.array([0, 4, 8, 5, 2, 1])  # elements of a matrix in Voigt's order


@dataclass(frozen=True)
class Evaluation(Rows):
    """The likelihood at M poses; derivatives with respect to the place along and across the plate and the heading."""

    pose: Array  # (M, 3) in the LRF's frame
    terms: Array  # (M, 10): cost, gradient, and the elements of the Hessian in Voigt's order, xx, yy, zz, yz, xz, xy
    axis: Points  # (M,) directions along the plates, where they were evaluated

    @property
    def cost(self) -> Array:
        """Negative log likelihoods (M,)."""
        return self.terms[:, 0]

    @property
    def gradient(self) -> Array:
        """(M, 3)."""
        return self.terms[:, 1:4]

    @property
    def hessian(self) -> Array:
        """A copy (M, 3, 3)."""
        return self.terms[:, 4:].take(_MATRIX, axis=1).reshape(-1, 3, 3)

    def in_lrf_frame(self) -> Evaluation:
        """A copy with derivatives with respect to x, y and phi."""
        axes, terms = in_axes(self.pose[:, 2]), self.terms.copy()
        back = axes.swapaxes(1, 2)
        terms[:, 1:4] = (back @ self.gradient[..., None])[..., 0]
        terms[:, 4:] = (back @ self.hessian @ axes).reshape(-1, 9).take(_VOIGT, axis=1)
        return Evaluation(self.pose, terms, self.axis)


def newton(here: Evaluation, damping: float) -> tuple[Array, Array]:
    """Damped steps (M, 3), and the decreases of the cost (M,) that they promise."""
    step = np.linalg.solve(_regular(here.hessian, damping), -here.gradient[..., None])[..., 0]
    return step, np.sum(step * here.gradient, axis=1) / -2


def covariances(fit: Evaluation) -> Array:
    """Inverses (M, 3, 3) of the Hessians; variances of what a scan does not determine are UNKNOWN."""
    return np.linalg.inv(_regular(fit.hessian, 0.0))


def _regular(hessian: Array, damping: float) -> Array:
    """The Hessians (M, 3, 3), in place, with damping and a prior whose variances are UNKNOWN."""
    diagonal = np.einsum("mii->mi", hessian)  # a view
    diagonal *= 1 + damping
    diagonal += 1 / UNKNOWN
    return hessian
