"""Nonlinear model predictive control of the unicycle, with CasADi (optional: `pip install "trackslip[mpc]"`).

M. Diehl, H. G. Bock and J. P. Schlöder, "A real-time iteration scheme for nonlinear optimization in optimal feedback
control", SIAM J. Control and Optimization 43(5), 2005.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.base import ControlLaw
from trackslip.errors import TrackslipError, require, require_whole
from trackslip.kinematics import Array, advance, track_speeds, twist_of_tracks
from trackslip.trajectory.base import Reference


@dataclass
class _State:
    """The state between calls."""

    program: _Program | None = None
    """Built in the first call, which needs CasADi."""
    time: float = 0.0
    """Time of the last call [s]."""
    plans: Array | None = None
    """Track speeds (..., K, 2) [m/s] that each robot plans from that time on; None before the first call."""


@dataclass(frozen=True)
class ModelPredictive(ControlLaw):
    """Minimises the predicted errors over a horizon, subject to the speed limit of both tracks.

    The state is the pose; the inputs are the track speeds (v -+ half_gauge w), held for an interval, so that without
    slip the motion is an arc and the limits are bounds. The deviations of position, heading and track speeds from the
    reference are minimised by least squares with multiple shooting. Each call takes a few Gauss-Newton steps from the
    shifted plan of the previous call (real-time iteration) and drives the first twist of the new plan.

    If the problem of a robot cannot be solved, it keeps its shifted plan or, without one, the twist of the reference.
    """

    intervals: int = 15
    """K, number of intervals in the horizon [-]."""
    interval: float = 0.2
    """Duration of an interval [s]."""
    position_scale: float = 0.1
    """Error in x or y that costs as much as the other quantities at their scales [m]."""
    heading_scale: float = 0.6
    """Error of the heading that costs as much [rad]."""
    speed_scale: float = 0.12
    """Deviation of a track speed from the reference that costs as much [m/s]."""
    final_weight: float = 10.0
    """Factor on the cost of the errors at the end of the horizon [-]."""
    track_speed: float = 0.295
    """Speed limit of each track, slightly below the 0.3 m/s of the sprockets [m/s]."""
    half_gauge: float = 0.213
    """b + D, the effective half gauge with slip compensation; half the gauge without it [m]."""
    iterations: int = 3
    """Gauss-Newton steps per call [-]."""
    _state: _State = field(default_factory=_State, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("intervals", "iterations"):
            require_whole(name, getattr(self, name), 1, 100)

    def reset(self) -> None:
        """Discard the plans; the next call may be for another number of robots."""
        self._state.plans = None

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3), of the same shape as in the first call since `reset`.

        Raises TrackslipError if CasADi is not installed.
        """
        state = self._state
        if state.program is None:
            state.program = _Program(self)
        pose = np.asarray(pose, float)
        nodes = time + self.interval * np.arange(self.intervals + 1)
        wanted_poses = reference.pose(nodes)  # (K + 1, 3)
        wanted_speeds = track_speeds(reference.twist((nodes[1:] + nodes[:-1]) / 2), self.half_gauge)  # (K, 2), means
        shape = (*pose.shape[:-1], self.intervals, 2)
        if state.plans is None:
            plans = np.broadcast_to(np.clip(wanted_speeds, -self.track_speed, self.track_speed), shape)
        else:
            allowed = f"of shape {(*state.plans.shape[:-2], 3)} until reset"
            require(state.plans.shape == shape, "pose", pose.shape, allowed)
            plans = self._shifted(state.plans, time - state.time)
        improved = [
            self._improved(state.program, plan, robot, wanted_poses, wanted_speeds)
            for plan, robot in zip(plans.reshape(-1, *shape[-2:]), pose.reshape(-1, 3), strict=True)
        ]
        state.plans, state.time = np.reshape(improved, shape), time
        return twist_of_tracks(state.plans[..., 0, :], self.half_gauge)

    def _shifted(self, plans: Array, elapsed: float) -> Array:
        """Plans (..., K, 2), shifted by `elapsed` [s]; their last speeds are held."""
        later = np.minimum(np.arange(self.intervals) + max(elapsed, 0.0) / self.interval, self.intervals - 1)
        k = np.minimum(later.astype(int), self.intervals - 2)
        share = (later - k)[:, None]
        return (1 - share) * plans[..., k, :] + share * plans[..., k + 1, :]

    def _improved(
        self, program: _Program, plan: Array, pose: Array, wanted_poses: Array, wanted_speeds: Array
    ) -> Array:
        """The plan (K, 2) after Gauss-Newton steps from `pose` (3,), unchanged if one of them fails."""
        if not np.isfinite(pose).all():
            return plan
        origin = np.array([*wanted_poses[0, :2], 2 * np.pi * np.round((pose[2] - wanted_poses[0, 2]) / (2 * np.pi))])
        wanted = wanted_poses - [*origin[:2], 0.0]
        poses, speeds = self._driven(pose - origin, plan), plan
        for _ in range(self.iterations):
            found = program.step(poses, speeds, wanted, wanted_speeds)
            if found is None:
                return plan
            poses, speeds = found
        return np.clip(speeds, -self.track_speed, self.track_speed)

    def _driven(self, pose: Array, plan: Array) -> Array:
        """Poses (K + 1, 3) along a plan (K, 2) from `pose` (3,)."""
        poses = [pose]
        for twist in twist_of_tracks(plan, self.half_gauge):
            poses.append(advance(poses[-1], twist, self.interval))
        return np.array(poses)


