"""Dynamic feedback linearisation.

G. Oriolo, A. De Luca and M. Vendittelli, "WMR control via dynamic feedback linearization: design, implementation, and
experimental validation", IEEE Trans. Control Systems Technology 10(6), 2002.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.base import Remembering
from trackslip.controllers.error_feedback import Samson
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

ACCELERATION_STEP = 0.01
"""Half of the time over which the acceleration of the reference is estimated [s]."""


@dataclass(frozen=True)
class DynamicFeedback(Remembering):
    """Turns the position into two double integrators, with the speed xi as a state of the controller.

    With u = p_d'' + k_d (p_d' - p') + k_p (p_d - p), xi' = u_1 cos(phi) + u_2 sin(phi) and
    w = (u_2 cos(phi) - u_1 sin(phi)) / xi, the error of each axis obeys e'' + k_d e' + k_p e = 0 in both
    directions.

    The law is singular at xi = 0. If the speed of the reference, or xi in its direction, is below `least_speed`, a
    static law takes over and xi follows its speed; between there and 1.5 times as much the two are blended. When the
    static law takes over, its speed difference from xi decays with `handover_time`, so the speed never jumps.
    """

    stiffness: float = 1.0
    """k_p [1/s^2]."""
    damping: float = 1.4
    """k_d [1/s]."""
    least_speed: float = 0.03
    """Speed below which the static law is used [m/s]."""
    handover_time: float = 0.3
    """Time constant of the transition to the static law [s]."""
    static: Samson = field(default_factory=Samson)
    """The law used near standstill."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3), of the same shape as in the first call since `reset`."""
        v_d, w_d = reference.twist(time)
        e_x, e_y, e_phi = np.moveaxis(body_errors(pose, reference.pose(time)), -1, 0)
        cos, sin = np.cos(e_phi), np.sin(e_phi)
        static = self.static.twist(time, pose, reference)
        elapsed, previous, offset = self._since_last_call(time, static[..., 0])

        share = self._share(v_d, previous)
        tangential, centripetal = _speed_rate(reference, time), v_d * w_d
        along = tangential * cos - centripetal * sin + self.damping * (v_d * cos - previous) + self.stiffness * e_x
        handing_over = static[..., 0] + offset * np.exp(-elapsed / self.handover_time)
        v = share * (previous + elapsed * along) + (1 - share) * handing_over
        across = tangential * sin + centripetal * cos + self.damping * v_d * sin + self.stiffness * e_y
        share = np.minimum(share, self._share(v_d, v))
        w = share * across / np.where(share > 0, v, 1.0) + (1 - share) * static[..., 1]

        self._kept.update(speed=v, static_speed=static[..., 0])
        return np.stack([v, w], axis=-1)

    def _since_last_call(self, time: float, static_speed: Array) -> tuple[float, Array, Array]:
        """Time since the last call [s], xi then, and its difference from the speed of the static law, (...)."""
        elapsed = self._elapsed(time, static_speed.shape)
        if elapsed is None:
            return 0.0, static_speed, np.zeros_like(static_speed)
        speed = self._kept["speed"]
        known = np.isfinite(speed)  # a robot whose pose was lost begins again
        offset = np.where(known, speed - self._kept["static_speed"], 0.0)
        return elapsed, np.where(known, speed, static_speed), offset

    def _share(self, desired_speed: float, speed: Array) -> Array:
        """Share of the dynamic law (...): 0 up to `least_speed`, 1 from 1.5 times as much."""
        least = np.minimum(np.abs(desired_speed), np.sign(desired_speed) * speed)
        return np.clip(2 * (least / self.least_speed - 1), 0.0, 1.0)


def _speed_rate(reference: Reference, time: float) -> float:
    """Rate of change of the reference's speed [m/s^2]; one-sided at its start and end, where the speed may jump."""
    last = np.nextafter(reference.duration, 0.0)
    before, after = np.clip([time - ACCELERATION_STEP, time + ACCELERATION_STEP], 0.0, last)
    if after <= before:
        return 0.0
    start, end = reference.twist([before, after])[:, 0]
    return float((end - start) / (after - before))
