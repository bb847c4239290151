"""Laws of the reference twist and the pose error: feedback, dynamic linearisation and LQR.

Y. Kanayama, Y. Kimura, F. Miyazaki and T. Noguchi, "A stable tracking control method for an
autonomous mobile robot", ICRA 1990; C. Samson and K. Ait-Abderrahim, "Feedback control of a
nonholonomic wheeled cart in Cartesian space", ICRA 1991; C. Canudas de Wit, B. Siciliano and G.
Bastin (eds.), "Theory of Robot Control", Springer 1996; G. Oriolo, A. De Luca and M. Vendittelli,
"WMR control via dynamic feedback linearization: design, implementation, and experimental
validation", IEEE Trans. Control Systems Technology 10(6), 2002; B. D. O. Anderson and J. B. Moore,
"Optimal Control: Linear Quadratic Methods", Prentice-Hall 1990, with weights from Bryson's rule: an
error or correction that equals its scale costs 1.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from trackslip.arguments import checks_arguments
from trackslip.controllers.base import ControlLaw, Memory, OncePerReference, Scheduled
from trackslip.errors import require_within
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

Errors = tuple[Array, Array, Array]
"""Body-frame errors (e_x, e_y, e_phi), each (...) [m, m, rad]."""

ACCELERATION_STEP: Final = 0.01
"""Half the time interval from which the acceleration of the reference is estimated [s]."""
APPENDED_STANDSTILL: Final = 5.0
"""Standstill after the reference, so that LQR gains do not decrease towards its end [s]."""
_PERIOD_ROUNDING: Final = 1e-6  # fraction of a period by which a call may come early


@dataclass(frozen=True)
class Feedforward(ControlLaw):
    """Open-loop law that drives the reference twist."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2), all equal to the reference twist, for poses (..., 3)."""
        return np.broadcast_to(reference.twist(time), (*np.shape(pose)[:-1], 2)).copy()


@dataclass(frozen=True)
class ErrorFeedback(ControlLaw, ABC):
    """Base class of laws that use only the reference twist and the body-frame error."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) for measured poses (..., 3)."""
        e_x, e_y, e_phi = np.moveaxis(body_errors(pose, reference.pose(time)), -1, 0)
        return np.stack(self._command(reference.twist(time), (e_x, e_y, e_phi)), axis=-1)

    @abstractmethod
    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        """v and w, each (...), for the reference twist `desired` (2,) and errors."""


@dataclass(frozen=True)
class LinearTimeVarying(Scheduled, ErrorFeedback):
    """Feedforward plus linear feedback of the error, with gains that follow the reference twist.

    Around the reference the closed loop has the characteristic polynomial
    (s + 2 xi a)(s^2 + 2 xi a s + a^2) with a = sqrt(w_d^2 + g v_d^2) (Eqs. 25-30).
    """

    def gains(self, twist: ArrayLike) -> Array:
        """Gains (k1, k2, k3) (..., 3) [1/s, 1/(m s), 1/s] at twists (..., 2); Eqs. 29-30."""
        v = np.asarray(twist, float)[..., 0]
        k1 = self.speed_gain(twist)
        k2 = self.stiffness * np.abs(v)
        return np.stack([k1, k2, k1], axis=-1)

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        """v and w of Eq. 31."""
        v_d, w_d = desired
        e_x, e_y, e_phi = errors
        k1, k2, k3 = self.gains(desired)
        v = v_d * np.cos(e_phi) + k1 * e_x
        w = w_d + k2 * np.sign(v_d) * e_y + k3 * e_phi
        return v, w


