"""The constant-twist smoother: the most likely motion given all poses and their covariances.

What a Kalman filter and its Rauch-Tung-Striebel pass compute for a linear model, here for the arcs of a robot that may
also move sideways: the maximum a posteriori of all poses and twists together. Each row's state depends on its
neighbours only, so the normal equations are banded.
"""

from __future__ import annotations

import numpy as np
import scipy

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.motion.arc import MIN_ARC_POSES
from trackslip.motion.base import SteadyTwist, long_run_covariance

_STATE = 6  # x, y, phi, v, u, w
_UNKNOWN = np.diag([0.003, 0.003, np.radians(0.4)]) ** 2  # covariance of poses that come without [m, m, rad]
_POSE_NOISE = (2e-5, 2e-5, 2e-5)  # by which a pose leaves the arc in a second [m, m, rad]
_TWIST_NOISE = (2e-4, 2e-4, 5e-4)  # by which a twist changes in a second [m/s, m/s, rad/s]
_MIN_DEVIATION = np.array([5e-4, 5e-4, 5e-4])  # of a pose, whatever its covariance says
_HUBER = 3.0  # distance from which a pose counts linearly only [standard deviations]
_ITERATIONS = 30
_CONVERGED = 1e-9


def rts(log: RunLog, window: tuple[float, float]) -> SteadyTwist:
    """Mean twist of the most likely motion in the window.

    Its covariance is the posterior's, times how much more the poses really scatter about it, and how much longer they
    remember, than their own covariances say.

    Raises:
        LogError: for too few valid poses.
    """
    rows = (log.time > window[0]) & (log.time < window[1])
    valid = log.is_valid[rows]
    if valid.sum() < MIN_ARC_POSES:
        raise LogError(
            f"run {log.run!r}: hardly any valid pose between {window[0]:g} s and {window[1]:g} s, where it is steady"
        )
    first, last = np.flatnonzero(valid)[[0, -1]]
    kept = slice(first, last + 1)
    time, pose, valid = log.time[rows][kept], log.pose[rows][kept], valid[kept]
    covariance = np.broadcast_to(_UNKNOWN, (len(time), 3, 3))
    if log.covariance is not None:
        covariance = log.covariance[rows][kept]
    floor = np.diag(_MIN_DEVIATION**2)
    information = np.zeros((len(time), 3, 3))
    information[valid] = np.linalg.inv(covariance[valid] + floor)
    measured = np.where(valid[:, None], pose, 0.0)

    state = _start(time, pose, valid)
    for _ in range(_ITERATIONS):
        residual = np.where(valid[:, None], state[:, :3] - measured, 0.0)
        distance = np.sqrt(np.einsum("ti,tij,tj->t", residual, information, residual))
        weighted = information * np.minimum(1.0, _HUBER / np.maximum(distance, 1e-300))[:, None, None]
        band, gradient = _normal_equations(time, state, residual, weighted)
        step = -scipy.linalg.solveh_banded(band, gradient.ravel(), lower=True).reshape(state.shape)
        state = state + step
        if np.abs(step).max() < _CONVERGED:
            break
    residual = np.where(valid[:, None], state[:, :3] - measured, 0.0)
    mean = np.zeros((*state.shape, 2))
    mean[:, 3, 0] = mean[:, 5, 1] = 1 / len(time)
    spread = scipy.linalg.solveh_banded(band, mean.reshape(-1, 2), lower=True)
    posterior = mean.reshape(-1, 2).T @ spread
    deviation = residual[valid] * np.sqrt(np.diagonal(information[valid], axis1=1, axis2=2))
    excess = np.trace(long_run_covariance(deviation)) / 3  # 1 for errors as large as stated, and without memory
    return SteadyTwist(state[:, [3, 5]].mean(axis=0), posterior * excess)


def _start(time: Array, pose: Array, valid: np.ndarray) -> Array:
    """States (T, 6): the valid poses joined by straight lines, and their mean twist."""
    joined = np.stack([np.interp(time, time[valid], pose[valid, k]) for k in range(3)], axis=-1)
    state = np.zeros((len(time), _STATE))
    state[:, :3] = joined
    turn, middle = np.diff(joined[:, 2]), (joined[1:, 2] + joined[:-1, 2]) / 2
    chord = np.cos(middle) * np.diff(joined[:, 0]) + np.sin(middle) * np.diff(joined[:, 1])
    state[:, 3] = chord.sum() / (time[-1] - time[0])
    state[:, 5] = turn.sum() / (time[-1] - time[0])
    return state


def _normal_equations(time: Array, state: Array, residual: Array, information: Array) -> tuple[Array, Array]:
    """Hessian as a lower band (12, 6 T) and gradient (T, 6) of half the squares of all residuals."""
    duration = np.diff(time)
    now, then = state[:-1], state[1:]
    phi, v, u, w = now[:, 2:].T
    turn = w * duration
    middle, chord = phi + turn / 2, duration * np.sinc(turn / (2 * np.pi))
    cos, sin = np.cos(middle), np.sin(middle)
    way_x, way_y = (v * cos - u * sin) * chord, (v * sin + u * cos) * chord
    predicted = now.copy()
    predicted[:, 0] += way_x
    predicted[:, 1] += way_y
    predicted[:, 2] += turn
    gap = then - predicted  # (T - 1, 6)
    transition = np.tile(np.eye(_STATE), (len(duration), 1, 1))
    transition[:, 0, 2], transition[:, 1, 2] = -way_y, way_x
    transition[:, 0, 3], transition[:, 0, 4], transition[:, 0, 5] = cos * chord, -sin * chord, -way_y * duration / 2
    transition[:, 1, 3], transition[:, 1, 4], transition[:, 1, 5] = sin * chord, cos * chord, way_x * duration / 2
    transition[:, 2, 5] = duration
    precision = 1 / (np.array([*_POSE_NOISE, *_TWIST_NOISE]) ** 2 * duration[:, None])  # (T - 1, 6)
    weighted = transition * precision[..., None]

    diagonal = np.zeros((len(time), _STATE, _STATE))
    diagonal[:, :3, :3] = information
    diagonal[1:, range(_STATE), range(_STATE)] += precision
    diagonal[:-1] += transition.swapaxes(1, 2) @ weighted
    below = -weighted  # of row k + 1 and column k
    gradient = np.zeros_like(state)
    gradient[:, :3] = np.einsum("tij,tj->ti", information, residual)
    gradient[1:] += precision * gap
    gradient[:-1] -= np.einsum("tij,ti->tj", weighted, gap)

    band = np.zeros((2 * _STATE, len(time), _STATE))
    for i in range(_STATE):
        for j in range(_STATE):
            if i >= j:
                band[i - j, :, j] = diagonal[:, i, j]
            band[_STATE + i - j, :-1, j] = below[:, i, j]
    return band.reshape(2 * _STATE, -1), gradient
