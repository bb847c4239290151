"""Contact of tracks or wheels with the ground, its forces, and twists that balance a load.

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
from typing import Final

import numpy as np

from trackslip.errors import (
    InvalidValueError,
    require,
    require_finite,
    require_non_negative,
    require_positive,
)
from trackslip.kinematics import Array

# smoothing of |s| around 0, relative to the belt speed, in successive minimisations
_SMOOTHING: Final = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
_DIFFERENCE_STEP: Final = 1e-6  # step of finite differences, relative to the belt speed
_MAX_ITERATIONS: Final = 100
_MAX_HALVINGS: Final = 30
_DECREASE_SHARE: Final = 0.25  # smallest share of the expected decrease of power in a step [-]
_POWER_ROUNDING: Final = 1e-15  # rounding error of the power, relative to weight and belt speed
_MIN_DECREMENT: Final = 1e-14  # expected decrease of the power at which the minimum is reached
_TOLERANCE: Final = 1e-10  # tolerance of the balance, relative to the weight
_ACCEPTED_ERROR: Final = 1e-6  # tolerance of the balance if rounding stops the iteration
# fraction of the faster belt's speed below which a belt counts as standing, and of 1 rad/s below
# which a robot counts as driving straight on
_STANDSTILL: Final = 1e-9


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
        """Ground force (2,) along and across that balances the slope, per normal force [-]."""
        uphill = np.array([math.cos(self.uphill), math.sin(self.uphill)])
        return math.tan(self.slope) * uphill

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
    """Distances ahead and to the left of the centre between the tracks, and height [m]."""
    patch: tuple[Array, Array] | None = None
    """Rear and front ends (K,) of each point's contact patch [m]; None for one patch a track."""

    def __post_init__(self) -> None:
        require_positive("along", self.along)
        require_positive("across", self.across)
        shapes = (self.x.shape, self.y.shape)
        is_pair = self.x.shape == self.y.shape and self.x.ndim == 1 and self.x.size > 0
        require(is_pair, "x, y", shapes, "two equal (K,)")
        is_finite = bool(np.isfinite(self.centre_of_mass).all())
        require(is_finite, "centre_of_mass", self.centre_of_mass, "finite")
        lifts_a_point = self.loads(np.zeros(2)).min() < 0
        allowed = "close enough to the middle to load every point of the tracks"
        require(not lifts_a_point, "centre_of_mass", self.centre_of_mass, allowed)

    @property
    def ends(self) -> tuple[Array | float, Array | float]:
        """Rear and front ends of the patches [m]; tracks end half a spacing beyond their points."""
        if self.patch is not None:
            return self.patch
        x = np.unique(self.x)
        half_space = (x[-1] - x[0]) / max(len(x) - 1, 1) / 2
        return float(x[0] - half_space), float(x[-1] + half_space)

    def loads(self, acceleration: Array, drawbar_moment: float = 0.0) -> Array:
        """Fractions (..., K) of the weight on each point at accelerations (..., 2).

        `acceleration` is that of the centre of mass along and across the robot, in units of
        gravity, `drawbar_moment` a moment divided by the weight [m].

        The robot is rigid on equal springs, so loads are linear in position. The weight, inertia
        and drawbar act like a weight at (x_c, y_c), the point where their resultant meets the
        ground, and the fraction on the point (x, y) of K points, centred on the origin, is

            (1 + x_c x / mean(x^2) + y_c y / mean(y^2)) / K
        """
        forwards, left, height = self.centre_of_mass
        x_c = forwards - height * acceleration[..., :1]
        x_c = x_c - drawbar_moment
        y_c = left - height * acceleration[..., 1:]
        relative = 1 + x_c * self.x / np.mean(self.x**2) + y_c * self.y / np.mean(self.y**2)
        return relative / self.x.size


