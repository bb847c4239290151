"""Quasi-static turning of a tracked robot on Coulomb ground: the theory that the simulator is compared with.

The ground acts on each sliding element of track against its sliding velocity s, with the force of maximum dissipation
within an elliptic limit (mu_along along the track, mu_across across it):

    F = -N (mu_along^2 s_x, mu_across^2 s_y) / sqrt((mu_along s_x)^2 + (mu_across s_y)^2)

In a slow steady turn these forces balance. They are minus the gradient of the dissipated power

    P(v, u, w) = sum_k N_k sqrt((mu_along s_x,k)^2 + (mu_across s_y,k)^2)

with respect to the body twist (v, lateral speed u, w). P is convex: the robot turns with the twist that dissipates
least. Forces depend only on the direction of sliding, so slip depends on the radius of the path, on mu_across /
mu_along and on the length of contact, but not on speed, weight or the magnitude of friction. After Moreau's principle
of maximum dissipation; for skid steering see Wong and Chiang (2001), whose shear displacement is omitted here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array

_SMOOTHING = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # of |s| at 0, relative to the track speed
_ITERATIONS = 50
_INERTIA_ITERATIONS = 6


@dataclass(frozen=True)
class Contact:
    """Contact points of the tracks, their friction, and the centre of mass."""

    x: Array  # (K,) along the robot [m]
    y: Array  # (K,) to its left [m]; points with y > 0 are on the left track
    along: float
    """Friction coefficient along the track [-]."""
    across: float
    """Friction coefficient across the track [-]."""
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position ahead and to the left of the middle between the tracks, and above the ground [m]."""

    def __post_init__(self) -> None:
        require_positive("along", self.along)
        require_positive("across", self.across)
        if not (self.x.shape == self.y.shape and self.x.ndim == 1 and self.x.size > 0):
            raise InvalidValueError("x, y", (self.x.shape, self.y.shape), "two equal (K,)")
        if not np.isfinite(self.centre_of_mass).all():
            raise InvalidValueError("centre_of_mass", self.centre_of_mass, "finite")
        if self.loads(np.zeros(2)).min() < 0:
            raise InvalidValueError(
                "centre_of_mass", self.centre_of_mass, "close enough to the middle to load every point of the tracks"
            )

    def loads(self, acceleration: Array) -> Array:
        """Fractions (..., K) of the weight on each point, at accelerations (..., 2) of the centre of mass along and
        across the robot, in units of gravity.

        A rigid robot on equal springs: the load is linear in position and balances the moments of weight and inertia.
        """
        forwards, left, height = self.centre_of_mass
        middle_x, middle_y = forwards - height * acceleration[..., :1], left - height * acceleration[..., 1:]
        spread = 1 + middle_x * self.x / np.mean(self.x**2) + middle_y * self.y / np.mean(self.y**2)
        return spread / self.x.size


def line_contact(
    half_gauge: float,
    half_length: float,
    along: float,
    across: float,
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0),
    points: int = 200,
) -> Contact:
    """Two tracks with uniform pressure on the ground, apart from the effect of the centre of mass.

    Args:
        half_gauge: half the distance between the tracks [m].
        half_length: half of the contact length [m].
        along, across: friction coefficients [-].
        centre_of_mass: see `Contact` [m].
        points: number of points per track, in the middle of equal segments.

    Raises:
        InvalidValueError: if a value is not positive, or the centre of mass lifts part of a track.
    """
    require_positive("half_gauge", half_gauge)
    require_positive("half_length", half_length)
    segment = (np.arange(points) + 0.5) / points * 2 - 1
    x = np.tile(segment * half_length, 2)
    y = np.repeat([half_gauge, -half_gauge], points)
    return Contact(x, y, along, across, centre_of_mass)


