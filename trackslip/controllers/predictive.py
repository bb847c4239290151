"""Predictive control within the tracks' limits: linear time-varying, nonlinear, and by path
integrals.

F. Kühne, J. M. Gomes da Silva Jr. and W. F. Lages, "Mobile robot trajectory tracking using model
predictive control", II IEEE Latin-American Robotics Symposium 2005; M. Diehl, H. G. Bock and J. P.
Schlöder, "A real-time iteration scheme for nonlinear optimization in optimal feedback control",
SIAM J. Control and Optimization 43(5), 2005; G. Williams, A. Aldrich and E. A. Theodorou, "Model
predictive path integral control: from theory to parallel computation", J. Guidance, Control, and
Dynamics 40(2), 2017, in the information-theoretic form of IEEE Trans. Robotics 34(6), 2018.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip import se2
from trackslip.controllers.base import Remembering
from trackslip.errors import require_whole
from trackslip.kinematics import Array, track_speeds, twist_of_tracks, wrap_angle
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference


@dataclass(frozen=True)
class Horizon(Remembering, ABC):
    """Base class of laws that minimise predicted errors over plans, which are limited track speeds
    for K intervals.

    Each call shifts the plan from the previous call in time, improves the plan, and drives its
    first twist. If a robot's pose is not finite, its plan is only shifted.
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

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole("intervals", self.intervals, 1, 100)

    @property
    def weights(self) -> Array:
        """Weights (K, 3) of the squared errors (x, y, phi) after each interval [1/m^2, 1/m^2,
        1/rad^2].
        """
        weights = np.tile(
            [self.position_scale**-2, self.position_scale**-2, self.heading_scale**-2],
            (self.intervals, 1),
        )
        weights[-1] *= self.final_weight
        return weights

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) for measured poses (..., 3), whose shape must be that of the first call
        since `reset`.
        """
        pose = np.asarray(pose, float)
        nodes = time + self.interval * np.arange(self.intervals + 1)
        twists = reference.twist((nodes[1:] + nodes[:-1]) / 2)  # (K, 2), interval means
        wanted = track_speeds(twists, self.half_gauge)
        shape = (*pose.shape[:-1], self.intervals, 2)
        elapsed = self._elapsed(time, pose.shape[:-1])
        if elapsed is None:
            plans = np.broadcast_to(np.clip(wanted, -self.track_speed, self.track_speed), shape)
        else:
            plans = self._shifted(self._kept["plans"], elapsed)
        (seen,) = np.isfinite(pose).all(axis=-1).ravel().nonzero()
        robots, better = pose.reshape(-1, 3)[seen], plans.reshape(-1, *shape[-2:]).copy()
        if seen.size:
            better[seen] = self._improved(time, better[seen], robots, reference.pose(nodes), twists)
        self._kept["plans"] = better.reshape(shape)
        return twist_of_tracks(self._kept["plans"][..., 0, :], self.half_gauge)

    @abstractmethod
    def _improved(
        self, time: float, plans: Array, pose: Array, poses: Array, twists: Array
    ) -> Array:
        """Improved versions (R, K, 2) of the plans (R, K, 2) at `time` [s], for robots at poses (R,
        3).

        `poses` (K + 1, 3) are the reference poses at the limits of the intervals, `twists` (K, 2)
        the mean twists.
        """

    def _shifted(self, plans: Array, elapsed: float) -> Array:
        """Plans (..., K, 2) shifted by `elapsed` [s] and extended with their last speeds."""
        last = self.intervals - 1
        later = np.minimum(np.arange(last + 1) + elapsed / self.interval, last)
        k = np.minimum(later.astype(int), max(last - 1, 0))
        share = (later - k)[:, None]
        return (1 - share) * plans[..., k, :] + share * plans[..., np.minimum(k + 1, last), :]


_SHARES = np.append(0.5 ** np.arange(20), 0.0)  # step lengths tried, as fractions of a Newton step
_STILL = 1e-10  # convergence threshold for the change of each unknown in a step
# maximum number of steps; further steps would only move rounding errors in ill-conditioned problems
_STEPS = 100


@dataclass(frozen=True)
class _LeastSquares(Horizon, ABC):
    """Base class of laws that minimise squares of predicted errors and track speed deviations in
    linearised motion.
    """

    speed_scale: float = 0.12
    """Deviation of a track speed from the reference that costs 1 [m/s]."""

    def _driven(self, pose: Array, plans: Array) -> tuple[Array, Array]:
        """Poses (R, K, 3) after the intervals of `plans` (R, K, 2) from `pose` (R, 3), and
        Jacobians (R, 3 K, 2 K).
        """
        motion = np.zeros((*plans.shape[:-1], 3))
        motion[..., ::2] = self.interval * twist_of_tracks(plans, self.half_gauge)
        starts = np.zeros_like(motion)
        starts[..., 2] = pose[:, None, 2] + np.cumsum(motion[..., 2], axis=1) - motion[..., 2]
        reached, _, by_motion = se2.drive(starts, motion)
        reached[..., :2] = pose[:, None, :2] + np.cumsum(reached[..., :2], axis=1)
        by_speeds = by_motion[..., ::2] @ (
            self.interval * twist_of_tracks(np.eye(2), self.half_gauge).T
        )
        # A turn in interval j also rotates the path between the ends of intervals j and k.
        x, y, _ = np.moveaxis(reached[:, :, None] - reached[:, None], -1, 0)  # (R, K, K)
        effect = np.repeat(by_speeds[:, None], self.intervals, axis=1)  # (R, k, j, 3, 2)
        effect[..., 0, :] -= y[..., None] * by_speeds[:, None, :, 2]
        effect[..., 1, :] += x[..., None] * by_speeds[:, None, :, 2]
        effect *= np.tri(self.intervals)[:, :, None, None]
        return reached, effect.swapaxes(2, 3).reshape(-1, 3 * self.intervals, 2 * self.intervals)

    def _optimum(self, plans: Array, deviation: Array, effect: Array, wanted: Array) -> Array:
        """Best plans (R, K, 2) if `plans` lead to the deviations (R, K, 3) from the reference
        poses.

        `effect` (R, 3 K, 2 K) maps plans to pose changes; `wanted` (K, 2) is the reference's track
        speeds.
        """
        root = np.sqrt(self.weights).reshape(-1, 1)
        effect, deviation = root * effect, root * deviation.reshape(len(plans), -1, 1)
        transposed, speeds = effect.swapaxes(1, 2), plans.reshape(len(plans), -1, 1)
        hessian = transposed @ effect + np.eye(wanted.size) / self.speed_scale**2
        right = (
            transposed @ (effect @ speeds - deviation) + wanted.reshape(-1, 1) / self.speed_scale**2
        )
        return bounded_optimum(hessian, right[..., 0], self.track_speed).reshape(plans.shape)


@dataclass(frozen=True)
class LinearPredictive(_LeastSquares):
    """Law that minimises errors predicted by motion linearised about the reference, within track
    speed limits.
    """

    def _improved(
        self, time: float, plans: Array, pose: Array, poses: Array, twists: Array
    ) -> Array:
        wanted = track_speeds(twists, self.half_gauge)
        # relative to the reference's first pose
        way, effect = self._driven(np.zeros((1, 3)), wanted[None])
        x, y, turn = np.moveaxis(-body_errors(pose, poses[0])[:, None], -1, 0)  # (R, 1) each
        x, y = x - turn * way[..., 1], y + turn * way[..., 0]
        deviation = np.stack([x, y, np.broadcast_to(turn, x.shape)], axis=-1)
        return self._optimum(np.broadcast_to(wanted, plans.shape), deviation, effect, wanted)


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
        self, time: float, plans: Array, pose: Array, poses: Array, twists: Array
    ) -> Array:
        pose, wanted = pose.copy(), track_speeds(twists, self.half_gauge)
        pose[:, 2] = poses[0, 2] + se2.wrap_angle(pose[:, 2] - poses[0, 2])
        for _ in range(self.iterations):
            reached, effect = self._driven(pose, plans)
            plans = self._optimum(plans, reached - poses[1:], effect, wanted)
        return plans


def bounded_optimum(hessian: Array, right: Array, bound: float) -> Array:
    """Vectors u (R, n) within +-`bound` that minimise u H u / 2 - b u, for H (R, n, n) or (1, n, n)
    and b (R, n).

    The solver is the projected Newton method of D. P. Bertsekas, SIAM J. Control and Optimization
    20(2), 1982.
    """
    optimum = np.linalg.solve(hessian, right[..., None])[..., 0]
    (rows,) = np.nonzero(np.abs(optimum).max(axis=1) > bound)
    optimum = np.clip(optimum, -bound, bound)
    hessian = np.broadcast_to(hessian, (len(right), *hessian.shape[1:]))
    for _ in range(_STEPS):
        if not rows.size:
            break
        h, u = hessian[rows], optimum[rows]
        slope = (h @ u[..., None])[..., 0] - right[rows]
        free = (np.abs(u) < bound) | (u * slope > 0)
        reduced = np.where(free[:, :, None] & free[:, None], h, np.eye(u.shape[1]))
        newton = np.linalg.solve(reduced, np.where(free, -slope, 0.0)[..., None])[..., 0]
        # (shares, rows, n)
        changes = np.clip(u + _SHARES[:, None, None] * newton, -bound, bound) - u
        costs = (changes * ((h @ changes[..., None])[..., 0] / 2 + slope)).sum(axis=-1)
        change = changes[costs.argmin(axis=0), np.arange(len(rows))]
        optimum[rows] = np.clip(u + change, -bound, bound)
        rows = rows[np.abs(change).max(axis=1) > _STILL]
    return optimum


@dataclass(frozen=True)
class PathIntegral(Horizon):
    """Law that drives the first twist of the mean of sampled plans, which are weighted by exp(-cost
    / temperature).

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
        self, time: float, plans: Array, pose: Array, poses: Array, twists: Array
    ) -> Array:
        generator = np.random.default_rng([self.seed, round(1e6 * time) % 2**63])
        half = generator.normal(0.0, self.noise, ((self.samples + 1) // 2, self.intervals, 2))
        # (M, K, 2), (K, 2)
        deviations, speeds = np.concatenate([half, -half]), track_speeds(twists, self.half_gauge)
        better = [
            self._averaged(*each, deviations, poses[1:], speeds)
            for each in zip(plans, pose, strict=True)
        ]
        return np.reshape(better, plans.shape)

    def _averaged(
        self, plan: Array, pose: Array, deviations: Array, wanted: Array, speeds: Array
    ) -> Array:
        """Weighted mean (K, 2) of the samples `plan` + `deviations` (M, K, 2) for a robot at `pose`
        (3,).
        """
        sampled = np.clip(plan + deviations, -self.track_speed, self.track_speed)  # (M, K, 2)
        v, w = np.moveaxis(twist_of_tracks(sampled, self.half_gauge), -1, 0)  # (M, K)
        heading = pose[2] + np.cumsum(w, axis=-1) * self.interval
        # chord direction; chord / arc = 1 - w^2 interval^2 / 24
        middle = heading - w * (self.interval / 2)
        chord = v * self.interval * (1 - (w * self.interval) ** 2 / 24)
        x = pose[0] - wanted[:, 0] + np.cumsum(chord * np.cos(middle), axis=-1)
        y = pose[1] - wanted[:, 1] + np.cumsum(chord * np.sin(middle), axis=-1)
        squares = np.stack([x**2, y**2, wrap_angle(heading - wanted[:, 2]) ** 2], axis=-1)
        cost = (squares * self.weights).sum(axis=(1, 2)) / self.temperature
        cost += ((plan - speeds) * deviations).sum(axis=(1, 2)) / self.noise**2
        weight = np.exp(cost.min() - cost)
        return np.asarray((weight[:, None, None] * sampled).sum(axis=0) / weight.sum())