@dataclass(frozen=True)
class Samson(Scheduled, ErrorFeedback):
    """Feedback v = v_d cos(e_phi) + k1 e_x, w = w_d + k2 v_d sin(e_phi) / e_phi e_y + k3 e_phi.

    V = k2 (e_x^2 + e_y^2) / 2 + e_phi^2 / 2 decreases at the rate k1 k2 e_x^2 + k3 e_phi^2: the
    loop is stable from any error while the reference moves, forwards or in reverse. With k1 = k3 =
    2 xi sqrt(w_d^2 + g v_d^2) and k2 = g it equals Eq. 31 to first order.
    """

    def gains(self, twist: ArrayLike) -> Array:
        """Gains (k1, k2, k3) (..., 3) [1/s, 1/m^2, 1/s] at reference twists (..., 2)."""
        k1 = self.speed_gain(twist)
        return np.stack([k1, np.full_like(k1, self.stiffness), k1], axis=-1)

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        v_d, w_d = desired
        e_x, e_y, e_phi = errors
        k1, k2, k3 = self.gains(desired)
        sine_ratio = np.sinc(e_phi / np.pi)  # sin(e_phi) / e_phi
        v = v_d * np.cos(e_phi) + k1 * e_x
        w = w_d + k2 * v_d * sine_ratio * e_y + k3 * e_phi
        return v, w


@dataclass(frozen=True)
class Kanayama(ErrorFeedback):
    """Feedback v = v_d cos(e_phi) + K_x e_x, w = w_d + v_d K_y e_y + |v_d| K_phi sin(e_phi).

    The paper has v_d (K_y e_y + K_phi sin(e_phi)), for driving forwards only. With |v_d| in the
    last term, the Lyapunov function (e_x^2 + e_y^2) / 2 + (1 - cos(e_phi)) / K_y also decreases in
    reverse.
    """

    along: float = 1.0
    """K_x, gain on the error along the robot [1/s]."""
    across: float = 15.0
    """K_y, gain on the error across the robot [1/m^2]."""
    heading: float = 6.0
    """K_phi, gain on the heading error [1/m]; 2 sqrt(K_y) is critical damping on a straight."""

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        v_d, w_d = desired
        e_x, e_y, e_phi = errors
        v = v_d * np.cos(e_phi) + self.along * e_x
        w = w_d + v_d * self.across * e_y + np.abs(v_d) * self.heading * np.sin(e_phi)
        return v, w


@dataclass(frozen=True)
class OffsetPoint(ErrorFeedback):
    """Law that steers a point ahead of the robot onto the corresponding point of the reference.

    In reverse the point is behind the robot: a = -distance. In the robot's frame, the reference's
    point has the velocity (v_d cos - a w_d sin, v_d sin + a w_d cos) of the angle e_phi, and the
    error E = (e_x + a (cos - 1), e_y + a sin). The robot's point has the velocity (v, a w), which
    is made equal to the reference's velocity plus k E, so that E' = -k E exactly.

    The heading is not controlled: like a trailer's heading, it converges at the rate |v_d| /
    distance, and is stable only if the point leads in the direction of travel. While the reference
    stands still, the point is ahead.
    """

    distance: float = 0.2
    """Distance of the point from the centre of the robot [m]."""
    gain: float = 1.0
    """k, gain on the position error of the point [1/s]."""

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        v_d, w_d = desired
        e_x, e_y, e_phi = errors
        a = -self.distance if v_d < 0 else self.distance
        cos = np.cos(e_phi)
        sin = np.sin(e_phi)
        error_x = e_x + a * (cos - 1)
        error_y = e_y + a * sin
        velocity_x = v_d * cos - a * w_d * sin + self.gain * error_x
        velocity_y = v_d * sin + a * w_d * cos + self.gain * error_y
        return velocity_x, velocity_y / a


@dataclass(frozen=True)
class _SpeedState:
    """State of `DynamicFeedback` after a call, in m/s, each (...) and NaN without a pose."""

    speed: Array  # xi
    static_speed: Array  # speed of the static law


