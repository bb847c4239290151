"""Predictive control within the tracks' limits: linear, nonlinear, and by path integrals.

F. Kühne, J. M. Gomes da Silva Jr. and W. F. Lages, "Mobile robot trajectory tracking using model
predictive control", II IEEE Latin-American Robotics Symposium 2005; M. Diehl, H. G. Bock and J. P.
Schlöder, "A real-time iteration scheme for nonlinear optimization in optimal feedback control",
SIAM J. Control and Optimization 43(5), 2005; G. Williams, A. Aldrich and E. A. Theodorou, "Model
predictive path integral control: from theory to parallel computation", J. Guidance, Control, and
Dynamics 40(2), 2017, in the information-theoretic form of IEEE Trans. Robotics 34(6), 2018.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip import se2
from trackslip.controllers.base import ControlLaw, Memory
from trackslip.errors import require_whole
from trackslip.kinematics import Array, track_speeds, twist_of_tracks, wrap_angle
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

_NEWTON_SHARES: Final = np.append(0.5 ** np.arange(20), 0.0)
"""Step lengths tried, as fractions of a Newton step [-]; 0 is the best if no other lowers the
cost.
"""
_CONVERGED: Final = 1e-10  # change of each unknown in a step below which it has converged
# further steps would only move rounding errors in ill-conditioned problems
_MAX_NEWTON_STEPS: Final = 100


@dataclass(frozen=True)
class Horizon(ControlLaw, ABC):
    """Base class of laws that minimise errors predicted for plans.

    A plan is the limited speeds of both tracks in each of K intervals. Each call shifts the plan
    from the previous call in time, improves the plan, and drives its first twist. If a robot's pose
    is not finite, its plan is only shifted.
    """

    intervals: int = 15
    """K, number of intervals in the horizon [-]."""
    interval: float = 0.2
    """Duration of an interval [s]."""
    position_scale: float = 0.1
    """Error in x or y that costs 1 [m]."""
    heading_scale: float = 0.6
    """Heading error that costs 1 [rad]."""
    final_weight: float = 10.0
    """Factor by which errors at the end of the horizon cost more than earlier errors [-]."""
    track_speed: float = 0.295
    """Speed limit of each track, slightly below the 0.3 m/s of the sprockets [m/s]."""
    half_gauge: float = 0.213
    """With slip compensation the effective half gauge b + D, without it half the gauge [m]."""
    _memory: Memory[Array] = field(default_factory=Memory, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole("intervals", self.intervals, 1, 100)

    def reset(self) -> None:
        """Discard the plans; the next call may be for a different number of robots."""
        self._memory.reset()

    @property
    def weights(self) -> Array:
        """Weights (K, 3) of the squared errors (x, y, phi) after each interval.

        Their units are 1/m^2, 1/m^2 and 1/rad^2.
        """
        scales = np.array([self.position_scale, self.position_scale, self.heading_scale])
        weights = np.tile(scales**-2, (self.intervals, 1))
        weights[-1] *= self.final_weight
        return weights

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) for measured poses (..., 3) of as many robots as since `reset`."""
        # the reference in the horizon
        pose = np.asarray(pose, float)
        robots = pose.shape[:-1]
        edges = time + self.interval * np.arange(self.intervals + 1)
        middles = (edges[1:] + edges[:-1]) / 2
        desired = reference.pose(edges)
        twists = reference.twist(middles)  # (K, 2), taken as the means over the intervals

        # the last plans, shifted to this time, and improved for robots whose poses are known
        plans = self._first_guess(time, robots, twists).reshape(-1, self.intervals, 2).copy()
        poses = pose.reshape(-1, 3)
        (seen,) = np.isfinite(poses).all(axis=-1).nonzero()
        if seen.size:
            plans[seen] = self._improved(time, plans[seen], poses[seen], desired, twists)
        plans = plans.reshape(*robots, self.intervals, 2)

        self._memory.store(time, robots, plans)
        return twist_of_tracks(plans[..., 0, :], self.half_gauge)

    @abstractmethod
    def _improved(
        self, time: float, plans: Array, poses: Array, desired: Array, twists: Array
    ) -> Array:
        """Improved versions (R, K, 2) of the plans (R, K, 2), for robots at poses (R, 3).

        `desired` (K + 1, 3) are the reference's poses at the edges of the intervals from `time`
        [s], `twists` (K, 2) its mean twists in them.
        """

    def _first_guess(self, time: float, robots: tuple[int, ...], twists: Array) -> Array:
        """Shifted plans (..., K, 2) of the last call; in the first call, the reference's twists."""
        recalled = self._memory.recall(time, robots)
        if recalled is None:
            speeds = track_speeds(twists, self.half_gauge)
            limited = np.clip(speeds, -self.track_speed, self.track_speed)
            return np.broadcast_to(limited, (*robots, self.intervals, 2))
        elapsed, plans = recalled
        return self._shifted(plans, elapsed)

    def _shifted(self, plans: Array, elapsed: float) -> Array:
        """Plans (..., K, 2) shifted by `elapsed` [s] and extended with their last speeds."""
        last = self.intervals - 1
        place = np.minimum(np.arange(self.intervals) + elapsed / self.interval, last)
        # linear interpolation between the intervals before and after a place
        before = np.minimum(place.astype(int), max(last - 1, 0))
        after = np.minimum(before + 1, last)
        share = (place - before)[:, None]
        return (1 - share) * plans[..., before, :] + share * plans[..., after, :]


