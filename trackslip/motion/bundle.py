"""The arc of constant twist, fitted directly to all ranges of a steady run's scans.

A pose from a single scan loses information: where the plate is seen nearly edge-on or broadside,
the scan hardly constrains one of the three coordinates, but the pose alone does not show this. All
scans together determine the arc's six parameters well, and each scan contributes in the directions
that it measures: the sum of all scans' log-likelihoods (`trackslip.localization.likelihood`) is
maximised over the arc by the Levenberg-Marquardt method.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.localization.likelihood import Evaluation, PlateBeams, PlateLikelihood
from trackslip.logs.runlog import RunLog
from trackslip.motion.arc import MIN_ARC_POSES, fit_arc, poses_on_arc
from trackslip.motion.steady_twist import SteadyTwist, long_run_covariance, require_poses, within

_HUBER: Final = 3.0  # residual above which the loss of a range is linear [standard deviations]
# rms residual about the initial arc above which a scan is excluded [standard deviations]
_MISFIT: Final = 3.0
_COSTLY: Final = 4.0  # cost per measurement on the initial arc above which a scan is excluded
_CHANCE: Final = 1.3  # ratio of the scores' scatter to the expected scatter that chance may explain
_ITERATIONS: Final = 30
_CONVERGED: Final = 1e-3  # largest step at convergence [standard errors]


def bundle(log: RunLog, window: tuple[float, float]) -> SteadyTwist:
    """Maximise the likelihood of pose and twist with lateral speed, given all ranges in the window.

    The search starts from the arc through the poses and excludes scans that do not fit this arc.
    The covariance follows from the likelihood, inflated if the scans' scores scatter more than
    expected or are correlated in time: ranges may be noisier than stated, and errors of the
    silhouette's edges are similar in successive scans. Raises LogError if the run has no ranges or
    fewer than MIN_ARC_POSES valid poses.
    """
    if log.scans is None:
        raise LogError(f"run {log.run!r}: has no ranges, which bundle needs; arc fits poses")
    scans, rows = log.scans, within(log.time, window)
    valid = rows & log.has_heading
    require_poses(valid, MIN_ARC_POSES, log, window)
    centre = log.time[valid].mean()
    parameters = fit_arc(log.time[valid] - centre, scans.scan.from_world(log.pose[valid]))[0]
    seen = np.flatnonzero(rows & (scans.cluster.count >= 3))
    time = log.time[seen] - centre
    beams = PlateBeams.of(scans.scan, scans.cluster.take(seen))
    likelihood = PlateLikelihood(scans.plate, _HUBER)
    pose, jacobian = poses_on_arc(parameters, time)
    fit = likelihood.evaluate(beams, pose)
    fits = (likelihood.misfit(beams, pose) < _MISFIT) & (fit.cost < _COSTLY * (beams.count + 2))
    kept = np.flatnonzero(fits)
    if kept.size < MIN_ARC_POSES:
        raise LogError(f"run {log.run!r}: its ranges don't fit its poses")
    if not fits.all():
        time, beams, fit, jacobian = time[kept], beams.take(kept), fit.take(kept), jacobian[kept]
    cost, (scores, hessian) = fit.cost.sum(), _slopes(fit, jacobian)
    damping = 1e-3
    for _ in range(_ITERATIONS):
        step = -np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), scores.sum(axis=0))
        pose, jacobian = poses_on_arc(parameters + step, time)
        fit = likelihood.evaluate(beams, pose)
        if (tried := fit.cost.sum()) <= cost:
            parameters = parameters + step
            cost, (scores, hessian) = tried, _slopes(fit, jacobian)
            damping /= 10
            if np.abs(step * np.sqrt(np.diag(hessian))).max() < _CONVERGED:
                break
        else:
            damping *= 10
    covariance = np.linalg.inv(hessian)
    scattered = len(time) * long_run_covariance(scores)
    # 1 for uncorrelated ranges with the stated noise
    excess = np.trace(covariance @ scattered) / len(parameters)
    inflation = excess if excess > _CHANCE else 1.0
    return SteadyTwist.of_arc(parameters, inflation * covariance)


def _slopes(fit: Evaluation, jacobian: Array) -> tuple[Array, Array]:
    """Derivatives (T, 6) of the scans' costs by the arc's parameters, and the Hessian (6, 6) of the
    total cost.

    `jacobian` (T, 3, 6) has the derivatives of the poses with respect to the arc's parameters.
    """
    fit = fit.in_lrf_frame()
    scores = np.einsum("tki,tk->ti", jacobian, fit.gradient)
    hessian = (jacobian.swapaxes(1, 2) @ fit.hessian @ jacobian).sum(axis=0)
    return scores, hessian
