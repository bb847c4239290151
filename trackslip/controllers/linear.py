"""The kinematic controller of Sec. IV-C (Eq. 31), after Canudas de Wit et al., "Theory of Robot Control"."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.speed_law import natural_frequency, speed_towards
from trackslip.errors import require_positive
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference


@dataclass(frozen=True)
class LinearTimeVarying:
    """Feedforward plus linear feedback of the body-frame error, with gains scheduled by the twist of the reference.

    Around the reference the closed loop has the characteristic polynomial
    (s + 2 xi a)(s^2 + 2 xi a s + a^2) with a = sqrt(w_d^2 + g v_d^2) (Eqs. 25-30).
    """

    damping: float = 0.7
    """xi, the damping ratio [-]."""
    stiffness: float = 10.0
    """g, called b in the paper's Eqs. 28-30 [1/m^2]."""

    def __post_init__(self) -> None:
        require_positive("damping", self.damping)
        require_positive("stiffness", self.stiffness)

    def reset(self) -> None:
        """Nothing to reset."""

    def gains(self, twist: ArrayLike) -> Array:
        """(k1, k2, k3) (..., 3) at reference twists (..., 2); Eqs. 29-30."""
        k1 = 2 * self.damping * natural_frequency(twist, self.stiffness)
        k2 = self.stiffness * np.abs(np.asarray(twist, float)[..., 0])
        return np.stack([k1, k2, k1], axis=-1)

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3); Eq. 31."""
        desired = reference.twist(time)
        v_d, w_d = desired[..., 0], desired[..., 1]
        k1, k2, k3 = np.moveaxis(self.gains(desired), -1, 0)
        errors = body_errors(pose, reference.pose(time))
        w = w_d + k2 * np.sign(v_d) * errors[..., 1] + k3 * errors[..., 2]
        return np.stack([speed_towards(desired, errors, k1), w], axis=-1)
