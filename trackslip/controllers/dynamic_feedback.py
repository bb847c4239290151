"""Dynamic feedback linearisation.

G. Oriolo, A. De Luca and M. Vendittelli, "WMR control via dynamic feedback linearization: design, implementation, and
experimental validation", IEEE Trans. Control Systems Technology 10(6), 2002.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.samson import Samson
from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

ACCELERATION_STEP = 0.01
"""Half the time over which the reference's acceleration is taken [s]."""


@dataclass
class _State:
    """What is kept from one call to the next."""

    time: float | None = None
    """Of the last call [s]; None before the first."""
    speed: Array = field(default_factory=lambda: np.zeros(()))
    """xi, driven since then [m/s] (...)."""
    static_speed: Array = field(default_factory=lambda: np.zeros(()))
    """What the static law asked for then [m/s] (...)."""


@dataclass(frozen=True)
class DynamicFeedback:
    """Makes the robot's position two double integrators, by a speed xi that is a state of the controller.

    With u = p_d'' + k_d (p_d' - p') + k_p (p_d - p), xi' = u_1 cos(phi) + u_2 sin(phi) and
    w = (u_2 cos(phi) - u_1 sin(phi)) / xi, each axis' error obeys e'' + k_d e' + k_p e = 0, forwards and in reverse.

    At xi = 0 that is singular. Below `least_speed`, of xi in the reference's direction or of the reference, a static
    law drives and xi follows the speed it drives; from there to 1.5 times as much the two are mixed. What xi differs
    from the static law's speed by when that takes over dies out with `handover_time`: the speed driven never jumps.
    """

    stiffness: float = 1.0
    """k_p [1/s^2]."""
    damping: float = 1.4
    """k_d [1/s]."""
    least_speed: float = 0.03
    """Below it the static law drives [m/s]."""
    handover_time: float = 0.3
    """Time constant of handing over to the static law [s]."""
    static: Samson = field(default_factory=Samson)
    """The law that drives near standstill."""
    _state: _State = field(default_factory=_State, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        require_positive("stiffness", self.stiffness)
        require_positive("damping", self.damping)
        require_positive("least_speed", self.least_speed)
        require_positive("handover_time", self.handover_time)

    def reset(self) -> None:
        """Forget the speeds: the next call sizes them anew."""
        self._state.time = None

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3); as many as in the first call since `reset`."""
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

        self._state.time, self._state.speed, self._state.static_speed = time, v, static[..., 0]
        return np.stack([v, w], axis=-1)

    def _since_last_call(self, time: float, static_speed: Array) -> tuple[float, Array, Array]:
        """Time since the last call [s], xi then, and by how much it differed from the static law's speed, (...)."""
        last = self._state
        if last.time is None:
            return 0.0, static_speed, np.zeros_like(static_speed)
        if last.speed.shape != static_speed.shape:
            raise InvalidValueError("pose", (*static_speed.shape, 3), f"of shape {(*last.speed.shape, 3)} until reset")
        return max(time - last.time, 0.0), last.speed, last.speed - last.static_speed

    def _share(self, desired_speed: float, speed: Array) -> Array:
        """How much of the dynamic law drives (...): 0 up to `least_speed`, 1 from 1.5 times as much on."""
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