def line_contact(
    half_gauge: float,
    half_length: float,
    along: float,
    across: float,
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0),
    points: int = 200,
) -> Contact:
    """Build two tracks with uniform pressure, apart from the effect of the centre of mass.

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
    """Build wheels with `points` points on patches of uniform pressure, two patches an axle.

    `axles` are the axles' distances ahead of their centre [m], with mean 0. For other arguments,
    see `line_contact`.
    """
    require_positive("half_gauge", half_gauge)
    require_positive("patch_length", patch_length)
    segment = (np.arange(points) + 0.5) / points - 0.5  # places in a patch of length 1
    middle = np.repeat(np.tile(axles, 2), points)
    x = middle + patch_length * np.tile(segment, 2 * len(axles))
    y = np.repeat([half_gauge, -half_gauge], points * len(axles))
    rear = middle - patch_length / 2
    front = middle + patch_length / 2
    return Contact(x, y, along, across, centre_of_mass, (rear, front))


def displacement(twist: Array, belt: Array, contact: Contact) -> Array:
    """Shear displacements (..., K, 2) [m] in the robot's frame; infinite where a belt stands still.

    The arguments are twists (v, u, w) (..., 3) and belt speeds (..., K) [m/s].

    An element at (x, y) entered the contact at (x_f, y), a time T ago. Since then the robot has
    turned by w T and moved along an arc, whose chord is T sin(h) / h of its speed, with h = w T /
    2. In the robot's present frame, the robot has moved by

        (v a + u b, u a - v b)        a = T sin(h) cos(h) / h        b = T sin(h)^2 / h

    and (x_f, y) at the time of the entry is turned back by w T.
    """
    v, u, w = (twist[..., k, None] for k in range(3))
    rear, front = contact.ends
    entry = np.where(belt > 0, front, rear)  # x_f
    fastest = np.abs(belt).max(axis=-1, keepdims=True)
    is_standing = np.abs(belt) <= _STANDSTILL * fastest
    time = (entry - contact.x) / np.where(is_standing, 1.0, belt)
    # after half a turn an element approaches its first place again, but the ground there remains
    # sheared
    half_turn_time = np.pi / np.maximum(np.abs(w), _STANDSTILL)
    time = np.minimum(time, half_turn_time)

    half = w * time / 2
    half_sin = np.sin(half)
    half_cos = np.cos(half)
    sin = 2 * half_sin * half_cos
    cos = 1 - 2 * half_sin**2
    chord = time * np.divide(half_sin, half, out=np.ones_like(half), where=half != 0)
    a = chord * half_cos
    b = chord * half_sin
    turned_x = entry * cos + contact.y * sin
    turned_y = contact.y * cos - entry * sin
    along = contact.x - turned_x + v * a + u * b
    across = contact.y - turned_y - v * b + u * a
    moved = np.stack([along, across], axis=-1)
    return np.where(is_standing[..., None], np.inf, moved)


def ground_wrench(twist: Array, belt: Array, contact: Contact, load: Array, shear: float) -> Array:
    """Ground forces along and across the robot and their moment (..., 3), divided by the weight.

    The arguments are twists (..., 3), belt speeds (..., K) [m/s], fractions `load` (..., K) of the
    weight on points, and the modulus `shear` [m]. The forces are those of the package's docstring.
    """
    v, u, w = (twist[..., k, None] for k in range(3))
    slide_x = v - w * contact.y - belt
    slide_y = u + w * contact.x

    # where an element pivots, its force reverses over one point spacing, as a jump might prevent a
    # balance
    rear, front = contact.ends
    pivot_speed = contact.across * w * (front - rear) / contact.x.size / 2
    weighted_x = contact.along * slide_x
    weighted_y = contact.across * slide_y
    size = np.sqrt(weighted_x**2 + weighted_y**2 + pivot_speed**2)

    distance = np.linalg.norm(displacement(twist, belt, contact), axis=-1)
    sheared = -np.expm1(-distance / shear)  # 1 - exp(-|j| / K)
    per_speed = -load * sheared / np.where(size > 0, size, 1.0)
    force_x = per_speed * contact.along**2 * slide_x
    force_y = per_speed * contact.across**2 * slide_y
    moment = contact.x * force_y - contact.y * force_x
    return np.stack([force_x.sum(axis=-1), force_y.sum(axis=-1), moment.sum(axis=-1)], axis=-1)


def least_power(belt: Array, contact: Contact, load: Array, required: Array) -> Array:
    """Twists (M, 3) at which Coulomb ground exerts `required` forces and moments (M, 3).

    These are divided by the weight. The twists minimise the power that belts at speeds (M, K) of
    order one dissipate under loads (M, K), plus the power of the required forces. Newton's method
    is used, with backtracking and decreasing smoothing where sliding reverses.

    A point's sliding velocity, weighted by friction, is a along and c across, both linear in the
    twist t. With d = sqrt(a^2 + c^2 + smoothing^2), the power is P = sum N d + required t, and

        dP/dt   = sum N (a a' + c c') / d + required
        d2P/dt2 = sum N ((1 - a^2 / d^2) a' a'^T + (1 - c^2 / d^2) c' c'^T
                         - (a c / d^2) (a' c'^T + c' a'^T)) / d

    where a' and c' are the derivatives by t.
    """
    x = contact.x
    y = contact.y
    ones = np.ones_like(x)
    zeros = np.zeros_like(x)
    along = contact.along * np.stack([ones, zeros, -y], axis=1)  # a' (K, 3)
    across = contact.across * np.stack([zeros, ones, x], axis=1)  # c' (K, 3)

    def sliding(twist: Array, smoothing: float) -> tuple[Array, Array, Array]:
        """a, c and d, each (M, K), at twists (M, 3)."""
        a = twist @ along.T - contact.along * belt
        c = twist @ across.T
        return a, c, np.sqrt(a**2 + c**2 + smoothing**2)

    def power(twist: Array, size: Array) -> Array:
        """P (M,) at twists (M, 3) with d (M, K)."""
        return np.sum(load * size, axis=1) + np.sum(required * twist, axis=1)

    def times(weight: Array, left: Array, right: Array) -> Array:
        """Sums (M, 3, 3) over points of weights (M, K) and products of derivatives (K, 3)."""
        return np.einsum("mk,ki,kj->mij", weight, left, right)

    def newton_step(a: Array, c: Array, size: Array) -> tuple[Array, Array]:
        """The step (M, 3), and the decrease (M,) of the power by it at the present slope."""
        n = load / size
        gradient = (n * a) @ along + (n * c) @ across + required
        both_along = times(n * (1 - (a / size) ** 2), along, along)
        both_across = times(n * (1 - (c / size) ** 2), across, across)
        cross = times(-n * a * c / size**2, along, across)
        hessian = both_along + both_across + cross + cross.swapaxes(1, 2)
        step = np.linalg.solve(hessian, -gradient[..., None])[..., 0]
        return step, -np.einsum("mi,mi->m", gradient, step)

    # the twist without slip
    left = belt[:, np.argmax(y)]
    right = belt[:, np.argmin(y)]
    yaw_rate = (right - left) / (4 * np.abs(y).mean())
    twist = np.column_stack([(left + right) / 2, np.zeros(len(belt)), yaw_rate])
    for smoothing in _SMOOTHING:
        for _ in range(_MAX_ITERATIONS):
            a, c, size = sliding(twist, smoothing)
            value = power(twist, size)
            step, decrement = newton_step(a, c, size)

            # halve steps until the power decreases sufficiently (Armijo)
            length = np.ones(len(twist))
            for _ in range(_MAX_HALVINGS):
                trial = twist + length[:, None] * step
                *_, trial_size = sliding(trial, smoothing)
                allowed = value - _DECREASE_SHARE * length * decrement + _POWER_ROUNDING
                is_high = power(trial, trial_size) > allowed
                if not is_high.any():
                    break
                length[is_high] /= 2
            twist = twist + length[:, None] * step
            if decrement.max() < _MIN_DECREMENT:
                break
    return twist


def balance(
    belt: Array, contact: Contact, load: Array, required: Array, shear: float, start: Array
) -> Array:
    """Twists (M, 3) at which ground that shears exerts `required` forces and moments (M, 3).

    These are divided by the weight. Belt speeds (M, K) are of order one; `load` (M, K) are the
    fractions of the weight on the points, `start` (M, 3) the initial twists. The solver is Newton's
    method with a line search. Raises InvalidValueError if no twist is a balance.
    """
    gauge = float(np.abs(contact.y).mean())
    twist_units = np.array([1.0, 1.0, 1 / gauge])
    wrench_units = np.array([1.0, 1.0, gauge])

    def errors(twist: Array, rows: np.ndarray) -> Array:
        """Exerted minus required wrenches (R, 3) of the `rows` (R,), at twists (R, 3)."""
        exerted = ground_wrench(twist, belt[rows], contact, load[rows], shear)
        return np.asarray((exerted - required[rows]) / wrench_units)

    def newton_step(twist: Array, error: Array, rows: np.ndarray) -> Array:
        """The step (R, 3), with a Jacobian by finite differences."""
        differences = _DIFFERENCE_STEP * np.diag(twist_units)
        columns = [(errors(twist + h, rows) - error) / _DIFFERENCE_STEP for h in differences]
        jacobian = np.stack(columns, axis=-1)
        return -np.linalg.solve(jacobian, error[..., None])[..., 0] * twist_units

    twist = start.copy()
    error = errors(twist, np.arange(len(start)))
    for _ in range(_MAX_ITERATIONS):
        rows = np.flatnonzero(np.linalg.norm(error, axis=1) > _TOLERANCE)
        if not rows.size:
            return twist
        step = newton_step(twist[rows], error[rows], rows)

        # halve steps until the error decreases; drop those that never do
        length = np.ones(len(rows))
        size_before = np.linalg.norm(error[rows], axis=1)
        for _ in range(_MAX_HALVINGS):
            trial = errors(twist[rows] + length[:, None] * step, rows)
            is_worse = ~(np.linalg.norm(trial, axis=1) < size_before)  # NaN is worse
            if not is_worse.any():
                break
            length[is_worse] /= 2
        length[is_worse] = 0.0
        twist[rows] += length[:, None] * step
        error[rows] = np.where(is_worse[:, None], error[rows], trial)
        if is_worse.all():
            break

    is_unbalanced = np.linalg.norm(error, axis=1) > _ACCEPTED_ERROR
    if is_unbalanced.any():
        speeds = np.unique(belt[np.argmax(is_unbalanced)]).tolist()
        allowed = "speeds at which the ground carries the load"
        raise InvalidValueError("surface_speeds", speeds, allowed)
    return twist
