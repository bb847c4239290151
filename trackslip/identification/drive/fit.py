"""The most likely trajectory and parameters of drives, with their noise: Gauss-Newton steps, REML and gates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from trackslip.identification.drive.equations import Nodes, Noise, Residuals, Solution, cost, residuals, solve, weights
from trackslip.identification.drive.model import DriveModel
from trackslip.identification.drive.noise import updated
from trackslip.identification.drive.outliers import outlying
from trackslip.kinematics import Array, wrap_angle

_ROUNDS = 30  # maximum number of Gauss-Newton steps
_GATED = 12  # rounds after which gates stay as they are
_HALVINGS = 6
_SETTLED = 0.03  # change of the values, in standard errors
_QUIET = 0.02  # relative change of the standard deviations of settled noise
_LOUD = 0.1  # relative change of standard deviations far from settled
_MIN_ROUNDS = 3  # before which gates may still change
_GATE = 0.99  # quantile beyond which a pose is left out
_STEP_GATE = 0.9999  # quantile beyond which a step is left out


@dataclass(frozen=True)
class Fit:
    """A fit of a model to drives."""

    model: DriveModel
    nodes: Nodes  # with the weights that the gates left
    states: Array  # (K, 3) sensor's positions [m] and robot's headings [rad]
    values: Array  # (p,) of all parameters
    free: np.ndarray  # (f,) indices of those that were fitted
    noise: Noise
    residuals: Residuals
    solution: Solution  # the last step, for information and scores
    mean: Array  # (p,) of the priors
    converged: bool

    @property
    def deviance(self) -> float:
        """-2 log likelihood of the poses, but for a constant that all laws share that are fitted to the same nodes."""
        poses, steps = weights(self.residuals, self.nodes, self.noise)
        logs = sum(float(np.log(part[part > 0]).sum()) for part in (poses, steps))
        determinant = 2 * float(np.log(self.solution.factor[0]).sum())
        return cost(self.residuals, self.nodes, self.noise) + determinant - logs

    @property
    def covariance(self) -> Array:
        """Covariance (f, f) of the free values by the model."""
        return np.linalg.inv(self.solution.information)


def fit(
    model: DriveModel,
    nodes: Nodes,
    states: Array,
    values: Array,
    noise: Noise,
    free: np.ndarray,
    mean: Array,
    gated: bool = True,
    quiet: bool = False,
) -> Fit:
    """Fit the values `free` (f,) of (p,) and the states (K, 3), starting from those given.

    `mean` (p,) is that of the priors. With `gated`, outlying poses and steps are left out, else the weights of `nodes`
    stay. With `quiet`, the noise stays as given.
    """
    yaw, prior = model.index("sensor_yaw"), model.prior
    measured = Nodes.of(nodes.drives)
    trimmed, converged, changed = _trimming(nodes, measured), False, 0.0 if quiet else np.inf
    if gated:
        bad, lasting = far_off(model, measured, states, values)
        nodes = _without(measured, bad, lasting)
    found = residuals(model, nodes, states, values)
    for k in range(_ROUNDS):
        step = solve(found, nodes, noise, free, yaw, prior, values - mean)
        states, values, found = _advanced(model, nodes, noise, states, values, found, free, step, mean)
        errors = 1 / np.sqrt(np.maximum(np.diag(step.information), 1e-300))
        moved = float(np.abs(step.values / errors).max(initial=0.0))
        if not quiet and (moved < _SETTLED or k % (1 if changed > _LOUD else 2 if changed > _QUIET else 4) == 0):
            before = noise
            noise = updated(model, found, nodes, noise, free, prior, trimmed)
            changed = float(np.abs(np.log(noise.values / before.values)).max())
        if gated and 1 < k <= _GATED:
            nodes = _gated(model, measured, found, noise, states, values)
            trimmed = _trimming(nodes, measured)
            found = residuals(model, nodes, states, values)
        if moved < _SETTLED and changed < _QUIET and (not gated or k > _MIN_ROUNDS):
            converged = True
            break
    step = solve(found, nodes, noise, free, yaw, prior, values - mean)
    return Fit(model, nodes, states, values, free, noise, found, step, mean, converged)


def _advanced(
    model: DriveModel,
    nodes: Nodes,
    noise: Noise,
    states: Array,
    values: Array,
    found: Residuals,
    free: np.ndarray,
    step: Solution,
    mean: Array,
) -> tuple[Array, Array, Residuals]:
    """States, values and residuals after a step, halved until the cost doesn't rise."""
    low, high, _ = model.limits

    def total(residual: Residuals, at: Array) -> float:
        return cost(residual, nodes, noise) + float(np.sum(((at - mean)[free] / model.prior[free]) ** 2))

    now = total(found, values)
    share = 1.0
    for _ in range(_HALVINGS):
        tried = values.copy()
        tried[free] = np.clip(values[free] + share * step.values, low[free], high[free])
        moved = states + share * step.states
        there = residuals(model, nodes, moved, tried)
        if total(there, tried) <= now * (1 + 1e-9) + 1e-9:
            return moved, tried, there
        share /= 2
    return moved, tried, there


