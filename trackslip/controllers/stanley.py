"""The steering law of the robot Stanley.

G. M. Hoffmann, C. J. Tomlin, M. Montemerlo and S. Thrun, "Autonomous automobile trajectory tracking for off-road
driving: controller design, experimental validation and racing", ACC 2007.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.speed_law import natural_frequency, speed_to_keep_up
from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array, wrap_angle
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference


@dataclass(frozen=True)
class Stanley:
    """Steers a virtual axle, `wheelbase` ahead of the robot (behind it in reverse), onto the path of that axle.

    The steering angle is delta = psi + atan(k e / (k_s + |v|)): psi is the direction of the path of the axle relative
    to the robot, which for a reference of curvature kappa_d is e_phi + atan(wheelbase kappa_d), and e its distance to
    the left of the axle. There is thus no steady-state error on arcs. Then w = |v| tan(delta) / wheelbase. A steered
    axle has no effect at standstill and cannot back up to a reference that drives forwards, so the robot waits there.
    """

    wheelbase: float = 0.2
    """Distance of the virtual axle from the centre of the robot [m]."""
    gain: float = 1.0
    """k [1/s]."""
    softening: float = 0.1
    """k_s, which limits the angle at low speed [m/s]."""
    steering_limit: float = np.pi / 3
    """Maximum |delta| [rad]."""
    damping: float = 0.7
    """xi of the speed law, of gain 2 xi sqrt(w_d^2 + g v_d^2) [-]."""
    stiffness: float = 10.0
    """g of the speed law [1/m^2]."""

    def __post_init__(self) -> None:
        require_positive("wheelbase", self.wheelbase)
        require_positive("gain", self.gain)
        require_positive("softening", self.softening)
        require_positive("damping", self.damping)
        require_positive("stiffness", self.stiffness)
        if not 0 < self.steering_limit < np.pi / 2:
            raise InvalidValueError("steering_limit", self.steering_limit, "between 0 and pi/2 rad")

    def reset(self) -> None:
        """Nothing to reset."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3)."""
        desired = reference.twist(time)
        v_d, w_d = desired
        direction = -1.0 if v_d < 0 else 1.0
        errors = body_errors(pose, reference.pose(time))
        e_x, e_y, e_phi = np.moveaxis(errors, -1, 0)
        gain = 2 * self.damping * natural_frequency(desired, self.stiffness)
        v = speed_to_keep_up(desired, errors, gain)
        axle_x = direction * e_x + self.wheelbase * (np.cos(e_phi) - 1)
        axle_y = direction * e_y + self.wheelbase * np.sin(e_phi)
        psi = wrap_angle(e_phi + np.arctan2(self.wheelbase * w_d, np.abs(v_d)))
        crosstrack = np.cos(psi) * axle_y - np.sin(psi) * axle_x
        delta = psi + np.arctan(self.gain * crosstrack / (self.softening + np.abs(v)))
        delta = np.clip(delta, -self.steering_limit, self.steering_limit)
        return np.stack([v, np.abs(v) * np.tan(delta) / self.wheelbase], axis=-1)
