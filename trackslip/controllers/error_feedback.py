"""Laws of the reference's twist and the pose error in the body frame, and feedforward without the error.

Y. Kanayama, Y. Kimura, F. Miyazaki and T. Noguchi, "A stable tracking control method for an autonomous mobile robot",
ICRA 1990; C. Samson and K. Ait-Abderrahim, "Feedback control of a nonholonomic wheeled cart in Cartesian space",
ICRA 1991; C. Canudas de Wit, B. Siciliano and G. Bastin (eds.), "Theory of Robot Control", Springer 1996; G. Oriolo,
A. De Luca and M. Vendittelli, "WMR control via dynamic feedback linearization: design, implementation, and experimental
validation", IEEE Trans. Control Systems Technology 10(6), 2002.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.base import ControlLaw, Scheduled
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

Errors = tuple[Array, Array, Array]
"""Errors (e_x, e_y, e_phi), (...) each [m, m, rad]."""


@dataclass(frozen=True)
class Feedforward(ControlLaw):
    """Drives the twist of the reference in open loop."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """The twist of the reference for each of the poses (..., 3), (..., 2)."""
        return np.broadcast_to(reference.twist(time), (*np.shape(pose)[:-1], 2)).copy()


@dataclass(frozen=True)
class ErrorFeedback(ControlLaw, ABC):
    """A law of the reference's twist and the body-frame error only."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3)."""
        e_x, e_y, e_phi = np.moveaxis(body_errors(pose, reference.pose(time)), -1, 0)
        return np.stack(self._command(reference.twist(time), (e_x, e_y, e_phi)), axis=-1)

    @abstractmethod
    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        """v and w, each (...), from the twist (2,) of the reference and the errors (e_x, e_y, e_phi), (...) each."""


@dataclass(frozen=True)
class LinearTimeVarying(Scheduled, ErrorFeedback):
    """Feedforward plus linear feedback of the body-frame error, with gains scheduled by the twist of the reference.

    Around the reference the closed loop has the characteristic polynomial
    (s + 2 xi a)(s^2 + 2 xi a s + a^2) with a = sqrt(w_d^2 + g v_d^2) (Eqs. 25-30).
    """

    def gains(self, twist: ArrayLike) -> Array:
        """(k1, k2, k3) (..., 3) at reference twists (..., 2); Eqs. 29-30."""
        k1 = self.speed_gain(twist)
        return np.stack([k1, self.stiffness * np.abs(np.asarray(twist, float)[..., 0]), k1], axis=-1)

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        """Eq. 31."""
        (v_d, w_d), (e_x, e_y, e_phi) = desired, errors
        k1, k2, k3 = self.gains(desired)
        return v_d * np.cos(e_phi) + k1 * e_x, w_d + k2 * np.sign(v_d) * e_y + k3 * e_phi


@dataclass(frozen=True)
class Samson(Scheduled, ErrorFeedback):
    """Feedback v = v_d cos(e_phi) + k1 e_x, w = w_d + k2 v_d sin(e_phi) / e_phi e_y + k3 e_phi.

    V = k2 (e_x^2 + e_y^2) / 2 + e_phi^2 / 2 decreases at the rate k1 k2 e_x^2 + k3 e_phi^2: the loop is stable from any
    error while the reference moves, forwards or in reverse. With k1 = k3 = 2 xi sqrt(w_d^2 + g v_d^2) and k2 = g it
    equals Eq. 31 to first order.
    """

    def gains(self, twist: ArrayLike) -> Array:
        """(k1, k2, k3) (..., 3) [1/s, 1/m^2, 1/s] at reference twists (..., 2)."""
        k1 = self.speed_gain(twist)
        return np.stack([k1, np.full_like(k1, self.stiffness), k1], axis=-1)

    def _command(self, desired: Array, errors: Errors) -> tuple[Array, Array]:
        (v_d, w_d), (e_x, e_y, e_phi) = desired, errors
        k1, k2, k3 = self.gains(desired)
        return v_d * np.cos(e_phi) + k1 * e_x, w_d + k2 * v_d * np.sinc(e_phi / np.pi) * e_y + k3 * e_phi


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
