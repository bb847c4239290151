"""The nonlinear kinematic controller of Samson.

C. Samson and K. Ait-Abderrahim, "Feedback control of a nonholonomic wheeled cart in Cartesian space", ICRA 1991;
C. Canudas de Wit, B. Siciliano and G. Bastin (eds.), "Theory of Robot Control", Springer 1996.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.control_law import ErrorFeedback, Errors, natural_frequency
from trackslip.kinematics import Array


@dataclass(frozen=True)
class Samson(ErrorFeedback):
    """Feedback v = v_d cos(e_phi) + k1 e_x, w = w_d + k2 v_d sin(e_phi) / e_phi e_y + k3 e_phi.

    V = k2 (e_x^2 + e_y^2) / 2 + e_phi^2 / 2 decreases at the rate k1 k2 e_x^2 + k3 e_phi^2: the loop is stable from any
    error while the reference moves, forwards or in reverse. With k1 = k3 = 2 xi sqrt(w_d^2 + g v_d^2) and k2 = g it
    equals Eq. 31 to first order.
    """

    damping: float = 0.7
    """xi, the damping ratio [-]."""
    stiffness: float = 10.0
    """g [1/m^2]."""

    def gains(self, twist: ArrayLike) -> Array:
        """(k1, k2, k3) (..., 3) [1/s, 1/m^2, 1/s] at reference twists (..., 2)."""
        k1 = 2 * self.damping * natural_frequency(twist, self.stiffness)
        return np.stack([k1, np.full_like(k1, self.stiffness), k1], axis=-1)

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        (v_d, w_d), (e_x, e_y, e_phi) = desired, errors
        k1, k2, k3 = self.gains(desired)
        return v_d * np.cos(e_phi) + k1 * e_x, w_d + k2 * v_d * np.sinc(e_phi / np.pi) * e_y + k3 * e_phi
