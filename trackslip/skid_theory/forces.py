"""Forces of the ground on sliding tracks, and the twists at which they balance a load.

On Coulomb ground, the forces are minus the gradient of the dissipated power

    P(v, u, w) = sum_k N_k sqrt((mu_along s_x,k)^2 + (mu_across s_y,k)^2)

which is convex: the robot turns with the twist that dissipates least. Forces depend only on the direction of sliding,
so slip depends on the radius of the path, on mu_across / mu_along and on the length of contact, but not on speed,
weight or the magnitude of friction.

On ground that shears, an element of track that entered the contact at its front end x_f has been in it for the time
T = (x_f - x) / V. Over the ground it has moved since by

    j = P(0, x) - P(-T, x_f)

where P(t, x) is the place of the point x of the robot at time t, turning included (Wong and Chiang 2001). A belt that
runs backwards takes the ground in at its rear end; under one that stands, every element has slid for ever.
"""

from __future__ import annotations

import numpy as np

from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array
from trackslip.skid_theory.contact import Contact

_SMOOTHING = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # of |s| at 0, relative to the belts' speed
_STEP = 1e-6  # of finite differences, relative to the belts' speed
_ITERATIONS = 100
_HALVINGS = 30
_TOLERANCE = 1e-10  # of the balance, relative to the weight
_ACCEPTED = 1e-6  # the same where rounding stops the iteration
_SLOWEST = 1e-9  # a belt slower than this part of the faster one stands


def displacement(twist: Array, belt: Array, contact: Contact) -> Array:
    """Shear displacements (..., K, 2) [m] in the robot's frame, at twists (..., 3) and belt speeds (..., K) [m/s].

    Where a belt stands, it is infinite.
    """
    v, u, w = (twist[..., k, None] for k in range(3))
    rear, front = contact.ends
    entry = np.where(belt > 0, front, rear)
    standing = np.abs(belt) <= _SLOWEST * np.abs(belt).max(axis=-1, keepdims=True)
    time = (entry - contact.x) / np.where(standing, 1.0, belt)
    # after half a turn an element comes back to where it touched down, but not to ground that was never sheared
    time = np.minimum(time, np.pi / np.maximum(np.abs(w), _SLOWEST))
    half = w * time / 2
    sine, cosine = np.sin(half), np.cos(half)
    sin, cos = 2 * sine * cosine, 1 - 2 * sine**2
    chord = time * np.divide(sine, half, out=np.ones_like(half), where=half != 0)
    ahead, aside = chord * cosine, chord * sine
    along = contact.x - (entry * cos + contact.y * sin) + v * ahead + u * aside
    across = contact.y - (contact.y * cos - entry * sin) - v * aside + u * ahead
    moved = np.stack([along, across], axis=-1)
    return np.where(standing[..., None], np.inf, moved)


def ground_wrench(twist: Array, belt: Array, contact: Contact, load: Array, shear: float) -> Array:
    """Forces of the ground along and across the robot and their moment (..., 3), over the weight.

    Twists (..., 3), belt speeds (..., K) [m/s], and fractions (..., K) of the weight on the points.
    """
    v, u, w = (twist[..., k, None] for k in range(3))
    slide_x, slide_y = v - w * contact.y - belt, u + w * contact.x
    # where an element pivots its force reverses, within a space between points: without that, nothing might balance
    rear, front = contact.ends
    within = contact.across * w * (front - rear) / contact.x.size / 2
    size = np.sqrt((contact.along * slide_x) ** 2 + (contact.across * slide_y) ** 2 + within**2)
    share = -np.expm1(-np.linalg.norm(displacement(twist, belt, contact), axis=-1) / shear)
    per_speed = -load * share / np.where(size > 0, size, 1.0)
    force_x, force_y = per_speed * contact.along**2 * slide_x, per_speed * contact.across**2 * slide_y
    moment = contact.x * force_y - contact.y * force_x
    return np.stack([force_x.sum(axis=-1), force_y.sum(axis=-1), moment.sum(axis=-1)], axis=-1)


