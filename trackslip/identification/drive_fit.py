"""The most likely trajectory and parameters of drives, with their noise: Gauss-Newton steps, REML and gates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from trackslip.identification.drive_equations import GaussNewtonStep, solve, used_up
from trackslip.identification.drive_model import DriveModel
from trackslip.identification.drive_residuals import Nodes, Noise, Residuals, cost, pose_residuals, residuals, weights
from trackslip.identification.outliers import outlying
from trackslip.kinematics import Array

_ROUNDS = 45  # maximum number of Gauss-Newton steps
_GATED = 12  # rounds after which gates stay as they are
_JUDGED = (3, 8)  # rounds at which lasting jumps are looked for again
_KINKED = 15  # rounds after which a clock offset that still moves is at a kink of the cost
_SEARCHED, _SEARCHES, _CLOCKS, _FOLLOWING = 0.1, 6, 9, 2  # clock offsets: range [s], rounds, number; steps at each
_FOUND = 1e-3  # range at which a search for a clock offset ends [s]
_HALVINGS = 6
_STUCK = 3  # rounds without a step that lowers the cost, after which there will be none
_SETTLED = 0.03  # change of the values, in standard errors
_QUIET = 0.02  # relative change of the standard deviations of settled noise
_LOUD = 0.1  # relative change of standard deviations far from settled
_MIN_ROUNDS = 3  # before which gates may still change
_GATE = 0.99  # quantile beyond which a pose or a step counts less
_FAR = 3.0  # distance from which it is left out altogether [gates]
FIRST = np.array([0.02, 0.02, 0.005, 0.005, 0.01, 0.05, 0.05, 0.01])
"""A first guess of the noise, with a gyro."""
_FLOOR = np.array([1e-4, 1e-4, 1e-4, 1e-4, 2e-4, 1e-3, 1e-3, 3e-5])  # below which noise doesn't matter
_AVOIDED = np.array([0, 0, 1.0, 1.0, 1.0, 0, 0, 1.0])  # power of a standard deviation in its prior: 0 is avoided
_MIN_FREEDOM = 0.25
_RELAXATION = 1.5  # exponent of a change at first: small steps are usual
_EXPONENTS = (0.5, 3.0)  # its limits
_SMALL = 0.3  # changes of logarithms beyond which the exponent doesn't grow
_FAINT = 1e-4  # changes of logarithms that tell nothing
_WILD = 0.3  # standard deviation of slip that no driving on the ground shows [m/sqrt(m), rad/sqrt(m)]
_HARDLY = 0.1  # likewise, that makes one doubt a drive which tells nothing else
_UNITS = ("m/√m", "m/√m", "rad/√m")
_MAX_CHANGE = 16.0  # factor of variances in one update


@dataclass(frozen=True)
class TrajectoryFit:
    """A fit of a model to drives."""

    model: DriveModel
    nodes: Nodes  # with the weights that the gates left
    states: Array  # (K, 3) sensor's positions [m] and robot's headings [rad]
    values: Array  # (p,) of all parameters
    free: np.ndarray  # (f,) indices of those that were fitted
    noise: Noise
    residuals: Residuals
    solution: GaussNewtonStep  # the last step, for information and scores
    mean: Array  # (p,) of the priors
    converged: bool

    @property
    def deviance(self) -> float:
        """-2 log likelihood of the poses, but for a constant that all laws share that are fitted to the same poses."""
        poses, steps = weights(self.residuals, self.nodes, self.noise)
        logs = sum(float(np.log(part[part > 0]).sum()) for part in (poses, steps))
        if (white := self.nodes.whitening) is not None:
            sizes = np.stack([np.linalg.det(white[:, :2, :2]), white[:, 2, 2]], axis=-1)
            logs += 2 * float((self.nodes.weight * np.log(sizes)).sum())
        determinant = 2 * float(np.log(self.solution.factor[0]).sum())
        return cost(self.residuals, self.nodes, self.noise) + determinant - logs

    @property
    def covariance(self) -> Array:
        """Covariance (f, f) of the free values by the model."""
        return np.linalg.inv(self.solution.information)


def fit_trajectory(
    model: DriveModel,
    nodes: Nodes,
    states: Array,
    values: Array,
    noise: Noise,
    free: np.ndarray,
    mean: Array,
    gated: bool = True,
    quiet: bool = False,
    rounds: int | None = None,
) -> TrajectoryFit:
    """Fit the values `free` (f,) of (p,) and the states (K, 3), starting from those given.

    `mean` (p,) are the means of the priors. With `gated`, outlying poses and steps are left out, else the weights of
    `nodes` stay. With `quiet`, the noise stays as given. At most `rounds` steps are made. The cost has a kink in the
    clock offset wherever a pose's time meets an encoder's: a minimum there is no zero of the slope, and need not be the
    lowest. So a clock offset, or a lag, that goes on moving while the others have settled is held: with `gated`, when
    the best has been searched for, else where the cost fell last.
    """
    yaw, clock, prior = model.index("sensor_yaw"), model.index("clock_offset"), model.prior
    timing, measured = (clock, model.index("lag")), Nodes.of(nodes.drives)
    converged, changed = False, 0.0 if quiet else np.inf
    iterate, stuck = Iterate.at(noise), 0
    found = residuals(model, nodes, states, values, free)
    if gated:
        far, lasting = far_off(model, measured, states, values, found.path)
        nodes = replace(
            measured,
            weight=np.where(far[:, None], 0.0, measured.weight),
            link=np.where(lasting, 0.0, measured.link),
        )
        found = replace(found, pose=pose_residuals(model, nodes, states, values))
    for k in range(rounds or _ROUNDS):
        step = solve(found, nodes, iterate.noise, yaw, prior, values - mean)
        before, linear = iterate.noise, found
        change, by = step.limited(*model.room(values, linear.free))
        errors = 1 / np.sqrt(np.maximum(np.diag(step.information), 1e-300))
        moves = np.abs((model.moved(values, linear.free, by) - values)[linear.free] / errors)
        moved = float(moves.max(initial=0.0))
        states, values, found = _advanced(model, nodes, before, states, values, found, change, by, mean)
        stuck = stuck + 1 if found is linear else 0
        if not quiet and (moved < _SETTLED or k % (1 if changed > _LOUD else 2 if changed > _QUIET else 4) == 0):
            used = used_up(linear, nodes, before, step, yaw)
            iterate = iterate.updated(found, nodes, used)
            changed = iterate.effect
        if gated and 1 < k <= _GATED:
            if k in _JUDGED:
                _, lasting = far_off(model, measured, states, values, found.path)
            nodes = _gated(model, measured, found, iterate.noise, states, values, lasting)
            found = replace(found, pose=pose_residuals(model, nodes, states, values))
        if moved < _SETTLED and changed < _QUIET and (not gated or k > _MIN_ROUNDS):
            converged = True
            break
        at_rest = stuck >= _STUCK and changed < _QUIET and not gated
        if at_rest and (quiet or clock not in found.free):
            break
        if (at_rest or k >= _KINKED) and moved >= _SETTLED and (mover := linear.free[moves.argmax()]) in timing:
            found, stuck = found.without(mover), 0
            if gated:
                states, values, found = _at_best_clock(model, nodes, iterate.noise, states, values, found, mean)
    found = residuals(model, nodes, states, values, free)
    step = solve(found, nodes, iterate.noise, yaw, prior, values - mean)
    return TrajectoryFit(model, nodes, states, values, free, iterate.noise, found, step, mean, converged)


def _at_best_clock(
    model: DriveModel, nodes: Nodes, noise: Noise, states: Array, values: Array, found: Residuals, mean: Array
) -> tuple[Array, Array, Residuals]:
    """States, values and residuals at the clock offset of the smallest cost around the present one, to a millisecond.

    The other parameters of `found` follow each clock offset in Gauss-Newton steps.
    """
    clock, yaw, prior = model.index("clock_offset"), model.index("sensor_yaw"), model.prior
    best, width = (np.inf, states, values, found), _SEARCHED
    for _ in range(_SEARCHES):
        middle = best[2][clock]
        for offset in np.clip(middle + width * np.linspace(-1, 1, _CLOCKS), *model.limits[:2, clock]):
            _, at, tried, there = best
            tried = tried.copy()
            tried[clock] = offset
            there = residuals(model, nodes, at, tried, found.free)
            for _ in range(_FOLLOWING):
                step = solve(there, nodes, noise, yaw, prior, tried - mean)
                by = step.limited(*model.room(tried, found.free))
                at, tried, there = _advanced(model, nodes, noise, at, tried, there, *by, mean)
            total = cost(there.weighted_as(found), nodes, noise)
            if total < best[0]:
                best = (total, at, tried, there)
        if abs(best[2][clock] - middle) < 0.9 * width:  # not at the edge
            width /= 4
            if width < _FOUND:
                break
    return best[1:]


def _advanced(
    model: DriveModel,
    nodes: Nodes,
    noise: Noise,
    states: Array,
    values: Array,
    found: Residuals,
    change: Array,
    by: Array,
    mean: Array,
) -> tuple[Array, Array, Residuals]:
    """States, values and residuals after a step, `change` (K, 3) and `by` (f,), halved until the cost doesn't rise.

    If it still rises, they stay as they are. The variances are those at the start: that they change with the speed and
    the distance driven is no part of the step.
    """
    free, none = found.free, found.free[:0]

    def total(residual: Residuals, at: Array) -> float:
        pull = (at - mean)[free] / model.prior[free]
        return cost(residual.weighted_as(found), nodes, noise) + float(pull @ pull)

    now = total(found, values) * (1 + 1e-9) + 1e-9
    for halving in range(_HALVINGS):
        tried = model.moved(values, free, by / 2**halving)
        moved = states + change / 2**halving
        there = residuals(model, nodes, moved, tried, none if halving else free)
        if total(there, tried) <= now:
            return moved, tried, residuals(model, nodes, moved, tried, free) if halving else there
    return states, values, found


def _gated(
    model: DriveModel,
    measured: Nodes,
    found: Residuals,
    noise: Noise,
    states: Array,
    values: Array,
    lasting: np.ndarray,
) -> Nodes:
    """The nodes with poses and steps that count the less the larger their residuals, and not at all across jumps."""
    pose = pose_residuals(model, measured, states, values)
    squares = (weights(found, measured, noise)[0] * pose**2).sum(axis=1)
    kept = _robust(squares, scipy.special.chdtri(2 + measured.weight[:, 1], 1 - _GATE))
    scaled = (found.step / np.sqrt(found.distance) / noise.of_steps)[:, :3]
    followed = _robust((scaled**2).sum(axis=1), scipy.special.chdtri(3, 1 - _GATE))
    return replace(
        measured, weight=measured.weight * kept[:, None], link=np.where(lasting, 0.0, measured.link * followed)
    )


def _robust(squares: Array, gate: float | Array) -> Array:
    """Huber's weights (n,) of squared residuals (n,): 1 within the gate, less beyond, and 0 for those far beyond."""
    return np.where(squares > _FAR**2 * gate, 0.0, np.sqrt(gate / np.maximum(squares, gate)))