@checks_arguments
@dataclass(frozen=True)
class DynamicFeedback(ControlLaw):
    """Law that turns the position into two double integrators, with the speed xi as a state.

    With u = p_d'' + k_d (p_d' - p') + k_p (p_d - p), xi' = u_1 cos(phi) + u_2 sin(phi) and w = (u_2
    cos(phi) - u_1 sin(phi)) / xi, the error along each axis obeys e'' + k_d e' + k_p e = 0,
    forwards and in reverse. The law is evaluated in the robot's frame, where p' = (xi, 0), p_d - p
    = (e_x, e_y), and p_d' and p_d'' are the reference's velocity (v_d, 0) and acceleration (v_d',
    v_d w_d), turned by e_phi.

    The law is singular at xi = 0. If the reference speed, or xi in the reference's direction, is
    below `least_speed`, a static law takes over and xi follows the static law's speed; up to 1.5
    times `least_speed` the two laws are blended. The initial difference between xi and that speed
    decays with `handover_time`, so the speed never jumps.
    """

    stiffness: float = 1.0
    """k_p, gain on the position error [1/s^2]."""
    damping: float = 1.4
    """k_d, gain on the velocity error [1/s]."""
    least_speed: float = 0.03
    """Speed below which the static law is used [m/s]."""
    handover_time: float = 0.3
    """Time constant of the transition to the static law [s]."""
    static: Samson = field(default_factory=Samson)
    """The law used near standstill."""
    _memory: Memory[_SpeedState] = field(
        default_factory=Memory, init=False, repr=False, compare=False
    )

    def reset(self) -> None:
        """Discard xi; the next call may be for a different number of robots."""
        self._memory.reset()

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) for measured poses (..., 3) of as many robots as since `reset`."""
        v_d, w_d = reference.twist(time)
        e_x, e_y, e_phi = np.moveaxis(body_errors(pose, reference.pose(time)), -1, 0)
        cos = np.cos(e_phi)
        sin = np.sin(e_phi)
        static = self.static.twist(time, pose, reference)
        static_speed = static[..., 0]
        static_yaw_rate = static[..., 1]
        elapsed, previous, offset = self._since_last_call(time, static_speed)

        # the reference's acceleration along and across the robot
        tangential = _speed_rate(reference, time)
        centripetal = v_d * w_d
        forwards = tangential * cos - centripetal * sin
        leftwards = tangential * sin + centripetal * cos

        # xi' = u along the robot, blended with the static law's speed
        xi_rate = forwards + self.damping * (v_d * cos - previous) + self.stiffness * e_x
        handing_over = static_speed + offset * np.exp(-elapsed / self.handover_time)
        share = self._share(v_d, previous)
        v = share * (previous + elapsed * xi_rate) + (1 - share) * handing_over

        # w = u across the robot / xi; where the share is 0, the quotient doesn't matter
        across = leftwards + self.damping * v_d * sin + self.stiffness * e_y
        share = np.minimum(share, self._share(v_d, v))
        divisor = np.where(share > 0, v, 1.0)
        w = share * across / divisor + (1 - share) * static_yaw_rate

        self._memory.store(time, static_speed.shape, _SpeedState(v, static_speed))
        return np.stack([v, w], axis=-1)

    def _since_last_call(self, time: float, static_speed: Array) -> tuple[float, Array, Array]:
        """Time since the last call [s], and xi and xi minus the static speed (...) in it [m/s]."""
        recalled = self._memory.recall(time, static_speed.shape)
        if recalled is None:
            return 0.0, static_speed, np.zeros_like(static_speed)
        elapsed, last = recalled
        # without a pose in the last call, xi starts from the static law's speed
        known = np.isfinite(last.speed)
        offset = np.where(known, last.speed - last.static_speed, 0.0)
        previous = np.where(known, last.speed, static_speed)
        return elapsed, previous, offset

    def _share(self, desired_speed: float, speed: Array) -> Array:
        """Weight (...) of the dynamic law: 0 up to `least_speed`, 1 from 1.5 times that speed."""
        in_its_direction = np.sign(desired_speed) * speed
        slower = np.minimum(np.abs(desired_speed), in_its_direction)
        return np.clip(2 * (slower / self.least_speed - 1), 0.0, 1.0)


def _speed_rate(reference: Reference, time: float) -> float:
    """Rate of change of the reference's speed [m/s^2], one-sided at the ends, where it may jump."""
    last = np.nextafter(reference.duration, 0.0)
    around = [time - ACCELERATION_STEP, time + ACCELERATION_STEP]
    before, after = np.clip(around, 0.0, last)
    if after <= before:
        return 0.0
    start, end = reference.twist([before, after])[:, 0]
    return float((end - start) / (after - before))


