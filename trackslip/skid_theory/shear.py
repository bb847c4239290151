"""Balance of a robot on ground that shears: share of the friction limit, forces, and the steady twist.

An element of track that entered the contact at its front end x_f has been in it for the time T = (x_f - x) / V. Over
the ground it has moved since by

    j = P(0, x) - P(-T, x_f)

where P(t, x) is the place of the point x of the robot at time t, turning included (Wong and Chiang 2001). A belt that
runs backwards takes the ground in at its rear end; under one that stands, every element has slid for ever.
"""

from __future__ import annotations

import numpy as np

from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array
from trackslip.skid_theory.contact import Contact

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


def shear_share(distance: Array, shear: float) -> Array:
    """Shares (...) of the friction limit after shear displacements (...) [m]; `shear` is the modulus K [m]."""
    return -np.expm1(-distance / shear)


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
    share = shear_share(np.linalg.norm(displacement(twist, belt, contact), axis=-1), shear)
    per_speed = -load * share / np.where(size > 0, size, 1.0)
    force_x, force_y = per_speed * contact.along**2 * slide_x, per_speed * contact.across**2 * slide_y
    moment = contact.x * force_y - contact.y * force_x
    return np.stack([force_x.sum(axis=-1), force_y.sum(axis=-1), moment.sum(axis=-1)], axis=-1)


def balance(speeds: Array, contact: Contact, load: Array, required: Array, shear: float, start: Array) -> Array:
    """Twists (M, 3) at which the ground exerts `required` forces and moments (M, 3), over the weight.

    Belt speeds (M, 2) are of order one; `load` (M, K) are the fractions of the weight on the points, `start` (M, 3) the
    first guess. Newton's method with a line search. Raises InvalidValueError where nothing balances.
    """
    belt = np.where(contact.y > 0, speeds[:, :1], speeds[:, 1:])  # (M, K)
    unit = np.array([1.0, 1.0, 1 / float(np.abs(contact.y).mean())])  # of the twist
    lever = np.array([1.0, 1.0, float(np.abs(contact.y).mean())])  # of the balance

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
        lost = speeds[np.argmax(short)].tolist()
        raise InvalidValueError("surface_speeds", lost, "speeds at which the ground carries the load")
    return twist