@dataclass(frozen=True)
class _LeastSquares(Horizon, ABC):
    """Base class of laws that minimise squares of errors and track speeds in linearised motion.

    With the errors d (3 K) of the poses predicted for the track speeds s (2 K), and the Jacobian E
    of the poses by the speeds, other speeds u have the cost

        |W (d + E (u - s))|^2 + |u - u_d|^2 / c^2

    where W holds the roots of the errors' weights, u_d are the reference's track speeds and c is
    `speed_scale`. The cost is u H u - 2 b u plus a constant, with

        H = (W E)' (W E) + 1 / c^2        b = (W E)' (W E s - W d) + u_d / c^2
    """

    speed_scale: float = 0.12
    """Deviation of a track speed from the reference that costs 1 [m/s]."""

    def _predicted(self, start: Array, plans: Array) -> tuple[Array, Array]:
        """Poses (R, K, 3) from `start` (R, 3) by `plans` (R, K, 2), and Jacobians (R, 3 K, 2 K).

        Positions are sums of the chords of all intervals so far. A track speed in interval j thus
        moves the end of interval k >= j like the end of interval j, and its turn rotates the
        vector (x, y) from the latter to the former by (-y, x) per rad.
        """
        motion = np.zeros((*plans.shape[:-1], 3))  # forwards, to the left, turn
        motion[..., ::2] = self.interval * twist_of_tracks(plans, self.half_gauge)
        turn = motion[..., 2]
        heading = start[:, None, 2] + np.cumsum(turn, axis=1)

        # each interval alone, from the origin with the heading at its start
        origins = np.zeros_like(motion)
        origins[..., 2] = heading - turn
        reached, _, by_motion = se2.drive(origins, motion)
        motion_by_speeds = self.interval * twist_of_tracks(np.eye(2), self.half_gauge).T
        by_speeds = by_motion[..., ::2] @ motion_by_speeds  # (R, K, 3, 2)

        # all intervals in sequence
        reached[..., :2] = start[:, None, :2] + np.cumsum(reached[..., :2], axis=1)
        from_j_to_k = reached[:, :, None] - reached[:, None]  # (R, k, j, 3)
        turn_by_speeds = by_speeds[:, None, :, 2]  # (R, 1, j, 2)
        effect = np.repeat(by_speeds[:, None], self.intervals, axis=1)  # (R, k, j, 3, 2)
        effect[..., 0, :] -= from_j_to_k[..., 1, None] * turn_by_speeds
        effect[..., 1, :] += from_j_to_k[..., 0, None] * turn_by_speeds
        # no effect on the ends of earlier intervals
        effect *= np.tri(self.intervals)[:, :, None, None]
        rows = 3 * self.intervals
        columns = 2 * self.intervals
        return reached, effect.swapaxes(2, 3).reshape(-1, rows, columns)

    def _optimum(self, plans: Array, errors: Array, effect: Array, wanted: Array) -> Array:
        """Best plans (R, K, 2) where `plans` s lead to the `errors` d (R, K, 3).

        `effect` (R, 3 K, 2 K) is E, `wanted` (K, 2) is u_d.
        """
        count = len(plans)
        root = np.sqrt(self.weights).reshape(-1, 1)
        weighted_effect = root * effect
        weighted_errors = root * errors.reshape(count, -1, 1)
        transposed = weighted_effect.swapaxes(1, 2)
        speeds = plans.reshape(count, -1, 1)
        scale_squared = self.speed_scale**2

        hessian = transposed @ weighted_effect + np.eye(wanted.size) / scale_squared
        residual = weighted_effect @ speeds - weighted_errors
        right = transposed @ residual + wanted.reshape(-1, 1) / scale_squared
        return bounded_optimum(hessian, right[..., 0], self.track_speed).reshape(plans.shape)