@dataclass(frozen=True)
class Lqr(ControlLaw):
    """Law (v, w) = (v_d cos(e_phi), w_d) - K_k e with the least sum of weighted squares.

    The squares are those of errors and corrections of the twist. The body-frame error e obeys
    e_{k+1} = A_k e_k + B_k u_k to first order, where u is the correction of the twist, held for a
    period. K_k follows from the Riccati recursion backwards from the end of the reference.
    """

    position_scale: float = 0.1
    """Error e_x or e_y that costs 1 [m]."""
    heading_scale: float = 0.3
    """Error e_phi that costs 1 [rad]."""
    speed_scale: float = 0.1
    """Correction of v that costs 1 [m/s]."""
    yaw_rate_scale: float = 0.3
    """Correction of w that costs 1 [rad/s]."""
    period: float = 0.05
    """Time between two commands [s]."""
    _gains: OncePerReference[Array] = field(
        default_factory=OncePerReference, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        require_within("period", self.period, 1e-3, 10.0, "s")

    @property
    def weights(self) -> tuple[Array, Array]:
        """Q (3, 3) for the errors and R (2, 2) for the corrections, by Bryson's rule.

        Their units are the reciprocal squared units of the scales.
        """
        errors = np.array([self.position_scale, self.position_scale, self.heading_scale])
        corrections = np.array([self.speed_scale, self.yaw_rate_scale])
        return np.diag(errors**-2), np.diag(corrections**-2)

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) for measured poses (..., 3)."""
        v_d, w_d = reference.twist(time)
        e_x, e_y, e_phi = np.moveaxis(body_errors(pose, reference.pose(time)), -1, 0)

        def times_error(gain: Array) -> Array:
            # written out because the rounding of a matrix product depends on the number of robots
            return np.asarray(gain[0] * e_x + gain[1] * e_y + gain[2] * e_phi)

        gains = self._gains(self.gains, reference)
        period = math.floor(time / self.period + _PERIOD_ROUNDING)
        k = min(max(period, 0), len(gains) - 1)
        speed_gain, yaw_rate_gain = gains[k]
        v = v_d * np.cos(e_phi) - times_error(speed_gain)
        w = w_d - times_error(yaw_rate_gain)
        return np.stack([v, w], axis=-1)

    def gains(self, reference: Reference) -> Array:
        """Gains K_k (S, 2, 3) for the periods of `reference` and the first period after its end."""
        moving = math.ceil(reference.duration / self.period) + 1
        standing = math.ceil(APPENDED_STANDSTILL / self.period)
        steps = moving + standing
        middles = (np.arange(steps) + 0.5) * self.period
        a, b = error_dynamics(reference.twist(middles), self.period)
        q, r = self.weights
        cost = q
        gains = np.empty((steps, 2, 3))
        for k in reversed(range(steps)):
            gains[k], cost = riccati_step(a[k], b[k], q, r, cost)
        return gains[:moving]


def error_dynamics(twist: ArrayLike, period: float) -> tuple[Array, Array]:
    """Matrices A (..., 3, 3) and B (..., 3, 2) of the body-frame error over `period` [s].

    They belong to reference twists (v, w) (..., 2), and come from the matrix exponential of the
    linearised Eq. 20, with corrections (u_v, u_w) of the twist:

        e_x' = w e_y - u_v        e_y' = v e_phi - w e_x        e_phi' = -u_w

    Both are exact for constant twists and corrections.
    """
    v, w = np.moveaxis(np.asarray(twist, float), -1, 0)
    rates = np.zeros((*v.shape, 5, 5))  # of (e_x, e_y, e_phi, u_v, u_w) by the same
    # e_x'
    rates[..., 0, 1] = w
    rates[..., 0, 3] = -1.0
    # e_y'
    rates[..., 1, 0] = -w
    rates[..., 1, 2] = v
    # e_phi'
    rates[..., 2, 4] = -1.0
    after = scipy.linalg.expm(rates * period)
    return after[..., :3, :3], after[..., :3, 3:]


def riccati_step(a: Array, b: Array, q: Array, r: Array, cost: Array) -> tuple[Array, Array]:
    """Gain K (2, 3) and cost-to-go (3, 3) of a step, from the cost-to-go (3, 3) after it."""
    gain = np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ a)
    earlier = q + a.T @ cost @ (a - b @ gain)
    return gain, (earlier + earlier.T) / 2
