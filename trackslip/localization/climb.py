"""Levenberg-Marquardt for many scans at once, and the linear algebra of small matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.rows import Rows
from trackslip.localization.view import in_axes

UNKNOWN = 1e6
"""Variance of what a scan does not determine."""
_DAMPING = 1e-3  # at first
_FEW = 32  # rows: to leave some out takes longer than to evaluate them once more
_CONVERGED = 1e-4  # a climb ends with a step that promises less; it is exact to a fraction of its length


@dataclass(frozen=True)
class Evaluation(Rows):
    """The likelihood at M poses; derivatives with respect to the place along and across the plate and the heading."""

    pose: Array  # (M, 3) in the LRF's frame
    cost: Array  # (M,) negative log likelihood
    gradient: Array  # (M, 3)
    hessian: Array  # (M, 3, 3)

    def promise(self) -> Array:
        """Decreases of the cost (M,) that the next step promises; inf where there is none."""
        return _newton(self, np.full(len(self.cost), _DAMPING))[1]

    def in_lrf_frame(self) -> Evaluation:
        """The same with derivatives with respect to x, y and phi."""
        axes = in_axes(self.pose[:, 2])
        back = axes.swapaxes(1, 2)
        return Evaluation(self.pose, self.cost, (back @ self.gradient[..., None])[..., 0], back @ self.hessian @ axes)


class Surface(Protocol):
    """What is climbed: costs of poses, given the beams of the scans."""

    def evaluate(self, beams: Any, pose: Array) -> Evaluation:
        """Cost and derivatives at poses (M, 3), given what is known about M scans."""

    def moved(self, pose: Array, step: Array) -> Array:
        """Poses (M, 3) after steps (M, 3) in the coordinates of the derivatives."""


def climb(surface: Surface, beams: Any, pose: Array, iterations: int) -> Evaluation:
    """The minima near poses (M, 3), given the beams of M scans, of which rows can be taken.

    A row whose next step promises next to nothing takes that step, and no longer changes, so that rows are bitwise
    independent of each other.
    """
    fit = here = surface.evaluate(beams, pose.copy())
    rows = np.arange(len(pose))  # those of `here`
    climbing = np.ones(len(pose), bool)
    damping = np.full(len(pose), _DAMPING)
    for _ in range(iterations):
        step, fall = _newton(here, damping)
        there = (fall < _CONVERGED) & climbing
        if there.any():
            here.pose[there] = surface.moved(here.pose[there], step[there])
            here.cost[there] -= fall[there]
            climbing &= ~there
            if not climbing.any():
                break
            if len(rows) > _FEW:
                if fit is not here:
                    fit.put(rows[there], here.take(there))
                on = np.flatnonzero(climbing)
                rows, beams, here = rows[on], beams.take(on), here.take(on)
                climbing, damping, step = climbing[on], damping[on], step[on]
        trial = surface.evaluate(beams, surface.moved(here.pose, step))
        better = (trial.cost < here.cost) & climbing
        damping = np.where(better, damping / 10, damping * 10)
        if better.all():
            here = trial
        else:
            here.put(better, trial.take(better))
    if here is fit or len(rows) == len(pose):
        return here
    fit.put(rows, here)
    return fit


def _newton(here: Evaluation, damping: Array) -> tuple[Array, Array]:
    """Damped steps (M, 3), and the decreases of the cost (M,) that they promise: inf where there is no step."""
    damped = here.hessian.reshape(-1, 9).copy()
    damped[:, ::4] *= 1 + damping[:, None]
    inverse, regular = inverses(damped)
    step = -(inverse @ here.gradient[:, :, None])[:, :, 0]
    fall = np.einsum("mi,mi->m", step, here.gradient) / -2
    if not regular.all():
        step[~regular], fall[~regular] = 0.0, np.inf
    return step, fall


_FIRST = np.array([4, 5, 3, 8, 2, 0])  # elements of a symmetric matrix whose products are the cofactors
_SECOND = np.array([8, 6, 7, 0, 3, 4])
_THIRD = np.array([5, 3, 4, 2, 0, 1])
_FOURTH = np.array([7, 8, 6, 6, 5, 3])
_SYMMETRIC = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])


def inverses(matrix: Array) -> tuple[Array, np.ndarray]:
    """Inverses of symmetric matrices (M, 3, 3) by cofactors, and a mask (M,) of the positive definite ones.

    Written out because NumPy's inverse calls LAPACK for each matrix. Elements are taken so that a matrix is contiguous
    whatever M is: the order in which NumPy adds depends on it.
    """
    flat = matrix.reshape(-1, 9)
    first, second, third, fourth = (flat.take(k, axis=1) for k in (_FIRST, _SECOND, _THIRD, _FOURTH))
    cofactor = first * second - third * fourth  # xx, xy, xz, yy, yz, zz
    determinant = np.einsum("mi,mi->m", flat[:, :3], cofactor[:, :3])
    xx = flat[:, 0]
    regular = (determinant > 1e-12 * xx * flat[:, 4] * flat[:, 8]) & (xx > 0)
    cofactor /= np.where(regular, determinant, 1.0)[:, None]
    return cofactor.take(_SYMMETRIC, axis=1).reshape(-1, 3, 3), regular


def covariances(hessian: Array) -> Array:
    """Inverses (M, 3, 3) of Hessians (M, 3, 3); UNKNOWN in every element of one that is not positive definite."""
    inverse, regular = inverses(hessian)
    if not regular.all():
        inverse[~regular] = UNKNOWN
    return inverse
