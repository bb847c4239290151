"""The arc of constant twist, fitted to all poses of a steady run."""

from __future__ import annotations

from typing import Final

import numpy as np

from trackslip import se2
from trackslip.errors import LogError
from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady_twist import SteadyTwist, long_run_covariance, require_poses, within

MIN_ARC_POSES: Final = 12  # minimum number of valid poses for an arc
# units of residuals in the fit [m, m, rad]
_SCALE: Final = np.array([0.0025, 0.0025, np.radians(0.3)])
# residual above which the loss is linear, in units of _SCALE or of the residuals' spread if larger
_HUBER: Final = 3.0
# number of poses per median when a jump is looked for: three outliers do not matter
_OF_MEDIAN: Final = 7
# smallest jump that matters for the twist [m, rad]
_LEAST_JUMP: Final = np.array([0.05, np.radians(3.0)])
# difference of medians above which chance does not explain it [standard deviations of a pose]
_JUMP: Final = 4.0
# standard deviation over median size, for two coordinates and for one
_TO_DEVIATION: Final = np.array([0.8493, 1.4826])
# share of the motion between two medians that varying slip may explain as a jump [-]
_UNEVEN: Final = 0.1
# white noise needs 5, wild poses at 15 % of the times, all alike, up to 450 (test_arc)
_ITERATIONS: Final = 1000
_CONVERGED: Final = 1e-6  # largest step at convergence [standard errors, for noise of _SCALE]


def arc(log: RunLog, window: tuple[float, float]) -> SteadyTwist:
    """Fit six parameters, a pose and a twist with lateral speed, to all valid poses in the window
    by least squares.

    All poses have equal weight. Weights from the poses' covariances would make the fit worse,
    because the covariances are too small where the plate is seen nearly edge-on. Huber's loss
    limits the effect of outliers. The covariance is that of an M-estimator with scores correlated
    in time. Raises LogError for fewer than MIN_ARC_POSES valid poses, for poses that jump and stay
    there, as after a relocalisation, and for poses too large to compute with.
    """
    try:
        with np.errstate(all="ignore"):
            found = _fitted(log, window)
    except np.linalg.LinAlgError:
        found = None
    if found is None or not np.isfinite([*found.twist, *found.covariance.ravel()]).all():
        raise LogError(
            f"run {log.run!r}: no arc fits its poses between {window[0]:.12g} s and "
            f"{window[1]:.12g} s"
        )
    return found


def _fitted(log: RunLog, window: tuple[float, float]) -> SteadyTwist:
    rows = within(log.time, window) & log.has_heading
    require_poses(rows, MIN_ARC_POSES, log, window)
    time = log.time[rows] - log.time[rows].mean()
    parameters, hessian, scores, count = fit_arc(time, log.pose[rows])
    on_arc, _ = poses_on_arc(parameters, time)
    _require_no_jump(log.run, log.time[rows], log.pose[rows], on_arc)
    if not np.isfinite(np.sum(scores**2)):
        raise np.linalg.LinAlgError
    inverse = np.linalg.inv(hessian)
    of_scores = len(time) * long_run_covariance(scores)
    covariance = inverse @ of_scores @ inverse
    correction = count / (count - len(parameters))
    return SteadyTwist.of_arc(parameters, covariance * correction)


