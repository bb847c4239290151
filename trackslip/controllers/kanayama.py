"""The controller of Y. Kanayama, Y. Kimura, F. Miyazaki and T. Noguchi.

"A stable tracking control method for an autonomous mobile robot", ICRA 1990.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.speed_law import speed_towards
from trackslip.errors import require_positive
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference


@dataclass(frozen=True)
class Kanayama:
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

    def __post_init__(self) -> None:
        require_positive("along", self.along)
        require_positive("across", self.across)
        require_positive("heading", self.heading)

    def reset(self) -> None:
        """Nothing to reset."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3)."""
        desired = reference.twist(time)
        v_d, w_d = desired
        errors = body_errors(pose, reference.pose(time))
        e_y, e_phi = errors[..., 1], errors[..., 2]
        w = w_d + v_d * self.across * e_y + np.abs(v_d) * self.heading * np.sin(e_phi)
        return np.stack([speed_towards(desired, errors, self.along), w], axis=-1)
