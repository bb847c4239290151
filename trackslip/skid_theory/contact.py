"""Contact of tracks or wheels with the ground, ground forces, and the twists at which ground forces
balance a load.

On Coulomb ground, the forces are minus the gradient of the dissipated power

    P(v, u, w) = sum_k N_k sqrt((mu_along s_x,k)^2 + (mu_across s_y,k)^2)

which is convex: the robot moves with the twist that dissipates least power. Forces depend only on
the direction of sliding, so slip depends on the radius of the path, on mu_across / mu_along and on
the contact length, but not on speed, weight or the magnitude of friction.

On ground that shears, an element of track at x entered the contact at its front end x_f, a time T =
(x_f - x) / V ago. Since then, it has moved over the ground by

    j = P(0, x) - P(-T, x_f)

where P(t, x) is the position of the robot's point x at time t, turning included (Wong and Chiang
2001). On a belt that runs backwards, elements enter at the rear end. On a belt at rest, every
element has slid for an infinite time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import (
    InvalidValueError,
    require,
    require_finite,
    require_non_negative,
    require_positive,
)
from trackslip.kinematics import Array


@dataclass(frozen=True)
class Load:
    """A slope and a drawbar pull, in addition to the weight of a robot on level ground."""

    slope: float = 0.0
    """Angle of the ground to the horizontal [rad]."""
    uphill: float = 0.0
    """Direction of uphill in the robot's frame: 0 straight ahead, positive to the left [rad]."""
    pull: float = 0.0
    """Drawbar force, backwards along the robot, divided by the robot's weight [-]."""
    hitch_height: float = 0.0
    """Height of the drawbar above the ground [m]."""

    def __post_init__(self) -> None:
        require_non_negative("slope", self.slope)
        require(self.slope < math.pi / 2, "slope", self.slope, "less than pi / 2")
        for name in ("uphill", "pull", "hitch_height"):
            require_finite(name, getattr(self, name))

    @property
    def downhill(self) -> Array:
        """Ground force (2,) along and across the robot that balances the slope, per normal force
        [-].
        """
        return math.tan(self.slope) * np.array([math.cos(self.uphill), math.sin(self.uphill)])

    @property
    def drawbar(self) -> float:
        """The pull divided by the normal force [-]."""
        return self.pull / math.cos(self.slope)