class _Program:
    """The quadratic program of a Gauss-Newton step; its unknowns are (V_l, V_r, x, y, phi) of each interval."""

    def __init__(self, controller: ModelPredictive) -> None:
        try:
            import casadi
        except ImportError:
            raise TrackslipError('model predictive control needs CasADi: pip install "trackslip[mpc]"') from None
        count = controller.intervals
        poses, wanted_poses = casadi.SX.sym("poses", 3, count + 1), casadi.SX.sym("wanted_poses", 3, count + 1)
        speeds, wanted_speeds = casadi.SX.sym("speeds", 2, count), casadi.SX.sym("wanted_speeds", 2, count)
        unknowns = casadi.vec(casadi.vertcat(speeds, poses[:, 1:]))
        wanted = casadi.vec(casadi.vertcat(wanted_speeds, wanted_poses[:, 1:]))
        gauge, interval = controller.half_gauge, controller.interval
        ends = [_arc(casadi, poses[:, k], speeds[:, k], gauge, interval) for k in range(count)]
        gaps = casadi.vec(poses[:, 1:] - casadi.horzcat(*ends))
        matrix = casadi.jacobian(gaps, unknowns)
        scales = [controller.speed_scale] * 2 + [controller.position_scale] * 2 + [controller.heading_scale]
        weights = np.tile(np.array(scales) ** -2, (count, 1))
        weights[-1, 2:] *= controller.final_weight
        self._hessian = casadi.diag(casadi.DM(weights.ravel()))
        self._linearised = casadi.Function(
            "linearised",
            [poses, speeds, wanted_poses, wanted_speeds],
            [-casadi.mtimes(self._hessian, wanted), matrix, casadi.mtimes(matrix, unknowns) - gaps],
        )
        quiet = {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False}
        shape = {"h": self._hessian.sparsity(), "a": matrix.sparsity()}
        self._solver: Any = casadi.conic("gauss_newton", "qrqp", shape, quiet)
        self._bound = np.tile([controller.track_speed] * 2 + [np.inf] * 3, count)

    def step(
        self, poses: Array, speeds: Array, wanted_poses: Array, wanted_speeds: Array
    ) -> tuple[Array, Array] | None:
        """Better poses (K + 1, 3) and track speeds (K, 2); None if the solver fails."""
        gradient, matrix, right = self._linearised(poses.T, speeds.T, wanted_poses.T, wanted_speeds.T)
        bounds = {"lba": right, "uba": right, "lbx": -self._bound, "ubx": self._bound}
        solution = self._solver(h=self._hessian, g=gradient, a=matrix, **bounds)
        found = np.asarray(solution["x"]).reshape(-1, 5)
        if not (self._solver.stats()["success"] and np.isfinite(found).all()):
            return None
        return np.concatenate([poses[:1], found[:, 2:]]), found[:, :2]


def _arc(casadi: Any, pose: Any, speeds: Any, half_gauge: float, interval: float) -> Any:
    """`kinematics.advance` symbolically, with sinc as a series: within 2e-8 of it for turns up to 0.4 rad."""
    half_turn = (speeds[1] - speeds[0]) / (2 * half_gauge) * interval / 2
    chord = (speeds[0] + speeds[1]) / 2 * interval * (1 - half_turn**2 / 6 + half_turn**4 / 120)
    heading = pose[2] + half_turn
    return pose + casadi.vertcat(chord * casadi.cos(heading), chord * casadi.sin(heading), 2 * half_turn)