def far_off(
    model: DriveModel, nodes: Nodes, states: Array, values: Array, path: Array
) -> tuple[np.ndarray, np.ndarray]:
    """Poses (K,) bool that their neighbours' dead reckoning misses far, and steps (K - 1,) bool with lasting jumps.

    `path` (K, 3) is that of the turning centre.
    """
    poses, steps = np.zeros(len(nodes.pose), bool), np.zeros(len(nodes.pose) - 1, bool)
    of_sensor = model.of_sensor(values, path)
    for begin, end in pairwise(nodes.first):
        rows = begin + np.flatnonzero(nodes.weight[begin:end, 0])
        bad, jumped = outlying(nodes.pose[rows], states[rows], of_sensor[rows])
        poses[rows[bad]] = True
        steps[rows[jumped] - 1] = True
    return poses, steps


@dataclass(frozen=True)
class Iterate:
    """An iterate of the noise, and how it was reached."""

    noise: Noise
    change: Array  # (7,) last change of the logarithm of each standard deviation; NaN at first
    exponent: Array  # (7,) power of the ratio of variances by which each was changed
    effect: float = np.inf  # largest change, relative to the standard deviation that the kind is a part of

    @classmethod
    def at(cls, noise: Noise) -> Iterate:
        """A first iterate."""
        return cls(noise, np.full(len(noise.values), np.nan), np.full(len(noise.values), _RELAXATION))

    def updated(self, found: Residuals, nodes: Nodes, used: Array) -> Iterate:
        """The next iterate, from residuals at the trajectory that this one led to.

        Each variance is the weighted sum of its squares over that of its residuals less those `used` (7,) up by the
        trajectory and the parameters. Huber's weights take less than half a percent of the variance of normal poses.
        """
        poses, steps = weights(found, nodes, self.noise)
        scaled = poses * found.pose**2
        rest, grown = self.noise.of_poses(found.rate)
        moving, count = grown / (rest + grown), nodes.weight * [2, 1]
        square = np.column_stack([scaled[:, 0] + scaled[:, 1], scaled[:, 2]])
        by_steps = (steps * found.step**2).sum(axis=0)

        def of_kinds(of_poses: Array, of_steps: Array) -> Array:
            rest, grown = ((share * of_poses).sum(axis=0) for share in (1 - moving, moving))
            return np.concatenate([rest, of_steps[:3], grown, of_steps[3:]])

        known = (nodes.link[:, None] * np.isfinite(found.distance)).sum(axis=0) * np.ones(steps.shape[1])
        counts, squares = of_kinds(count, known), of_kinds(square, by_steps)
        before = self.noise.values
        ratio = squares / np.maximum(counts - used - _AVOIDED[: len(counts)], _MIN_FREEDOM)
        ratio = np.clip(ratio, 1 / _MAX_CHANGE, _MAX_CHANGE)
        values = np.maximum(before * ratio ** (self.exponent / 2), _FLOOR[: len(counts)])
        values = np.where(counts > 0, values, before)
        change = np.log(values / before)
        total = count.sum(axis=0)
        of_kind = np.maximum(np.concatenate([total, known[:3], total, known[3:]]), 1.0)
        effect = float(np.max(np.abs(change) * counts / of_kind))
        return Iterate(Noise(values), change, self._exponent(change), effect)

    def _exponent(self, change: Array) -> Array:
        """Powers (7,) that would have led to the limit at once, as far as the last two changes tell."""
        with np.errstate(divide="ignore", invalid="ignore"):
            found = self.exponent / (1 - change / self.change)
        found = np.clip(np.where(found > 0, found, _EXPONENTS[1]), *_EXPONENTS)
        found = np.where(np.abs([change, self.change]).max(axis=0) < _SMALL, found, np.minimum(found, self.exponent))
        return np.where(np.abs(self.change) > _FAINT, found, self.exponent)


def unlike_sprockets(noise: Noise, hopeless: bool = False) -> str:
    """Words for slip so large that the motion hardly depends on the sprocket speeds; empty if it does.

    A drive from which nothing else follows, a `hopeless` one, is doubted earlier.
    """
    most = _HARDLY if hopeless else _WILD
    slips = dict(zip(Noise.NAMES[2:5], noise.values[2:5].tolist(), strict=True))
    wild = [
        f"{name} = {value:.2g} {unit}"
        for (name, value), unit in zip(slips.items(), _UNITS, strict=True)
        if value > most
    ]
    if not wild:
        return ""
    return f"the motion hardly follows the sprockets ({', '.join(wild)}): are units, gear, signs and clocks right?"