@dataclass(frozen=True)
class Contact:
    """Contact points of the tracks, their friction, and the centre of mass."""

    x: Array  # (K,) forwards along the robot [m]
    y: Array  # (K,) to the left of the robot [m]; points with y > 0 are on the left track
    along: float
    """Friction coefficient along the track [-]."""
    across: float
    """Friction coefficient across the track [-]."""
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Distances ahead and to the left of the centre between the tracks, and height above the ground
    [m].
    """
    patch: tuple[Array, Array] | None = None
    """Rear and front ends (K,) of the contact patch of each point [m]; None if each track has a
    single patch.
    """

    def __post_init__(self) -> None:
        require_positive("along", self.along)
        require_positive("across", self.across)
        if not (self.x.shape == self.y.shape and self.x.ndim == 1 and self.x.size > 0):
            raise InvalidValueError("x, y", (self.x.shape, self.y.shape), "two equal (K,)")
        require(
            np.isfinite(self.centre_of_mass).all(), "centre_of_mass", self.centre_of_mass, "finite"
        )
        if self.loads(np.zeros(2)).min() < 0:
            raise InvalidValueError(
                "centre_of_mass",
                self.centre_of_mass,
                "close enough to the middle to load every point of the tracks",
            )

    @property
    def ends(self) -> tuple[Array | float, Array | float]:
        """Rear and front ends of the patches [m]; for tracks, half a point spacing beyond the
        outermost points.
        """
        if self.patch is not None:
            return self.patch
        x = np.unique(self.x)
        half_space = (x[-1] - x[0]) / max(len(x) - 1, 1) / 2
        return float(x[0] - half_space), float(x[-1] + half_space)

    def loads(self, acceleration: Array, drawbar_moment: float = 0.0) -> Array:
        """Fractions (..., K) of the weight on each point, at accelerations (..., 2) of the centre
        of mass along and across the robot, in units of gravity, and under a drawbar moment divided
        by the weight [m].

        The robot is rigid on equal springs: loads are linear in position and balance the moments of
        weight and inertia.
        """
        forwards, left, height = self.centre_of_mass
        middle_x, middle_y = (
            forwards - height * acceleration[..., :1],
            left - height * acceleration[..., 1:],
        )
        middle_x = middle_x - drawbar_moment
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
    """Build two tracks with uniform pressure on the ground, apart from the effect of the centre of
    mass.

    Lengths are in m; `along` and `across` are friction coefficients. Each track has `points` points
    in the middle of equal segments. Raises InvalidValueError if a value is not positive, or the
    centre of mass lifts part of a track.
    """
    require_positive("half_length", half_length)
    return wheel_contact(half_gauge, (0.0,), 2 * half_length, along, across, centre_of_mass, points)


def wheel_contact(
    half_gauge: float,
    axles: Sequence[float],
    patch_length: float,
    along: float,
    across: float,
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0),
    points: int = 20,
) -> Contact:
    """Build wheels with `points` points on patches of uniform pressure, one patch at each end of an
    axle.

    `axles` are the axles' distances ahead of their centre [m], with mean 0. For other arguments,
    see `line_contact`.
    """
    require_positive("half_gauge", half_gauge)
    require_positive("patch_length", patch_length)
    segment = (np.arange(points) + 0.5) / points - 0.5
    middle = np.repeat(np.tile(axles, 2), points)
    x = middle + patch_length * np.tile(segment, 2 * len(axles))
    y = np.repeat([half_gauge, -half_gauge], points * len(axles))
    return Contact(
        x, y, along, across, centre_of_mass, (middle - patch_length / 2, middle + patch_length / 2)
    )


# smoothing of |s| around 0, relative to the belt speed
_SMOOTHING = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
_STEP = 1e-6  # step of finite differences, relative to the belt speed
_ITERATIONS = 100
_HALVINGS = 30
_TOLERANCE = 1e-10  # tolerance of the balance, relative to the weight
_ACCEPTED = 1e-6  # tolerance of the balance if rounding stops the iteration
_SLOWEST = 1e-9  # fraction of the faster belt's speed below which a belt counts as standing


def displacement(twist: Array, belt: Array, contact: Contact) -> Array:
    """Shear displacements (..., K, 2) [m] in the robot's frame, at twists (..., 3) and belt speeds
    (..., K) [m/s].

    Displacements are infinite where a belt stands still.
    """
    v, u, w = (twist[..., k, None] for k in range(3))
    rear, front = contact.ends
    entry = np.where(belt > 0, front, rear)
    standing = np.abs(belt) <= _SLOWEST * np.abs(belt).max(axis=-1, keepdims=True)
    time = (entry - contact.x) / np.where(standing, 1.0, belt)
    # after half a turn an element approaches its first place again, but the ground there remains
    # sheared
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
    """Ground forces along and across the robot and their moment (..., 3), divided by the weight.

    The arguments are twists (..., 3), belt speeds (..., K) [m/s] and fractions `load` (..., K) of
    the weight on points.
    """
    v, u, w = (twist[..., k, None] for k in range(3))
    slide_x, slide_y = v - w * contact.y - belt, u + w * contact.x
    # where an element pivots, its force reverses over one point spacing, as a jump might prevent a
    # balance
    rear, front = contact.ends
    within = contact.across * w * (front - rear) / contact.x.size / 2
    size = np.sqrt((contact.along * slide_x) ** 2 + (contact.across * slide_y) ** 2 + within**2)
    share = -np.expm1(-np.linalg.norm(displacement(twist, belt, contact), axis=-1) / shear)
    per_speed = -load * share / np.where(size > 0, size, 1.0)
    force_x, force_y = (
        per_speed * contact.along**2 * slide_x,
        per_speed * contact.across**2 * slide_y,
    )
    moment = contact.x * force_y - contact.y * force_x
    return np.stack([force_x.sum(axis=-1), force_y.sum(axis=-1), moment.sum(axis=-1)], axis=-1)


def least_power(belt: Array, contact: Contact, load: Array, required: Array) -> Array:
    """Twists (M, 3) at which Coulomb ground exerts `required` forces and moments (M, 3), divided by
    the weight.

    They minimise the power that belts at speeds (M, K) of order one dissipate under loads (M, K),
    plus the power of the required forces. Newton's method is used, with backtracking and decreasing
    smoothing where sliding reverses.
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
    twist = np.column_stack(
        [(left + right) / 2, np.zeros(len(belt)), (right - left) / (4 * np.abs(y).mean())]
    )
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
                high = (
                    power(twist + length[:, None] * step, smoothing)[0]
                    > value - 0.25 * length * decrement + 1e-15
                )
                if not high.any():
                    break
                length[high] /= 2
            twist = twist + length[:, None] * step
            if decrement.max() < 1e-14:
                break
    return twist


def balance(
    belt: Array, contact: Contact, load: Array, required: Array, shear: float, start: Array
) -> Array:
    """Twists (M, 3) at which the ground exerts `required` forces and moments (M, 3), divided by the
    weight.

    Belt speeds (M, K) are of order one; `load` (M, K) are the fractions of the weight on the
    points, `start` (M, 3) the initial twists. The solver is Newton's method with a line search.
    Raises InvalidValueError if no twist is a balance.
    """
    gauge = float(np.abs(contact.y).mean())
    unit = np.array([1.0, 1.0, 1 / gauge])  # units of the twist
    lever = np.array([1.0, 1.0, gauge])  # units of the balance

    def missing(twist: Array, rows: np.ndarray) -> Array:
        lacking: Array = (
            ground_wrench(twist, belt[rows], contact, load[rows], shear) - required[rows]
        )
        return lacking / lever

    twist, going = start.copy(), np.arange(len(start))
    error = missing(twist, going)
    for _ in range(_ITERATIONS):
        going = np.flatnonzero(np.linalg.norm(error, axis=1) > _TOLERANCE)
        if not going.size:
            return twist
        columns = [
            (missing(twist[going] + h, going) - error[going]) / _STEP for h in _STEP * np.diag(unit)
        ]
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
        raise InvalidValueError(
            "surface_speeds", lost, "speeds at which the ground carries the load"
        )
    return twist
