"""The controller of Y. Kanayama, Y. Kimura, F. Miyazaki and T. Noguchi.

"A stable tracking control method for an autonomous mobile robot", ICRA 1990.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.controllers.control_law import ErrorFeedback, Errors
from trackslip.kinematics import Array


@dataclass(frozen=True)
class Kanayama(ErrorFeedback):
    """Feedback v = v_d cos(e_phi) + K_x e_x, w = w_d + v_d K_y e_y + |v_d| K_phi sin(e_phi).

    Their paper has v_d (K_y e_y + K_phi sin(e_phi)) and only drives forwards; with the absolute value the Lyapunov
    function (e_x^2 + e_y^2) / 2 + (1 - cos(e_phi)) / K_y decreases in reverse too.
    """

    along: float = 1.0
    """K_x [1/s]."""
    across: float = 15.0
    """K_y [1/m^2]."""
    heading: float = 6.0
    """K_phi [1/m]; 2 sqrt(K_y) is critically damped on a straight line."""

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        (v_d, w_d), (e_x, e_y, e_phi) = desired, errors
        w = w_d + v_d * self.across * e_y + np.abs(v_d) * self.heading * np.sin(e_phi)
        return v_d * np.cos(e_phi) + self.along * e_x, w
