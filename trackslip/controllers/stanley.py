"""The steering law of the robot Stanley.

G. M. Hoffmann, C. J. Tomlin, M. Montemerlo and S. Thrun, "Autonomous automobile trajectory tracking for off-road
driving: controller design, experimental validation and racing", ACC 2007.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.controllers.control_law import ErrorFeedback, Errors, natural_frequency, speed_to_keep_up
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array, wrap_angle


@dataclass(frozen=True)
class Stanley(ErrorFeedback):
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
        super().__post_init__()
        if self.steering_limit >= np.pi / 2:
            raise InvalidValueError("steering_limit", self.steering_limit, "less than pi/2 rad")

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        (v_d, w_d), (e_x, e_y, e_phi) = desired, errors
        direction = -1.0 if v_d < 0 else 1.0
        gain = 2 * self.damping * natural_frequency(desired, self.stiffness)
        v = speed_to_keep_up(desired, errors, gain)
        axle_x = direction * e_x + self.wheelbase * (np.cos(e_phi) - 1)
        axle_y = direction * e_y + self.wheelbase * np.sin(e_phi)
        psi = wrap_angle(e_phi + np.arctan2(self.wheelbase * w_d, np.abs(v_d)))
        crosstrack = np.cos(psi) * axle_y - np.sin(psi) * axle_x
        delta = psi + np.arctan(self.gain * crosstrack / (self.softening + np.abs(v)))
        delta = np.clip(delta, -self.steering_limit, self.steering_limit)
        return v, np.abs(v) * np.tan(delta) / self.wheelbase
