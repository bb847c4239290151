"""Quasi-static turning of a tracked robot on Coulomb ground: the yardstick for the simulator.

The ground pushes on each element of track that slides over it against its sliding velocity s, with a force inside an
elliptic limit (mu_along along the track, mu_across across it) and of maximum dissipation:

    F = -N (mu_along^2 s_x, mu_across^2 s_y) / sqrt((mu_along s_x)^2 + (mu_across s_y)^2)

In a slow steady turn these forces balance. They are minus the gradient of the dissipated power

    P(v, u, w) = sum_k N_k sqrt((mu_along s_x,k)^2 + (mu_across s_y,k)^2)

with respect to the body twist (v, lateral speed u, w), and P is convex: the turn is the twist that dissipates least.
Force depends on the direction of sliding only, so slip depends on the path's radius only, not on speed, weight or the
size of friction, but on mu_across / mu_along and the length of contact. After Moreau's principle of maximum
dissipation; for skid steering see Wong and Chiang (2001), who add shear displacement, left out here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array

_SMOOTHING = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # of the corner of |s| at 0, relative to the track speed
_ITERATIONS = 50


@dataclass(frozen=True)
class Contact:
    """Where the tracks touch the ground, and with what load and friction."""

    x: Array  # (K,) along the robot [m]
    y: Array  # (K,) to its left [m]; the left track is where y > 0
    load: Array  # (K,) normal force, in any unit
    along: float
    """Friction coefficient along the track [-]."""
    across: float
    """Friction coefficient across the track [-]."""

    def __post_init__(self) -> None:
        require_positive("along", self.along)
        require_positive("across", self.across)
        if not (self.x.shape == self.y.shape == self.load.shape and self.x.ndim == 1 and self.x.size > 0):
            raise InvalidValueError("x, y, load", (self.x.shape, self.y.shape, self.load.shape), "three equal (K,)")
        if not np.all(self.load >= 0) or not self.load.sum() > 0:
            raise InvalidValueError("load", self.load, ">= 0, with a sum > 0")


def line_contact(
    half_gauge: float,
    half_length: float,
    along: float,
    across: float,
    centre_of_mass: tuple[float, float] = (0.0, 0.0),
    points: int = 200,
) -> Contact:
    """Two tracks of uniform cross-section whose load varies linearly with place, as the centre of mass asks.

    Args:
        half_gauge: half the distance between the tracks [m].
        half_length: half the length of contact [m].
        along, across: friction coefficients [-].
        centre_of_mass: its (x, y) from the middle of the robot [m].
        points: points per track, at the middle of equal segments.

    Raises:
        InvalidValueError: for values that aren't positive, or a centre of mass that lifts part of a track.
    """
    require_positive("half_gauge", half_gauge)
    require_positive("half_length", half_length)
    segment = (np.arange(points) + 0.5) / points * 2 - 1
    x = np.tile(segment * half_length, 2)
    y = np.repeat([half_gauge, -half_gauge], points)
    offset_x, offset_y = centre_of_mass
    load = 1 + x * offset_x / np.mean(x**2) + y * offset_y / np.mean(y**2)
    if load.min() < 0:
        raise InvalidValueError("centre_of_mass", centre_of_mass, "near enough to the middle to load every point")
    return Contact(x, y, load / load.sum(), along, across)


def steady_twist(surface_speeds: ArrayLike, contact: Contact) -> Array:
    """Twists (..., 3), (v, lateral u, w) [m/s, m/s, rad/s], of tracks that run at (left, right) (..., 2) [m/s].

    Newton's method on the smoothed power, the smoothing taken away in steps. Raises InvalidValueError for speeds that
    are not finite.
    """
    speeds = np.asarray(surface_speeds, float)
    if not np.isfinite(speeds).all():
        raise InvalidValueError("surface_speeds", surface_speeds, "finite")
    shape = speeds.shape[:-1]
    speeds = speeds.reshape(-1, 2)
    scale = np.abs(speeds).max(axis=1)
    moving = scale > 0
    twist = np.zeros((len(speeds), 3))
    if moving.any():
        twist[moving] = _minimise(speeds[moving] / scale[moving, None], contact) * scale[moving, None]
    return twist.reshape(*shape, 3)


def _minimise(speeds: Array, contact: Contact) -> Array:
    """Twists (M, 3) that dissipate least, for track speeds (M, 2) of order one."""
    x, y = contact.x, contact.y
    belt = np.where(y > 0, speeds[:, :1], speeds[:, 1:])  # (M, K)
    gauge = np.abs(y).mean()
    twist = np.stack([speeds.mean(axis=1), np.zeros(len(speeds)), (speeds[:, 1] - speeds[:, 0]) / (4 * gauge)], axis=1)
    # sliding velocity, weighted by friction, is linear in the twist: a = A twist - belt
    along = contact.along * np.stack([np.ones_like(x), np.zeros_like(x), -y], axis=1)  # (K, 3)
    across = contact.across * np.stack([np.zeros_like(x), np.ones_like(x), x], axis=1)  # (K, 3)

    def power(twist: Array, smoothing: float) -> tuple[Array, Array, Array, Array]:
        a = twist @ along.T - contact.along * belt
        c = twist @ across.T
        size = np.sqrt(a**2 + c**2 + smoothing**2)
        return contact.load @ size.T, a, c, size

    for smoothing in _SMOOTHING:
        for _ in range(_ITERATIONS):
            value, a, c, size = power(twist, smoothing)
            n = contact.load / size
            gradient = (n * a) @ along + (n * c) @ across
            h_aa = n * (1 - (a / size) ** 2)
            h_cc = n * (1 - (c / size) ** 2)
            h_ac = -n * a * c / size**2
            cross = np.einsum("mk,ki,kj->mij", h_ac, along, across)
            hessian = (
                np.einsum("mk,ki,kj->mij", h_aa, along, along)
                + np.einsum("mk,ki,kj->mij", h_cc, across, across)
                + cross
                + cross.swapaxes(1, 2)
            )
            step = np.linalg.solve(hessian, -gradient[..., None])[..., 0]
            decrement = -np.einsum("mi,mi->m", gradient, step)
            length = np.ones(len(twist))
            for _ in range(30):  # backtrack until the power falls enough (Armijo)
                trial = power(twist + length[:, None] * step, smoothing)[0]
                high = trial > value - 0.25 * length * decrement + 1e-15
                if not high.any():
                    break
                length[high] /= 2
            twist = twist + length[:, None] * step
            if decrement.max() < 1e-14:
                break
    return twist
