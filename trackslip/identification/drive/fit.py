"""The most likely trajectory and parameters of drives, with their noise: Gauss-Newton steps, REML and gates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from trackslip.identification.drive.equations import Nodes, Noise, Residuals, Solution, cost, residuals, solve
from trackslip.identification.drive.model import DriveModel
from trackslip.identification.drive.noise import updated
from trackslip.identification.drive.outliers import outlying
from trackslip.kinematics import Array

VERBOSE=False
_ROUNDS = 40  # maximum number of Gauss-Newton steps
_GATED = 12  # rounds after which gates stay as they are
_HALVINGS = 6
_SETTLED = 0.01  # change of the values, in standard errors
_QUIET = 0.02  # relative change of the standard deviations of settled noise
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
    def covariance(self) -> Array:
        """Covariance (f, f) of the free values by the model."""
        return np.linalg.inv(self.solution.information)


def fit(
    model: DriveModel, nodes: Nodes, states: Array, values: Array, noise: Noise, free: np.ndarray, mean: Array,
    rounds: int = _ROUNDS, gated: bool = True,
) -> Fit:
    """Fit the values `free` (f,) of (p,) and the states (K, 3), starting from those given.

    `mean` (p,) is that of the priors. With `gated`, outlying poses and steps are left out, else the weights of `nodes` stay.
    """
    yaw, prior = model.index("sensor_yaw"), model.prior
    measured = Nodes.of(nodes.drives)
    trimmed, converged, settled = _trimming(nodes, measured), False, 0
    found = residuals(model, nodes, states, values)
    for k in range(rounds):
        step = solve(found, nodes, noise, free, yaw, prior, values - mean)
        states, values, found = _advanced(model, nodes, noise, states, values, found, free, step, mean)
        errors = 1 / np.sqrt(np.maximum(np.diag(step.information), 1e-300))
        moved = float(np.abs(step.values / errors).max(initial=0.0))
        before = noise
        noise = updated(model, found, nodes, noise, free, prior, trimmed)
        changed = float(np.abs(np.log(noise.values / before.values)).max())
        if gated and 1 < k <= _GATED and moved < 3:
            nodes, trimmed = _gate(model, measured, found, noise, states, values, nodes)
            found = residuals(model, nodes, states, values)
        if VERBOSE: print(k,round(moved,4),round(changed,3),np.round(noise.values*1e3,3),(nodes.weight[:,0]==0).sum(),(nodes.link==0).sum())
        settled = settled + 1 if moved < _SETTLED and changed < _QUIET else 0
        if settled >= 1 and (not gated or k > 3):
            converged = True
            break
    step = solve(found, nodes, noise, free, yaw, prior, values - mean)
    return Fit(model, nodes, states, values, free, noise, found, step, mean, converged)


def _advanced(
    model: DriveModel, nodes: Nodes, noise: Noise, states: Array, values: Array, found: Residuals, free: np.ndarray,
    step: Solution, mean: Array,
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


def _gate(
    model: DriveModel, measured: Nodes, found: Residuals, noise: Noise, states: Array, values: Array, nodes: Nodes
) -> tuple[Nodes, float]:
    """Weights of poses and steps by their residuals, and the share of the variance that the poses left in keep."""
    weight, link = measured.weight.copy(), measured.link.copy()
    lasting = lasting_jumps(model, measured, states, values)
    link[lasting] = 0.0
    pose = _pose_residuals(model, measured, states, values)
    heading = weight[:, 1]
    squares = (weight[:, [0, 0, 1]] * (pose / noise.values[[0, 0, 1]]) ** 2).sum(axis=1)
    far = squares > scipy.stats.chi2.ppf(_GATE, 2 + heading)
    weight[far] = 0.0
    scaled = found.step / np.sqrt(found.distance)[:, None] / noise.values[2:]
    slipped = (scaled**2).sum(axis=1) > scipy.stats.chi2.ppf(_STEP_GATE, 3)
    link[slipped] = 0.0
    kept = replace(nodes, weight=weight, link=link)
    return kept, _trimming(kept, measured)


def _pose_residuals(model: DriveModel, measured: Nodes, states: Array, values: Array) -> Array:
    pose = states - np.where(np.isfinite(measured.pose), measured.pose, states)
    turn = pose[:, 2] + np.where(np.isfinite(measured.pose[:, 2]), values[model.index("sensor_yaw")], 0.0)
    pose[:, 2] = (turn + np.pi) % (2 * np.pi) - np.pi
    return pose


def _trimming(nodes: Nodes, measured: Nodes) -> float:
    """Expected share of the variance of normal poses within the gate; 1 where nothing is left out."""
    if (nodes.weight == measured.weight).all():
        return 1.0
    kinds = 3 if measured.weight[:, 1].any() else 2
    gate = scipy.stats.chi2.ppf(_GATE, kinds)
    return float(scipy.stats.chi2.cdf(gate, kinds + 2) / _GATE)


def lasting_jumps(model: DriveModel, nodes: Nodes, states: Array, values: Array) -> np.ndarray:
    """Indices of the steps over which the poses jump lastingly."""
    found = []
    for drive, begin in zip(nodes.drives, nodes.first, strict=False):
        rows = np.flatnonzero(nodes.weight[begin : begin + len(drive.time), 0])
        path = model.sensor_path(values, drive)[rows]
        _, jumped = outlying(nodes.pose[begin + rows], states[begin + rows], path)
        found.append(begin + rows[jumped] - 1)
    return np.concatenate(found)
