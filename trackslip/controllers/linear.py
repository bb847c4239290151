"""The kinematic controller of Sec. IV-C (Eq. 31), after Canudas de Wit et al., "Theory of Robot Control"."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.control_law import ErrorFeedback, Errors, natural_frequency
from trackslip.kinematics import Array


@dataclass(frozen=True)
class LinearTimeVarying(ErrorFeedback):
    """Feedforward plus linear feedback of the body-frame error, with gains scheduled by the twist of the reference.

    Around the reference the closed loop has the characteristic polynomial
    (s + 2 xi a)(s^2 + 2 xi a s + a^2) with a = sqrt(w_d^2 + g v_d^2) (Eqs. 25-30).
    """

    damping: float = 0.7
    """xi, the damping ratio [-]."""
    stiffness: float = 10.0
    """g, called b in the paper's Eqs. 28-30 [1/m^2]."""

    def gains(self, twist: ArrayLike) -> Array:
        """(k1, k2, k3) (..., 3) at reference twists (..., 2); Eqs. 29-30."""
        k1 = 2 * self.damping * natural_frequency(twist, self.stiffness)
        gains = np.empty((*k1.shape, 3))
        gains[..., 0] = gains[..., 2] = k1
        gains[..., 1] = self.stiffness * np.abs(np.asarray(twist, float)[..., 0])
        return gains

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        """Eq. 31."""
        (v_d, w_d), (e_x, e_y, e_phi) = desired, errors
        k1, k2, k3 = self.gains(desired)
        return v_d * np.cos(e_phi) + k1 * e_x, w_d + k2 * np.sign(v_d) * e_y + k3 * e_phi
