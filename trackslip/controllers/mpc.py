"""Nonlinear model predictive control of the unicycle, with CasADi (optional: `pip install -e ".[mpc]"`).

M. Diehl, H. G. Bock and J. P. Schlöder, "A real-time iteration scheme for nonlinear optimization in optimal feedback
control", SIAM J. Control and Optimization 43(5), 2005.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from trackslip.controllers.horizon import Horizon, Improve
from trackslip.errors import TrackslipError, require_whole
from trackslip.kinematics import Array, advance, track_speeds, twist_of_tracks


@dataclass(frozen=True)
class ModelPredictive(Horizon):
    """Minimises the predicted errors over a horizon, subject to the speed limit of both tracks.

    The state is the pose; the inputs are the track speeds (v -+ half_gauge w), held for an interval, so that without
    slip the motion is an arc and the limits are bounds. The deviations of position, heading and track speeds from the
    reference are minimised by least squares with multiple shooting. Each call takes a few Gauss-Newton steps from the
    shifted plan of the previous call (real-time iteration) and drives the first twist of the new plan.

    If the problem of a robot cannot be solved, it keeps its shifted plan or, without one, the twist of the reference.
    """

    speed_scale: float = 0.12
    """Deviation of a track speed from the reference that costs as much [m/s]."""
    iterations: int = 3
    """Gauss-Newton steps per call [-]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole("iterations", self.iterations, 1, 100)

    @cached_property
    def _program(self) -> _Program:
        return _Program(self)

    def _improve(self, time: float, poses: Array, twists: Array) -> Improve:
        wanted = {"wanted_poses": poses, "wanted_speeds": track_speeds(twists, self.half_gauge)}
        return partial(self._improved, self._program, **wanted)

    def _improved(
        self, program: _Program, plan: Array, pose: Array, wanted_poses: Array, wanted_speeds: Array
    ) -> Array:
        """The plan (K, 2) after Gauss-Newton steps from `pose` (3,), unchanged if one of them fails."""
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
            raise TrackslipError('model predictive control needs CasADi: pip install -e ".[mpc]"') from None
        count = controller.intervals
        poses, wanted_poses = casadi.SX.sym("poses", 3, count + 1), casadi.SX.sym("wanted_poses", 3, count + 1)
        speeds, wanted_speeds = casadi.SX.sym("speeds", 2, count), casadi.SX.sym("wanted_speeds", 2, count)
        unknowns = casadi.vec(casadi.vertcat(speeds, poses[:, 1:]))
        wanted = casadi.vec(casadi.vertcat(wanted_speeds, wanted_poses[:, 1:]))
        gauge, interval = controller.half_gauge, controller.interval
        ends = [_arc(casadi, poses[:, k], speeds[:, k], gauge, interval) for k in range(count)]
        gaps = casadi.vec(poses[:, 1:] - casadi.horzcat(*ends))
        matrix = casadi.jacobian(gaps, unknowns)
        of_speeds = np.full((count, 2), controller.speed_scale**-2)
        self._hessian = casadi.diag(casadi.DM(np.concatenate([of_speeds, controller.weights], axis=1).ravel()))
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
