"""Static input/output linearisation of a point off the axle.

G. Oriolo, A. De Luca and M. Vendittelli, "WMR control via dynamic feedback linearization: design, implementation, and
experimental validation", IEEE Trans. Control Systems Technology 10(6), 2002; B. Siciliano, L. Sciavicco, L. Villani
and G. Oriolo, "Robotics: Modelling, Planning and Control", Springer 2009, Sec. 11.6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import require_positive
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference


@dataclass(frozen=True)
class OffsetPoint:
    """Steers a point ahead of the robot (behind it in reverse) onto the same point of the reference.

    The twist and the velocity of that point determine each other, so its error E obeys E' = -k E exactly. The heading
    is not controlled: it follows like that of a trailer, at the rate |v_d| / distance, which is why the point changes
    sides with the direction of travel. At standstill of the reference it is ahead.
    """

    distance: float = 0.2
    """Distance of the point from the centre of the robot [m]."""
    gain: float = 1.0
    """k [1/s]."""

    def __post_init__(self) -> None:
        require_positive("distance", self.distance)
        require_positive("gain", self.gain)

    def reset(self) -> None:
        """Nothing to reset."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3)."""
        v_d, w_d = reference.twist(time)
        ahead = -self.distance if v_d < 0 else self.distance
        e_x, e_y, e_phi = np.moveaxis(body_errors(pose, reference.pose(time)), -1, 0)
        cos, sin = np.cos(e_phi), np.sin(e_phi)
        point_x = v_d * cos - ahead * w_d * sin + self.gain * (e_x + ahead * (cos - 1))
        point_y = v_d * sin + ahead * w_d * cos + self.gain * (e_y + ahead * sin)
        return np.stack([point_x, point_y / ahead], axis=-1)
