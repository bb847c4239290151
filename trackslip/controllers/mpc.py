"""Model predictive control with the limits of the tracks, linear time-varying and nonlinear.

F. Kühne, J. M. Gomes da Silva Jr. and W. F. Lages, "Mobile robot trajectory tracking using model predictive control",
II IEEE Latin-American Robotics Symposium 2005; M. Diehl, H. G. Bock and J. P. Schlöder, "A real-time iteration scheme
for nonlinear optimization in optimal feedback control", SIAM J. Control and Optimization 43(5), 2005.
"""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass

import numpy as np

from trackslip import se2
from trackslip.controllers.horizon import Horizon
from trackslip.errors import require_whole
from trackslip.kinematics import Array, track_speeds, twist_of_tracks
from trackslip.metrics import body_errors

_SHARES = np.append(0.5 ** np.arange(20), 0.0)  # of a Newton step that are tried
_STILL = 1e-10  # change of all unknowns below which a solution stands
_STEPS = 100  # at most; more only shift rounding errors of ill-conditioned problems


@dataclass(frozen=True)
class _LeastSquares(Horizon, ABC):
    """Minimises the squares of predicted errors and of deviations of the track speeds, by a linearised motion."""

    speed_scale: float = 0.12
    """Deviation of a track speed from the reference that costs as much [m/s]."""

    def _driven(self, pose: Array, plans: Array) -> tuple[Array, Array]:
        """Poses (R, K, 3) after each interval of plans (R, K, 2) from poses (R, 3), and derivatives (R, 3 K, 2 K)."""
        motion = np.zeros((*plans.shape[:-1], 3))
        motion[..., ::2] = self.interval * twist_of_tracks(plans, self.half_gauge)
        starts = np.zeros_like(motion)
        starts[..., 2] = pose[:, None, 2] + np.cumsum(motion[..., 2], axis=1) - motion[..., 2]
        reached, _, by_motion = se2.drive(starts, motion)
        reached[..., :2] = pose[:, None, :2] + np.cumsum(reached[..., :2], axis=1)
        by_speeds = by_motion[..., ::2] @ (self.interval * twist_of_tracks(np.eye(2), self.half_gauge).T)
        # A turn in interval j also turns the way from there to the end of interval k.
        x, y, _ = np.moveaxis(reached[:, :, None] - reached[:, None], -1, 0)  # (R, K, K)
        effect = np.repeat(by_speeds[:, None], self.intervals, axis=1)  # (R, k, j, 3, 2)
        effect[..., 0, :] -= y[..., None] * by_speeds[:, None, :, 2]
        effect[..., 1, :] += x[..., None] * by_speeds[:, None, :, 2]
        effect *= np.tri(self.intervals)[:, :, None, None]
        return reached, effect.swapaxes(2, 3).reshape(-1, 3 * self.intervals, 2 * self.intervals)

    def _optimum(self, plans: Array, deviation: Array, effect: Array, wanted: Array) -> Array:
        """The best plans (R, K, 2), if poses deviate by (R, K, 3) from the reference with the present plans.

        `effect` (R, 3 K, 2 K) is that of their change, `wanted` (K, 2) are the reference's track speeds.
        """
        root = np.sqrt(self.weights).reshape(-1, 1)
        effect, deviation = root * effect, root * deviation.reshape(len(plans), -1, 1)
        transposed, speeds = effect.swapaxes(1, 2), plans.reshape(len(plans), -1, 1)
        hessian = transposed @ effect + np.eye(wanted.size) / self.speed_scale**2
        right = transposed @ (effect @ speeds - deviation) + wanted.reshape(-1, 1) / self.speed_scale**2
        return bounded_optimum(hessian, right[..., 0], self.track_speed).reshape(plans.shape)


@dataclass(frozen=True)
class LinearPredictive(_LeastSquares):
    """Minimises the errors predicted by the motion linearised about the reference, subject to the tracks' limits."""

    def _improved(self, time: float, plans: Array, pose: Array, poses: Array, twists: Array) -> Array:
        wanted = track_speeds(twists, self.half_gauge)
        way, effect = self._driven(np.zeros((1, 3)), wanted[None])  # in the frame of the reference's pose
        x, y, turn = np.moveaxis(-body_errors(pose, poses[0])[:, None], -1, 0)  # (R, 1) each
        x, y = x - turn * way[..., 1], y + turn * way[..., 0]
        deviation = np.stack([x, y, np.broadcast_to(turn, x.shape)], axis=-1)
        return self._optimum(np.broadcast_to(wanted, plans.shape), deviation, effect, wanted)


@dataclass(frozen=True)
class ModelPredictive(_LeastSquares):
    """Minimises the errors predicted by the unicycle's motion, subject to the tracks' limits.

    Each call takes a few Gauss-Newton steps from the shifted plan of the previous call (real-time iteration).
    """

    iterations: int = 3
    """Gauss-Newton steps per call [-]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole("iterations", self.iterations, 1, 100)

    def _improved(self, time: float, plans: Array, pose: Array, poses: Array, twists: Array) -> Array:
        pose, wanted = pose.copy(), track_speeds(twists, self.half_gauge)
        pose[:, 2] = poses[0, 2] + se2.wrap_angle(pose[:, 2] - poses[0, 2])
        for _ in range(self.iterations):
            reached, effect = self._driven(pose, plans)
            plans = self._optimum(plans, reached - poses[1:], effect, wanted)
        return plans


def bounded_optimum(hessian: Array, right: Array, bound: float) -> Array:
    """The u (R, n) within +-`bound` that minimise u H u / 2 - b u, for H (R, n, n) or (1, n, n) and b (R, n).

    By projected Newton steps: D. P. Bertsekas, SIAM J. Control and Optimization 20(2), 1982.
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
        changes = np.clip(u + _SHARES[:, None, None] * newton, -bound, bound) - u  # (shares, rows, n)
        costs = (changes * ((h @ changes[..., None])[..., 0] / 2 + slope)).sum(axis=-1)
        change = changes[costs.argmin(axis=0), np.arange(len(rows))]
        optimum[rows] = np.clip(u + change, -bound, bound)
        rows = rows[np.abs(change).max(axis=1) > _STILL]
    return optimum
