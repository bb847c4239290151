"""Maximising the likelihood, for many scans and starts at once."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.likelihood import Beams, Evaluation, PlateLikelihood, inverses

_CONVERGED = 1e-5  # a climb ends when the predicted or actual decrease of the cost is smaller


def climb(likelihood: PlateLikelihood, beams: Beams, pose: Array, iterations: int, turn: bool = True) -> Evaluation:
    """Levenberg-Marquardt from poses (M, 3) in the LRF's frame; without `turn` the heading is fixed.

    A row that has converged no longer changes, so that rows are bitwise independent of each other.
    """
    fit = likelihood.evaluate(beams, pose.copy(), turn)
    damping = np.full(len(pose), 1e-3)
    climbing = np.arange(len(pose))
    for _ in range(iterations):
        here = fit if climbing.size == len(pose) else fit.take(climbing)
        damped = here.hessian + damping[:, None, None] * here.hessian * np.eye(3)
        inverse, regular = inverses(damped)
        step = -np.einsum("mij,mj->mi", inverse, here.gradient)
        on = ~regular | (np.einsum("mi,mi->m", step, here.gradient) < -2 * _CONVERGED)
        if not on.all():
            climbing, beams, damping = climbing[on], beams.take(on), damping[on]
            here, step, regular = here.take(on), step[on], regular[on]
        if not climbing.size:
            break
        trial = likelihood.evaluate(beams, here.pose + np.where(regular[:, None], step, 0.0), turn)
        fall = here.cost - trial.cost
        better = fall > 0
        fit.put(climbing[better], trial.take(better))
        on = ~better | (fall > _CONVERGED)
        if not on.any():
            break
        damping = np.where(better, damping / 10, damping * 10)[on]
        if not on.all():
            climbing, beams = climbing[on], beams.take(on)
    return fit
