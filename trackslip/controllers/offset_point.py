"""Static input/output linearisation of a point off the axle.

G. Oriolo, A. De Luca and M. Vendittelli, "WMR control via dynamic feedback linearization: design, implementation, and
experimental validation", IEEE Trans. Control Systems Technology 10(6), 2002; B. Siciliano, L. Sciavicco, L. Villani
and G. Oriolo, "Robotics: Modelling, Planning and Control", Springer 2009, Sec. 11.6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.controllers.control_law import ErrorFeedback, Errors
from trackslip.kinematics import Array


@dataclass(frozen=True)
class OffsetPoint(ErrorFeedback):
    """Steers a point ahead of the robot (behind it in reverse) onto the same point of the reference.

    The twist and the velocity of that point determine each other, so its error E obeys E' = -k E exactly. The heading
    is not controlled: it follows like that of a trailer, at the rate |v_d| / distance, which is why the point changes
    sides with the direction of travel. At standstill of the reference it is ahead.
    """

    distance: float = 0.2
    """Distance of the point from the centre of the robot [m]."""
    gain: float = 1.0
    """k [1/s]."""

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        (v_d, w_d), (e_x, e_y, e_phi) = desired, errors
        ahead = -self.distance if v_d < 0 else self.distance
        cos, sin = np.cos(e_phi), np.sin(e_phi)
        point_x = v_d * cos - ahead * w_d * sin + self.gain * (e_x + ahead * (cos - 1))
        point_y = v_d * sin + ahead * w_d * cos + self.gain * (e_y + ahead * sin)
        return point_x, point_y / ahead