def steady_twist(surface_speeds: ArrayLike, contact: Contact, gravity: float = np.inf) -> Array:
    """Twists (..., 3), (v, lateral u, w) [m/s, m/s, rad/s], for track surface speeds (left, right) (..., 2) [m/s].

    With a finite `gravity` [m/s^2] the ground also provides the centripetal force, which shifts load to the outer
    track; both are found by fixed-point iteration. By default inertia is neglected and slip does not depend on speed.
    Raises InvalidValueError for speeds that are not finite.
    """
    speeds = np.asarray(surface_speeds, float)
    if not np.isfinite(speeds).all():
        raise InvalidValueError("surface_speeds", surface_speeds, "finite")
    require_positive("gravity", 1.0 if gravity == np.inf else gravity)
    shape = speeds.shape[:-1]
    speeds = speeds.reshape(-1, 2)
    twist = np.zeros((len(speeds), 3))
    moving = np.abs(speeds).max(axis=1) > 0
    if moving.any():
        for _ in range(1 if gravity == np.inf else _INERTIA_ITERATIONS):
            twist[moving] = _balance(speeds[moving], contact, _acceleration(twist[moving], contact) / gravity)
    return twist.reshape(*shape, 3)


def _acceleration(twist: Array, contact: Contact) -> Array:
    """Acceleration of the centre of mass in a steady turn, along and across the robot, (M, 2) [m/s^2]."""
    v, u, w = twist.T
    forwards, left, _ = contact.centre_of_mass
    return np.stack([-w * (u + w * forwards), w * (v - w * left)], axis=1)


def _balance(speeds: Array, contact: Contact, acceleration: Array) -> Array:
    """Twists (M, 3) at which the forces of the ground produce accelerations (M, 2), in units of gravity."""
    scale = np.abs(speeds).max(axis=1)
    forwards, left, _ = contact.centre_of_mass
    moment = forwards * acceleration[:, 1] - left * acceleration[:, 0]
    inertia = np.column_stack([acceleration, moment])
    return _minimise(speeds / scale[:, None], contact, contact.loads(acceleration), inertia) * scale[:, None]


def _minimise(speeds: Array, contact: Contact, load: Array, inertia: Array) -> Array:
    """Twists (M, 3) of least power, dissipated under loads (M, K) or spent on the forces `inertia` (M, 3).

    Track speeds (M, 2) are of order one, loads and forces in units of the weight.
    """
    x, y = contact.x, contact.y
    belt = np.where(y > 0, speeds[:, :1], speeds[:, 1:])  # (M, K)
    gauge = np.abs(y).mean()
    twist = np.stack([speeds.mean(axis=1), np.zeros(len(speeds)), (speeds[:, 1] - speeds[:, 0]) / (4 * gauge)], axis=1)
    # the sliding velocity, weighted by friction, is linear in the twist: a = A twist - belt
    along = contact.along * np.stack([np.ones_like(x), np.zeros_like(x), -y], axis=1)  # (K, 3)
    across = contact.across * np.stack([np.zeros_like(x), np.ones_like(x), x], axis=1)  # (K, 3)

    def power(twist: Array, smoothing: float) -> tuple[Array, Array, Array, Array]:
        a = twist @ along.T - contact.along * belt
        c = twist @ across.T
        size = np.sqrt(a**2 + c**2 + smoothing**2)
        return np.sum(load * size, axis=1) + np.sum(inertia * twist, axis=1), a, c, size

    for smoothing in _SMOOTHING:
        for _ in range(_ITERATIONS):
            value, a, c, size = power(twist, smoothing)
            n = load / size
            gradient = (n * a) @ along + (n * c) @ across + inertia
            h_aa = n * (1 - (a / size) ** 2)
            h_cc = n * (1 - (c / size) ** 2)
            h_ac = -n * a * c / size**2
            parts = ((h_aa, along, along), (h_cc, across, across), (h_ac, along, across))
            both_along, both_across, cross = (np.einsum("mk,ki,kj->mij", *part) for part in parts)
            hessian = both_along + both_across + cross + cross.swapaxes(1, 2)
            step = np.linalg.solve(hessian, -gradient[..., None])[..., 0]
            decrement = -np.einsum("mi,mi->m", gradient, step)
            length = np.ones(len(twist))
            for _ in range(30):  # backtrack until the power decreases sufficiently (Armijo)
                trial = power(twist + length[:, None] * step, smoothing)[0]
                high = trial > value - 0.25 * length * decrement + 1e-15
                if not high.any():
                    break
                length[high] /= 2
            twist = twist + length[:, None] * step
            if decrement.max() < 1e-14:
                break
    return twist
