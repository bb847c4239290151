"""The arc of constant twist fitted to all poses of a steady run."""

from __future__ import annotations

import numpy as np

from trackslip import se2
from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady_twist import SteadyTwist, long_run_covariance, require_poses, within

MIN_ARC_POSES = 12  # minimum number of valid poses for an arc
_SCALE = np.array([0.0025, 0.0025, np.radians(0.3)])  # weights of position [m] and heading [rad]
_HUBER = 3.0  # residual above which the loss is linear [_SCALE, or the spread of the residuals if larger]
_ITERATIONS = 50
_CONVERGED = 1e-10


def arc(log: RunLog, window: tuple[float, float]) -> SteadyTwist:
    """Least-squares fit of six parameters, a pose and a twist with lateral speed, to all valid poses.

    All poses have equal weight: their covariances, optimistic where the plate is seen nearly edge-on, would make the
    fit worse. Huber's loss limits outliers. The covariance is that of an M-estimator with scores correlated in time.
    Raises LogError if there are fewer than MIN_ARC_POSES valid poses or their numbers are too large to compute with.
    """
    try:
        with np.errstate(all="ignore"):
            found = _fitted(log, window)
    except np.linalg.LinAlgError:
        found = None
    if found is None or not np.isfinite([*found.twist, *found.covariance.ravel()]).all():
        raise LogError(f"run {log.run!r}: no arc fits its poses between {window[0]:.12g} s and {window[1]:.12g} s")
    return found


def _fitted(log: RunLog, window: tuple[float, float]) -> SteadyTwist:
    rows = within(log.time, window) & log.has_heading
    require_poses(rows, MIN_ARC_POSES, log, window)
    time = log.time[rows] - log.time[rows].mean()
    parameters, hessian, scores, count = fit_arc(time, log.pose[rows])
    if not np.isfinite(np.sum(scores**2)):
        raise np.linalg.LinAlgError
    inverse = np.linalg.inv(hessian)
    covariance = inverse @ (len(time) * long_run_covariance(scores)) @ inverse
    correction = count / (count - len(parameters))
    return SteadyTwist.of_arc(parameters, covariance * correction)


def fit_arc(time: Array, pose: Array) -> tuple[Array, Array, Array, int]:
    """The arc that fits poses (T, 3) at times (T,) around 0 best.

    Returns x, y, phi at time 0 and v, u, w (6,); the Hessian (6, 6) of half the weighted squares; the scores (T, 6) of
    the rows; the number of residuals.
    """
    parameters = _start(time, pose)
    for _ in range(_ITERATIONS):
        predicted, jacobian = poses_on_arc(parameters, time)
        residual, jacobian = (predicted - pose) / _SCALE, jacobian / _SCALE[:, None]
        spread = np.maximum(1.0, 1.4826 * np.median(np.abs(residual), axis=0))
        weight = np.minimum(1.0, _HUBER * spread / np.maximum(np.abs(residual), 1e-300))
        weighted = jacobian * weight[..., None]
        hessian = np.einsum("tki,tkj->ij", weighted, jacobian)
        step = np.linalg.solve(hessian, -np.einsum("tki,tk->i", weighted, residual))
        parameters = parameters + step
        if np.abs(step).max() < _CONVERGED:
            break
    return parameters, hessian, np.einsum("tki,tk->ti", weighted, residual), residual.size


def _start(time: Array, pose: Array) -> Array:
    """x, y, phi in the middle of the run, and v, u, w (6,), from chords projected on the heading."""
    w, phi = np.polyfit(time, pose[:, 2], 1)
    stride = max(1, len(time) // 30)
    coarse, at = pose[::stride], time[::stride]
    v = np.sum(se2.log(se2.steps(coarse))[:, 0]) / (at[-1] - at[0])
    nearest = pose[np.abs(time).argmin()]
    return np.array([nearest[0], nearest[1], phi, v, 0.0, w])


def poses_on_arc(parameters: Array, time: Array) -> tuple[Array, Array]:
    """Poses (T, 3) at times (T,) on the arc of x, y, phi, v, u, w (6,), and their Jacobian (T, 3, 6)."""
    pose, by_start, by_motion = se2.drive(parameters[:3], time[:, None] * parameters[3:])
    return pose, np.concatenate([by_start, time[:, None, None] * by_motion], axis=-1)