def least_power(belt: Array, contact: Contact, load: Array, required: Array) -> Array:
    """Twists (M, 3) at which Coulomb ground exerts `required` forces and moments (M, 3), over the weight.

    They minimise the power that belts at speeds (M, K) of order one dissipate under loads (M, K), plus the power of the
    required forces. Newton's method with backtracking, with less and less smoothing where the sliding reverses.
    """
    x, y = contact.x, contact.y
    # the sliding velocity, weighted by friction, is linear in the twist
    along = contact.along * np.stack([np.ones_like(x), np.zeros_like(x), -y], axis=1)  # (K, 3)
    across = contact.across * np.stack([np.zeros_like(x), np.ones_like(x), x], axis=1)  # (K, 3)

    def power(twist: Array, smoothing: float) -> tuple[Array, Array, Array, Array]:
        a, c = twist @ along.T - contact.along * belt, twist @ across.T
        size = np.sqrt(a**2 + c**2 + smoothing**2)
        return np.sum(load * size, axis=1) + np.sum(required * twist, axis=1), a, c, size

    left, right = belt[:, np.argmax(y)], belt[:, np.argmin(y)]
    twist = np.column_stack([(left + right) / 2, np.zeros(len(belt)), (right - left) / (4 * np.abs(y).mean())])
    for smoothing in _SMOOTHING:
        for _ in range(_ITERATIONS):
            value, a, c, size = power(twist, smoothing)
            n = load / size
            gradient = (n * a) @ along + (n * c) @ across + required
            parts = (
                (n * (1 - (a / size) ** 2), along, along),
                (n * (1 - (c / size) ** 2), across, across),
                (-n * a * c / size**2, along, across),
            )
            both_along, both_across, cross = (np.einsum("mk,ki,kj->mij", *part) for part in parts)
            hessian = both_along + both_across + cross + cross.swapaxes(1, 2)
            step = np.linalg.solve(hessian, -gradient[..., None])[..., 0]
            decrement = -np.einsum("mi,mi->m", gradient, step)
            length = np.ones(len(twist))
            for _ in range(_HALVINGS):  # until the power decreases sufficiently (Armijo)
                high = power(twist + length[:, None] * step, smoothing)[0] > value - 0.25 * length * decrement + 1e-15
                if not high.any():
                    break
                length[high] /= 2
            twist = twist + length[:, None] * step
            if decrement.max() < 1e-14:
                break
    return twist


def balance(belt: Array, contact: Contact, load: Array, required: Array, shear: float, start: Array) -> Array:
    """Twists (M, 3) at which the ground exerts `required` forces and moments (M, 3), over the weight.

    Belt speeds (M, K) are of order one; `load` (M, K) are the fractions of the weight on the points, `start` (M, 3) the
    first guess. Newton's method with a line search. Raises InvalidValueError where nothing balances.
    """
    gauge = float(np.abs(contact.y).mean())
    unit = np.array([1.0, 1.0, 1 / gauge])  # of the twist
    lever = np.array([1.0, 1.0, gauge])  # of the balance

    def missing(twist: Array, rows: np.ndarray) -> Array:
        lacking: Array = ground_wrench(twist, belt[rows], contact, load[rows], shear) - required[rows]
        return lacking / lever

    twist, going = start.copy(), np.arange(len(start))
    error = missing(twist, going)
    for _ in range(_ITERATIONS):
        going = np.flatnonzero(np.linalg.norm(error, axis=1) > _TOLERANCE)
        if not going.size:
            return twist
        columns = [(missing(twist[going] + h, going) - error[going]) / _STEP for h in _STEP * np.diag(unit)]
        step = -np.linalg.solve(np.stack(columns, axis=-1), error[going][..., None])[..., 0] * unit
        length, before = np.ones(len(going)), np.linalg.norm(error[going], axis=1)
        for _ in range(_HALVINGS):
            trial = missing(twist[going] + length[:, None] * step, going)
            worse = ~(np.linalg.norm(trial, axis=1) < before)
            if not worse.any():
                break
            length[worse] /= 2
        length[worse] = 0.0
        twist[going] += length[:, None] * step
        error[going] = np.where(worse[:, None], error[going], trial)
        if worse.all():
            break
    short = np.linalg.norm(error, axis=1) > _ACCEPTED
    if short.any():
        lost = np.unique(belt[np.argmax(short)]).tolist()
        raise InvalidValueError("surface_speeds", lost, "speeds at which the ground carries the load")
    return twist
