"""The arc of constant twist, fitted to all poses of a steady run or directly to all ranges of its
scans.

A pose from a single scan loses information: where the plate is seen nearly edge-on or broadside,
the scan hardly constrains one of the three coordinates, but the pose alone does not show this. All
scans together determine the arc's six parameters well, and each scan contributes in the directions
that it measures: the sum of all scans' log-likelihoods (`trackslip.localization.likelihood`) is
maximised over the arc by the Levenberg-Marquardt method.
"""

from __future__ import annotations

import numpy as np

from trackslip import se2
from trackslip.errors import LogError
from trackslip.kinematics import Array, wrap_angle
from trackslip.localization.likelihood import Evaluation, PlateBeams, PlateLikelihood
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady_twist import SteadyTwist, long_run_covariance, require_poses, within

MIN_ARC_POSES = 12  # minimum number of valid poses for an arc
_SCALE = np.array([0.0025, 0.0025, np.radians(0.3)])  # units of residuals in the fit [m, m, rad]
# residual above which the loss is linear, in units of _SCALE or of the residuals' spread if larger
_HUBER = 3.0
_OF_MEDIAN = 7  # number of poses per median when a jump is looked for: three outliers do not matter
_LEAST_JUMP = np.array([0.05, np.radians(3.0)])  # smallest jump that matters for the twist [m, rad]
# difference of medians above which chance does not explain it [standard deviations of a pose]
_JUMP = 4.0
# standard deviation over median size, for two coordinates and for one
_TO_DEVIATION = np.array([0.8493, 1.4826])
_UNEVEN = 0.1  # share of the motion between two medians that varying slip may explain as a jump [-]
_ITERATIONS = 50
_CONVERGED = 1e-10


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
    _require_no_jump(log.run, log.time[rows], log.pose[rows], poses_on_arc(parameters, time)[0])
    if not np.isfinite(np.sum(scores**2)):
        raise np.linalg.LinAlgError
    inverse = np.linalg.inv(hessian)
    covariance = inverse @ (len(time) * long_run_covariance(scores)) @ inverse
    correction = count / (count - len(parameters))
    return SteadyTwist.of_arc(parameters, covariance * correction)


def _require_no_jump(run: str, time: Array, pose: Array, on_arc: Array) -> None:
    """Raise LogError if medians of the poses (T, 3) jump away from those on the arc (T, 3) and stay
    there.
    """
    # repeated poses lag behind and then catch up
    fresh = np.append(True, (np.diff(pose, axis=0) != 0).any(axis=1))
    count = fresh.sum() // _OF_MEDIAN
    if count < 2:  # too few poses for two medians
        return
    time, on_arc, off = time[fresh], on_arc[fresh], (pose - on_arc)[fresh]
    off[:, 2] = wrap_angle(off[:, 2])
    noise = _TO_DEVIATION / np.sqrt(2) * np.median(_sizes(np.diff(off, axis=0)), axis=1)
    off, on_arc = (
        np.median(np.split(part[: count * _OF_MEDIAN], count), axis=1) for part in (off, on_arc)
    )

    step, motion = _sizes(np.diff(off, axis=0)), _sizes(np.diff(on_arc, axis=0))
    excess = (
        step / np.maximum(np.maximum(_LEAST_JUMP, _JUMP * noise)[:, None], _UNEVEN * motion)
    ).max(axis=0)
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
        residual, jacobian = missed / _SCALE, jacobian / _SCALE[:, None]
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
    """Initial values (6,): x, y, phi in the middle of the run, and v, u, w from chords projected
    onto the heading.

    The values are medians because poses may be outliers, and an outlier may have added a turn to
    all later headings.
    """
    stride = max(1, len(time) // 30)
    coarse, elapsed = pose[::stride], np.diff(time[::stride])
    v = np.median(se2.log(se2.steps(coarse))[:, 0] / elapsed)
    w = np.median(np.diff(coarse[:, 2]) / elapsed)
    start = np.array([0.0, 0.0, np.median(pose[:, 2] - w * time), v, 0.0, w])
    start[:2] = np.median(pose[:, :2] - poses_on_arc(start, time)[0][:, :2], axis=0)
    return start


def poses_on_arc(parameters: Array, time: Array) -> tuple[Array, Array]:
    """Poses (T, 3) at times (T,) on the arc with parameters x, y, phi, v, u, w (6,), and their
    Jacobian (T, 3, 6).
    """
    pose, by_start, by_motion = se2.drive(parameters[:3], time[:, None] * parameters[3:])
    return pose, np.concatenate([by_start, time[:, None, None] * by_motion], axis=-1)


_HUBER = 3.0  # residual above which the loss of a range is linear [standard deviations]
# rms residual about the initial arc above which a scan is excluded [standard deviations]
_MISFIT = 3.0
_COSTLY = 4.0  # cost per measurement on the initial arc above which a scan is excluded
_CHANCE = 1.3  # ratio of the scores' scatter to the expected scatter that chance may explain
_ITERATIONS = 30
_CONVERGED = 1e-3  # largest step at convergence [standard errors]


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
