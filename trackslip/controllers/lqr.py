"""Linear-quadratic regulator along a reference, in discrete time.

B. D. O. Anderson and J. B. Moore, "Optimal Control: Linear Quadratic Methods", Prentice-Hall 1990; weights by Bryson's
rule: errors and corrections contribute equally to the cost when they are equal to their scales.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import ArrayLike

from trackslip.controllers.base import ControlLaw, OncePerReference
from trackslip.errors import require_within
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

STANDING = 5.0
"""Assumed time at rest after the end of the reference, so that the gains do not fade before the end [s]."""


@dataclass(frozen=True)
class Lqr(ControlLaw):
    """Feedforward plus feedback, (v, w) = (v_d cos(e_phi), w_d) - K_k e, that minimises a sum of squares.

    The body-frame error e obeys e_{k+1} = A_k e_k + B_k u_k to first order, u being the correction of the twist,
    held for a period; K_k follows from the Riccati recursion backwards from the end of the reference.
    """

    position_scale: float = 0.1
    """Scale of e_x and e_y [m]."""
    heading_scale: float = 0.3
    """Scale of e_phi [rad]."""
    speed_scale: float = 0.1
    """Scale of a correction of v [m/s]."""
    yaw_rate_scale: float = 0.3
    """Scale of a correction of w [rad/s]."""
    period: float = 0.05
    """Time between two commands [s]."""
    _gains: OncePerReference[Array] = field(default_factory=OncePerReference, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_within("period", self.period, 1e-3, 10.0, "s")

    @property
    def weights(self) -> tuple[Array, Array]:
        """Q (3, 3) of the errors and R (2, 2) of the corrections, in reciprocal squares of the units of the scales."""
        errors = np.array([self.position_scale, self.position_scale, self.heading_scale])
        return np.diag(errors**-2), np.diag(np.array([self.speed_scale, self.yaw_rate_scale]) ** -2)

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3)."""
        gains = self._gains(self.gains, reference)
        k = min(max(int(np.floor(time / self.period + 1e-6)), 0), len(gains) - 1)
        v_d, w_d = reference.twist(time)
        e_x, e_y, e_phi = np.moveaxis(body_errors(pose, reference.pose(time)), -1, 0)
        # Sums are written out because the rounding of a matrix product depends on the number of robots.
        along, turning = (row[0] * e_x + row[1] * e_y + row[2] * e_phi for row in gains[k])
        return np.stack([v_d * np.cos(e_phi) - along, w_d - turning], axis=-1)

    def gains(self, reference: Reference) -> Array:
        """K_k (S, 2, 3) of every period from 0 to the first one after the end of `reference`."""
        moving = int(np.ceil(reference.duration / self.period)) + 1
        steps = moving + int(np.ceil(STANDING / self.period))
        middles = (np.arange(steps) + 0.5) * self.period
        a, b = error_dynamics(reference.twist(middles), self.period)
        q, r = self.weights
        cost = q
        gains = np.empty((steps, 2, 3))
        for k in reversed(range(steps)):
            gains[k], cost = riccati_step(a[k], b[k], q, r, cost)
        return gains[:moving]


def error_dynamics(twist: ArrayLike, period: float) -> tuple[Array, Array]:
    """A (..., 3, 3) and B (..., 3, 2) of the body-frame error over `period` [s] at reference twists (..., 2).

    Exact for a reference of constant twist: the matrix exponential of the linearised Eq. 20 with inputs held.
    """
    v, w = np.moveaxis(np.asarray(twist, float), -1, 0)
    rates = np.zeros((*v.shape, 5, 5))  # of the error and the inputs
    rates[..., 0, 1], rates[..., 1, 0], rates[..., 1, 2] = w, -w, v
    rates[..., 0, 3] = rates[..., 2, 4] = -1.0
    after = scipy.linalg.expm(rates * period)
    return after[..., :3, :3], after[..., :3, 3:]


def riccati_step(a: Array, b: Array, q: Array, r: Array, cost: Array) -> tuple[Array, Array]:
    """Gain K (2, 3) and cost-to-go (3, 3) one step before the cost-to-go `cost` (3, 3)."""
    gain = np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ a)
    earlier = q + a.T @ cost @ (a - b @ gain)
    return gain, (earlier + earlier.T) / 2
