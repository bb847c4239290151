"""The climb to the likelihood's maximum, over many scans and starts together."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.likelihood import Fit, PlateLikelihood, View, inverses

_CONVERGED = 1e-5  # a smaller fall of the cost, promised or come true, ends a climb


def climb(likelihood: PlateLikelihood, view: View, pose: Array, iterations: int, turn: bool = True) -> Fit:
    """Levenberg-Marquardt from poses (M, 3) in the LRF's frame; without `turn` the heading stays as it is.

    A row that has converged is left alone, whatever the others do, so that each row's bits are its own.
    """
    fit = likelihood.evaluate(view, pose.copy(), turn)
    damping = np.full(len(pose), 1e-3)
    climbing = np.arange(len(pose))
    for _ in range(iterations):
        here = fit if climbing.size == len(pose) else fit.take(climbing)
        damped = here.hessian + damping[:, None, None] * here.hessian * np.eye(3)
        inverse, regular = inverses(damped)
        step = -np.einsum("mij,mj->mi", inverse, here.gradient)
        on = ~regular | (np.einsum("mi,mi->m", step, here.gradient) < -2 * _CONVERGED)
        if not on.all():
            climbing, view, damping = climbing[on], view.take(on), damping[on]
            here, step, regular = here.take(on), step[on], regular[on]
        if not climbing.size:
            break
        trial = likelihood.evaluate(view, here.pose + np.where(regular[:, None], step, 0.0), turn)
        fall = here.cost - trial.cost
        better = fall > 0
        fit.put(climbing[better], trial.take(better))
        on = ~better | (fall > _CONVERGED)
        if not on.any():
            break
        damping = np.where(better, damping / 10, damping * 10)[on]
        if not on.all():
            climbing, view = climbing[on], view.take(on)
    return fit
