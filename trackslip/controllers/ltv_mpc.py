"""Linear time-varying model predictive control with the limits of the tracks.

F. Kühne, J. M. Gomes da Silva Jr. and W. F. Lages, "Mobile robot trajectory tracking using model predictive control",
II IEEE Latin-American Robotics Symposium 2005; bounded least squares: P. B. Stark and R. L. Parker, Computational
Statistics 10, 1995.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trackslip.controllers.horizon import Horizon, Improve
from trackslip.controllers.lqr import error_dynamics
from trackslip.kinematics import Array, track_speeds, twist_of_tracks
from trackslip.metrics import body_errors


@dataclass(frozen=True)
class LinearPredictive(Horizon):
    """Minimises the errors predicted by the motion linearised about the reference, subject to the tracks' limits.

    The body-frame errors obey e_{k+1} = A_k e_k + B_k u_k to first order, u being the deviation of the track speeds
    from the reference. With the errors as functions of all u, bounded least squares remain.
    """

    speed_scale: float = 0.12
    """Deviation of a track speed from the reference that costs as much [m/s]."""

    def _improve(self, time: float, poses: Array, twists: Array) -> Improve:
        wanted, (root, of_error) = track_speeds(twists, self.half_gauge).ravel(), self.problem(twists)

        def improved(plan: Array, pose: Array) -> Array:
            right = -of_error @ body_errors(pose, poses[0])
            change = np.linalg.solve(root, right)  # the optimum without limits
            if (np.abs(wanted + change) > self.track_speed).any():
                limits = -self.track_speed - wanted, self.track_speed - wanted
                change = scipy.optimize.lsq_linear(root, right, limits, method="bvls").x
            return np.clip(wanted + change, -self.track_speed, self.track_speed).reshape(plan.shape)

        return improved

    def problem(self, twists: Array) -> tuple[Array, Array]:
        """R (2 K, 2 K) and G (2 K, 3) of the cost |R u + G e|^2 at an error e (3,), but for a term without u.

        Takes the reference's twists (K, 2).
        """
        a, b = error_dynamics(twists, self.interval)
        b = b @ twist_of_tracks(np.eye(2), self.half_gauge).T
        effect = np.zeros((self.intervals, 3, 2 * self.intervals + 3))  # of u and e on the errors, unweighted
        now = np.eye(3, 2 * self.intervals + 3, 2 * self.intervals)
        for k in range(self.intervals):
            now = a[k] @ now
            now[:, 2 * k : 2 * k + 2] = b[k]
            effect[k] = now
        rows = (np.sqrt(self.weights)[..., None] * effect).reshape(3 * self.intervals, -1)
        by_speeds, by_error = rows[:, :-3], rows[:, -3:]
        root = np.linalg.cholesky(by_speeds.T @ by_speeds + np.eye(2 * self.intervals) / self.speed_scale**2).T
        return root, np.linalg.solve(root.T, by_speeds.T @ by_error)