def _gated(model: DriveModel, measured: Nodes, found: Residuals, noise: Noise, states: Array, values: Array) -> Nodes:
    """The nodes without poses and steps whose residuals are too large, and without steps across lasting jumps."""
    _, lasting = far_off(model, measured, states, values)
    pose = _pose_residuals(model, measured, states, values)
    squares = (measured.weight[:, [0, 0, 1]] * (pose / noise.values[[0, 0, 1]]) ** 2).sum(axis=1)
    far = squares > scipy.stats.chi2.ppf(_GATE, 2 + measured.weight[:, 1])
    scaled = found.step / np.sqrt(found.distance)[:, None] / noise.values[2:]
    slipped = (scaled**2).sum(axis=1) > scipy.stats.chi2.ppf(_STEP_GATE, 3)
    return _without(measured, far, slipped | lasting)


def _without(measured: Nodes, poses: np.ndarray, steps: np.ndarray) -> Nodes:
    """The nodes without poses (K,) bool and steps (K - 1,) bool."""
    return replace(
        measured,
        weight=np.where(poses[:, None], 0.0, measured.weight),
        link=np.where(steps, 0.0, measured.link),
    )


def _pose_residuals(model: DriveModel, measured: Nodes, states: Array, values: Array) -> Array:
    pose = states - np.where(np.isfinite(measured.pose), measured.pose, states)
    turn = pose[:, 2] + np.where(np.isfinite(measured.pose[:, 2]), values[model.index("sensor_yaw")], 0.0)
    pose[:, 2] = wrap_angle(turn)
    return pose


def _trimming(nodes: Nodes, measured: Nodes) -> float:
    """Expected share of the variance of normal poses within the gate; 1 where nothing is left out."""
    if (nodes.weight == measured.weight).all():
        return 1.0
    kinds = 3 if measured.weight[:, 1].any() else 2
    gate = scipy.stats.chi2.ppf(_GATE, kinds)
    return float(scipy.stats.chi2.cdf(gate, kinds + 2) / _GATE)


def far_off(model: DriveModel, nodes: Nodes, states: Array, values: Array) -> tuple[np.ndarray, np.ndarray]:
    """Poses (K,) bool that their neighbours' dead reckoning misses far, and steps (K - 1,) bool with lasting jumps."""
    poses, steps = np.zeros(len(nodes.pose), bool), np.zeros(len(nodes.pose) - 1, bool)
    for drive, begin in zip(nodes.drives, nodes.first, strict=False):
        rows = np.flatnonzero(nodes.weight[begin : begin + len(drive.time), 0])
        path = model.sensor_path(values, drive)[rows]
        bad, jumped = outlying(nodes.pose[begin + rows], states[begin + rows], path)
        poses[begin + rows[bad]] = True
        steps[begin + rows[jumped] - 1] = True
    return poses, steps