@dataclass(frozen=True)
class LinearPredictive(_LeastSquares):
    """Law that minimises errors predicted by motion linearised about the reference.

    Track speeds are limited. The path at the reference's mean track speeds stands for the
    reference. A robot with these speeds keeps its first error (x, y, turn) in the frame of the
    reference's first pose, and its path is turned by this error: at the point (p, q) of the path,
    its error is (x - turn q, y + turn p, turn).
    """

    def _improved(
        self, time: float, plans: Array, poses: Array, desired: Array, twists: Array
    ) -> Array:
        wanted = track_speeds(twists, self.half_gauge)
        path, effect = self._predicted(np.zeros((1, 3)), wanted[None])
        # (R, 1, 3) of the robots, to first order the same in their frames and the reference's
        first_errors = -body_errors(poses, desired[0])[:, None]
        x, y, turn = np.moveaxis(first_errors, -1, 0)
        later_x = x - turn * path[..., 1]
        later_y = y + turn * path[..., 0]
        later_turn = np.broadcast_to(turn, later_x.shape)
        errors = np.stack([later_x, later_y, later_turn], axis=-1)
        return self._optimum(np.broadcast_to(wanted, plans.shape), errors, effect, wanted)


@dataclass(frozen=True)
class ModelPredictive(_LeastSquares):
    """Law that minimises errors predicted by the unicycle's motion, within track speed limits.

    Each call takes a few Gauss-Newton steps from the shifted plan of the previous call (real-time
    iteration).
    """

    iterations: int = 3
    """Number of Gauss-Newton steps per call [-]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole("iterations", self.iterations, 1, 100)

    def _improved(
        self, time: float, plans: Array, poses: Array, desired: Array, twists: Array
    ) -> Array:
        wanted = track_speeds(twists, self.half_gauge)
        start = poses.copy()
        # within half a turn of the reference's heading, which is unwrapped
        start[:, 2] = desired[0, 2] + wrap_angle(start[:, 2] - desired[0, 2])
        for _ in range(self.iterations):
            reached, effect = self._predicted(start, plans)
            plans = self._optimum(plans, reached - desired[1:], effect, wanted)
        return plans


def bounded_optimum(hessian: Array, right: Array, bound: float) -> Array:
    """Vectors u (R, n) within +-`bound` that minimise u H u / 2 - b u.

    H (R, n, n) or (1, n, n) is `hessian`, and b (R, n) is `right`. The solver is the projected
    Newton method of D. P. Bertsekas, SIAM J. Control and Optimization 20(2), 1982. It is applied
    to the rows whose optimum without bounds is out of bounds, each until it has converged.
    """

    def solved(matrices: Array, vectors: Array) -> Array:
        return np.asarray(np.linalg.solve(matrices, vectors[..., None])[..., 0])

    def times(matrices: Array, vectors: Array) -> Array:
        return np.asarray((matrices @ vectors[..., None])[..., 0])

    optimum = solved(hessian, right)
    (rows,) = np.nonzero(np.abs(optimum).max(axis=1) > bound)
    optimum = np.clip(optimum, -bound, bound)
    hessian = np.broadcast_to(hessian, (len(right), *hessian.shape[1:]))
    for _ in range(_MAX_NEWTON_STEPS):
        if not rows.size:
            break
        h = hessian[rows]
        u = optimum[rows]
        slope = times(h, u) - right[rows]

        # a Newton step of the unknowns that no bound stops on their way downhill
        inside = np.abs(u) < bound
        leaves_bound = u * slope > 0
        free = inside | leaves_bound
        both_free = free[:, :, None] & free[:, None]
        reduced = np.where(both_free, h, np.eye(u.shape[1]))
        newton = solved(reduced, np.where(free, -slope, 0.0))

        # the best of several lengths of that step, each cut off at the bounds
        ends = u + _NEWTON_SHARES[:, None, None] * newton  # (shares, rows, n)
        changes = np.clip(ends, -bound, bound) - u
        costs = (changes * (times(h, changes) / 2 + slope)).sum(axis=-1)
        best = costs.argmin(axis=0)
        change = changes[best, np.arange(len(rows))]
        optimum[rows] = np.clip(u + change, -bound, bound)

        still_moving = np.abs(change).max(axis=1) > _CONVERGED
        rows = rows[still_moving]
    return optimum


@dataclass(frozen=True)
class PathIntegral(Horizon):
    """Law that drives the mean of sampled plans, weighted by exp(-cost / temperature).

    Samples are normally distributed about the shifted plan of the previous call, in pairs of
    opposite deviations, and clipped to the track speed limits. The uncontrolled motion is the
    reference motion, so a deviation d from the reference's track speed costs temperature d^2 / (2
    noise^2): with many samples and no active limit, the plan is that of model predictive control
    with speed_scale = noise sqrt(2 / temperature). The random numbers depend only on the seed and
    the time, so a robot's twist depends only on its own poses.
    """

    samples: int = 400
    """Number of sampled plans, rounded up to an even number [-]."""
    noise: float = 0.03
    """Standard deviation of the sampled track speeds in each interval [m/s]."""
    temperature: float = 0.125
    """Temperature lambda, in units of the cost [-]."""
    seed: int = 1
    """Seed of the random numbers [-]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole("samples", self.samples, 2, 10_000)
        require_whole("seed", self.seed, 1)

    def _improved(
        self, time: float, plans: Array, poses: Array, desired: Array, twists: Array
    ) -> Array:
        microseconds = round(1e6 * time) % 2**63  # a seed can't be negative
        generator = np.random.default_rng([self.seed, microseconds])
        pairs = (self.samples + 1) // 2
        half = generator.normal(0.0, self.noise, (pairs, self.intervals, 2))
        deviations = np.concatenate([half, -half])  # (M, K, 2)
        speeds = track_speeds(twists, self.half_gauge)  # (K, 2)
        better = [
            self._averaged(plan, pose, deviations, desired[1:], speeds)
            for plan, pose in zip(plans, poses, strict=True)
        ]
        return np.stack(better)

    def _averaged(
        self, plan: Array, pose: Array, deviations: Array, desired: Array, speeds: Array
    ) -> Array:
        """Weighted mean (K, 2) of the samples `plan` + `deviations` (M, K, 2) from `pose` (3,).

        A sample's weight is exp(-S), with the information-theoretic cost

            S = errors' cost / temperature + sum((plan - speeds) deviation) / noise^2

        of the errors from the `desired` poses (K, 3), and of the deviation from the reference's
        track `speeds` (K, 2).
        """
        sampled = np.clip(plan + deviations, -self.track_speed, self.track_speed)  # (M, K, 2)
        squares = self._errors(pose, sampled, desired) ** 2
        cost = (squares * self.weights).sum(axis=(1, 2)) / self.temperature
        cost += ((plan - speeds) * deviations).sum(axis=(1, 2)) / self.noise**2
        weight = np.exp(cost.min() - cost)
        weighted = weight[:, None, None] * sampled
        return np.asarray(weighted.sum(axis=0) / weight.sum())

    def _errors(self, pose: Array, plans: Array, desired: Array) -> Array:
        """Errors (M, K, 3) of the poses after each interval of `plans` (M, K, 2) from `pose` (3,).

        For speed, arcs are replaced by chords of length arc (1 - turn^2 / 24), short by less than
        turn^4 / 1920 of the arc, which are parallel to the heading in the middle of the arc.
        """
        v, w = np.moveaxis(twist_of_tracks(plans, self.half_gauge), -1, 0)  # (M, K)
        heading = pose[2] + np.cumsum(w, axis=-1) * self.interval
        middle = heading - w * (self.interval / 2)
        turn = w * self.interval
        chord = v * self.interval * (1 - turn**2 / 24)
        x_moved = np.cumsum(chord * np.cos(middle), axis=-1)
        y_moved = np.cumsum(chord * np.sin(middle), axis=-1)

        x_error = pose[0] - desired[:, 0] + x_moved
        y_error = pose[1] - desired[:, 1] + y_moved
        heading_error = wrap_angle(heading - desired[:, 2])
        return np.stack([x_error, y_error, heading_error], axis=-1)