def _require_no_jump(run: str, time: Array, pose: Array, on_arc: Array) -> None:
    """Raise LogError if medians of the poses (T, 3) jump away from those on the arc (T, 3) and stay
    there.
    """
    # repeated poses lag behind and then catch up
    is_fresh = np.append(True, (np.diff(pose, axis=0) != 0).any(axis=1))
    count = is_fresh.sum() // _OF_MEDIAN
    if count < 2:  # too few poses for two medians
        return
    time = time[is_fresh]
    on_arc = on_arc[is_fresh]
    off = pose[is_fresh] - on_arc
    off[:, 2] = wrap_angle(off[:, 2])

    # noise of a pose, from differences of two poses in succession
    differences = _sizes(np.diff(off, axis=0))
    noise = _TO_DEVIATION / np.sqrt(2) * np.median(differences, axis=1)

    def medians(values: Array) -> Array:
        """Medians (count, 3) of successive values (T, 3)."""
        parts = np.split(values[: count * _OF_MEDIAN], count)
        return np.asarray(np.median(parts, axis=1))

    # steps between medians, relative to what noise and uneven slip explain
    step = _sizes(np.diff(medians(off), axis=0))
    motion = _sizes(np.diff(medians(on_arc), axis=0))
    by_noise = np.maximum(_LEAST_JUMP, _JUMP * noise)[:, None]
    by_slip = _UNEVEN * motion
    excess = (step / np.maximum(by_noise, by_slip)).max(axis=0)
    if excess.max() > 1:
        k = int(excess.argmax())
        raise LogError(
            f"run {run!r}: its poses jump by {step[0, k]:.2g} m and "
            f"{np.degrees(step[1, k]):.2g}° about "
            f"t = {time[(k + 1) * _OF_MEDIAN]:.12g} s and stay there; if they don't, check the "
            "units (m, rad)"
        )


def _sizes(change: Array) -> Array:
    """Distances and absolute turns (2, T) of pose changes (T, 3)."""
    return np.stack([np.hypot(change[:, 0], change[:, 1]), np.abs(change[:, 2])])


def fit_arc(time: Array, pose: Array) -> tuple[Array, Array, Array, int]:
    """Fit an arc to poses (T, 3) at times (T,) with mean 0.

    Returns the parameters (6,), x, y, phi at time 0 and v, u, w; the Hessian (6, 6) of half the
    weighted sum of squares; the scores (T, 6) of the rows; and the number of residuals.
    """
    parameters = _start(time, pose)
    for _ in range(_ITERATIONS):
        predicted, jacobian = poses_on_arc(parameters, time)
        missed = predicted - pose
        missed[:, 2] = wrap_angle(missed[:, 2])
        residual = missed / _SCALE
        jacobian = jacobian / _SCALE[:, None]

        # Huber's loss is linear for residuals above some times their spread
        size = np.abs(residual)
        spread = np.maximum(1.0, 1.4826 * np.median(size, axis=0))
        weight = np.minimum(1.0, _HUBER * spread / np.maximum(size, 1e-300))
        weighted = jacobian * weight[..., None]
        hessian = np.einsum("tki,tkj->ij", weighted, jacobian)
        gradient = np.einsum("tki,tk->i", weighted, residual)
        step = np.linalg.solve(hessian, -gradient)
        parameters = parameters + step
        if np.abs(step * np.sqrt(np.diag(hessian))).max() < _CONVERGED:
            break
    scores = np.einsum("tki,tk->ti", weighted, residual)
    return parameters, hessian, scores, residual.size


def _start(time: Array, pose: Array) -> Array:
    """Initial values (6,): x, y, phi in the middle of the run, and v, u, w from chords projected
    onto the heading.

    The values are medians because poses may be outliers, and an outlier may have added a turn to
    all later headings.
    """
    stride = max(1, len(time) // 30)
    coarse = pose[::stride]
    elapsed = np.diff(time[::stride])
    chords = se2.log(se2.steps(coarse))
    v = np.median(chords[:, 0] / elapsed)
    w = np.median(np.diff(coarse[:, 2]) / elapsed)
    phi = np.median(pose[:, 2] - w * time)

    start = np.array([0.0, 0.0, phi, v, 0.0, w])
    on_arc, _ = poses_on_arc(start, time)
    start[:2] = np.median(pose[:, :2] - on_arc[:, :2], axis=0)
    return start


def poses_on_arc(parameters: Array, time: Array) -> tuple[Array, Array]:
    """Poses (T, 3) at times (T,) on the arc with parameters x, y, phi, v, u, w (6,), and their
    Jacobian (T, 3, 6).
    """
    pose, by_start, by_motion = se2.drive(parameters[:3], time[:, None] * parameters[3:])
    return pose, np.concatenate([by_start, time[:, None, None] * by_motion], axis=-1)
