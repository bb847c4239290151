"""Balance of a robot on Coulomb ground: the twist that dissipates the least power.

In a slow steady turn the forces of the ground are minus the gradient of the dissipated power

    P(v, u, w) = sum_k N_k sqrt((mu_along s_x,k)^2 + (mu_across s_y,k)^2)

with respect to the body twist (v, lateral speed u, w). P is convex: the robot turns with the twist that dissipates
least. Forces depend only on the direction of sliding, so slip depends on the radius of the path, on mu_across /
mu_along and on the length of contact, but not on speed, weight or the magnitude of friction.
"""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array
from trackslip.skid_theory.contact import Contact

_SMOOTHING = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # of |s| at 0, relative to the track speed
_ITERATIONS = 50


def minimise(speeds: Array, contact: Contact, load: Array, inertia: Array) -> Array:
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
