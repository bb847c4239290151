"""Damped Gauss-Newton steps for many scans at once, and the linear algebra of small matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.rows import Rows
from trackslip.localization.view import Points, in_axes

UNKNOWN = 1e6
"""Variance of what a scan does not determine."""
_DAMPING = 1e-3  # at first
_FEW = 32  # rows: to leave some out takes longer than to evaluate them once more
_CONVERGED = 1e-2  # a climb ends with a step that promises less; what is left promises about the square of that
_SHORTEST, _LONGEST = 0.1, 0.5  # part of a refused step that is tried next
_TINY = 1e-300  # keeps a step without promise from dividing by zero
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
    def curvature(self) -> Array:
        """Elements of the Hessians (6, M), in Voigt's order."""
        return self.terms.T[4:]

    @property
    def hessian(self) -> Array:
        """(M, 3, 3)."""
        return matrices(self.curvature)

    def promise(self) -> Array:
        """Decreases of the cost (M,) that the next step promises; inf where there is none."""
        return _newton(self, _DAMPING)[1]

    def in_lrf_frame(self) -> Evaluation:
        """A copy with derivatives with respect to x, y and phi."""
        axes, terms = in_axes(self.pose[:, 2]), self.terms.copy()
        back = axes.swapaxes(1, 2)
        terms[:, 1:4] = (back @ self.gradient[..., None])[..., 0]
        terms[:, 4:] = (back @ self.hessian @ axes).reshape(-1, 9).take(_VOIGT, axis=1)
        return Evaluation(self.pose, terms, self.axis)


class Surface(Protocol):
    """The surface to climb: costs of poses, given the beams of the scans."""

    def evaluate(self, beams: Any, pose: Array) -> Evaluation:
        """Cost and derivatives at poses (M, 3), given what is known about M scans."""

    def moved(self, here: Evaluation, step: Array) -> Array:
        """Poses (M, 3) after steps (M, 3) from `here` in the coordinates of the derivatives."""


def climb(surface: Surface, beams: Any, pose: Array, iterations: int) -> Evaluation:
    """The minima near poses (M, 3), given the beams of M scans, of which rows can be taken.

    A step that leads upwards crosses a kink of the cost, where beams leave a face of the plate; a part of it is tried
    next, up to the minimum of the parabola through what is known, unless that promises next to nothing. A row whose
    next step promises next to nothing takes that step. It no longer changes then, so that rows are bitwise independent.
    """
    fit = here = surface.evaluate(beams, pose.copy())
    rows = np.arange(len(pose))  # those of `here`
    climbing = np.ones(len(pose), bool)
    part = np.ones(len(pose))  # of the step that is tried
    for k in range(iterations):
        step, fall = _newton(here, _DAMPING / 10**k)
        there = (fall < _CONVERGED) & climbing
        target = surface.moved(here, part[:, None] * step)
        if np.count_nonzero(there):  # takes a quarter of the time of any()
            np.copyto(here.pose, target, where=there[:, None])
            np.subtract(here.cost, fall, out=here.cost, where=there)
            climbing &= ~there
        left = np.count_nonzero(climbing)
        if not left:
            break
        if len(rows) > _FEW and left < len(rows):
            if fit is not here:
                fit.put(rows[~climbing], here.take(~climbing))
            (on,) = climbing.nonzero()
            rows, beams, here, climbing = rows[on], beams.take(on), here.take(on), climbing[on]
            part, target, fall = part[on], target[on], fall[on]
        trial = surface.evaluate(beams, target)
        rise = trial.cost - here.cost
        better = (rise < 0) & climbing
        if np.count_nonzero(better) == len(rows):
            here = trial
        else:
            np.copyto(here.pose, trial.pose, where=better[:, None])
            np.copyto(here.terms, trial.terms, where=better[:, None])
            np.copyto(here.axis, trial.axis, where=better)
        np.copyto(part, 1.0, where=better)
        refused = climbing & ~better
        if np.count_nonzero(refused):
            promised = 2 * part * np.where(np.isfinite(fall), fall, 0.0)
            shorter = promised / (2 * (rise + promised) + _TINY)
            climbing &= better | (shorter * promised / 2 >= _CONVERGED)  # what the minimum of the parabola promises
            part = np.where(refused, part * np.minimum(np.maximum(shorter, _SHORTEST), _LONGEST), part)
    if here is fit or len(rows) == len(pose):
        return here
    fit.put(rows, here)
    return fit


def _newton(here: Evaluation, damping: float) -> tuple[Array, Array]:
    """Damped steps (M, 3), and the decreases of the cost (M,) that they promise: inf where there is no step."""
    damped = here.curvature.copy()
    damped[:3] *= 1 + damping
    inverse, regular = inverses(damped)
    gradient = here.gradient.T
    parts = inverse.take(_MATRIX, axis=0).reshape(3, 3, -1) * gradient
    step = -(parts[:, 0] + parts[:, 1] + parts[:, 2])
    falls = step * gradient
    fall = (falls[0] + falls[1] + falls[2]) / -2
    if np.count_nonzero(regular) < len(regular):
        step[:, ~regular], fall[~regular] = 0.0, np.inf
    return step.T, fall


# elements whose products, those of the first two rows less those of the others, are the cofactors
_FACTORS = np.array([[1, 0, 0, 4, 5, 3], [2, 2, 1, 5, 3, 4], [3, 4, 5, 0, 1, 2], [3, 4, 5, 3, 4, 5]])


def inverses(elements: Array) -> tuple[Array, np.ndarray]:
    """Inverses of symmetric matrices by cofactors, and a mask (M,) of the positive definite ones.

    Their elements (6, M) are in Voigt's order. Written out because NumPy's inverse calls LAPACK for each matrix.
    """
    factors = elements.take(_FACTORS, axis=0)
    cofactor = factors[0] * factors[1] - factors[2] * factors[3]
    xx, xz, xy = elements[0], elements[4], elements[5]
    determinant = xx * cofactor[0] + xy * cofactor[5] + xz * cofactor[4]
    regular = (determinant > 1e-12 * xx * elements[1] * elements[2]) & (xx > 0)
    if np.count_nonzero(regular) < len(regular):
        determinant[~regular] = 1.0
    cofactor /= determinant
    return cofactor, regular


def matrices(elements: Array) -> Array:
    """Symmetric matrices (M, 3, 3) from their elements (6, M) in Voigt's order."""
    return elements.take(_MATRIX, axis=0).T.copy().reshape(-1, 3, 3)


def covariances(fit: Evaluation) -> Array:
    """Inverses (M, 3, 3) of the Hessians; UNKNOWN in every element of one that is not positive definite."""
    inverse, regular = inverses(fit.curvature)
    if np.count_nonzero(regular) < len(regular):
        inverse[:, ~regular] = UNKNOWN
    return matrices(inverse)
