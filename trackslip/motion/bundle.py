"""The arc of constant twist fitted directly to all ranges of a steady run.

Poses of single scans lose information: where the plate is seen nearly edge-on or broadside, a scan hardly constrains
one of the three coordinates, and the pose does not show that. The other scans determine the six parameters of the arc
so well that each scan only corrects them in the directions that it measures: the sum of the likelihoods of all scans
(`trackslip.localization.likelihood`) is maximised over the arc by the Levenberg-Marquardt method.
"""

from __future__ import annotations

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.localization.beams import PlateBeams
from trackslip.localization.likelihood import Evaluation, PlateLikelihood
from trackslip.logs.runlog import RunLog
from trackslip.motion.arc import MIN_ARC_POSES, fit_arc, poses_on_arc
from trackslip.motion.steady_twist import SteadyTwist, long_run_covariance, require_poses, within

_HUBER = 3.0  # residual of a range above which its loss is linear [standard deviations]
_MISFIT = 3.0  # rms residual on the initial arc of returns that are not from the plate [standard deviations]
_COSTLY = 4.0  # cost per measurement of a scan on that arc that noise does not explain
_CHANCE = 1.3  # ratio of the scatter of the scores to its expectation that may be chance: it varies by a tenth
_ITERATIONS = 30
_CONVERGED = 1e-3  # largest step [standard errors]


def bundle(log: RunLog, window: tuple[float, float]) -> SteadyTwist:
    """Maximum-likelihood pose and twist with lateral speed, given all ranges in the window.

    Starts from the arc through the poses and excludes scans that do not fit it. The covariance is that of the
    likelihood, inflated if the scores of the scans scatter more or are more correlated in time than it predicts: ranges
    may be noisier than stated, and the edges of the silhouette are off by part of a beam in several successive scans.
    Raises LogError if the run has no ranges or fewer than MIN_ARC_POSES valid poses.
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
    excess = np.trace(covariance @ scattered) / len(parameters)  # 1 for uncorrelated ranges as noisy as stated
    inflation = excess if excess > _CHANCE else 1.0
    return SteadyTwist.of_arc(parameters, inflation * covariance)


def _slopes(fit: Evaluation, jacobian: Array) -> tuple[Array, Array]:
    """Derivatives of the costs of scans by the parameters of the arc, (T, 6), and the Hessian of their sum (6, 6).

    `jacobian` (T, 3, 6) are the derivatives of the poses.
    """
    fit = fit.in_lrf_frame()
    scores = np.einsum("tki,tk->ti", jacobian, fit.gradient)
    hessian = (jacobian.swapaxes(1, 2) @ fit.hessian @ jacobian).sum(axis=0)
    return scores, hessian
