"""Climbing limits of tracked robots by statics with Coulomb friction: steepest slope, highest step, tipping over.

Seen from its side, a track is the convex hull of its wheels. On a slope, friction holds up to tan(angle) = mu, and the
robot tips over where its centre of mass is above the last point that touches.

On a step, the robot touches the ground at its rear and the step's edge (or, below the edge, its face) further ahead.
The belts push as hard as friction allows at both. The robot climbs as long as this push is not negative, until its
centre of mass is above the edge; then it tips over onto the step. For a hull whose rear wheel of radius R stays on the
ground and whose straight run lies on the edge, the centre of mass is above the edge of a step of

    h = R (1 - cos theta) + (a - c tan theta) sin theta

at the pitch theta, with a the distance of the centre of mass ahead of the rear wheel's axis and c its height. The
highest step is the maximum over theta.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array

PITCHES = np.radians(np.arange(0.0, 85.0, 0.2))
"""Pitches of a robot on a step that are examined, (P,) [rad]."""
_HEIGHTS, _ROUNDS = 16, 5  # of the search for the highest step: each round divides the interval by the former
_TOUCHES = 1e-6  # tolerance of contact [m]


@dataclass(frozen=True)
class SideView:
    """A track and the robot's centre of mass, seen from the robot's left; x points forwards and z up."""

    wheels: Array  # (W, 3) x, z and radius of the wheels in the robot's frame [m]
    centre_of_mass: tuple[float, float]
    """Its x and z in the same frame [m]."""

    @property
    def ground(self) -> float:
        """Height of level ground in the robot's frame [m]."""
        return float((self.wheels[:, 1] - self.wheels[:, 2]).min())

    @property
    def ahead(self) -> float:
        """Distance of the centre of mass ahead of the last wheel that touches level ground [m]."""
        return self.centre_of_mass[0] - self.touching[0]

    @property
    def height(self) -> float:
        """Height of the centre of mass above level ground [m]."""
        return self.centre_of_mass[1] - self.ground

    @property
    def standing(self) -> Array:
        """The wheels that touch level ground, (S, 3) from rear to front [m]."""
        standing = self.wheels[self.wheels[:, 1] - self.wheels[:, 2] < self.ground + _TOUCHES]
        return standing[np.argsort(standing[:, 0])]

    @property
    def touching(self) -> tuple[float, float]:
        """Rear and front x of the contact with level ground in the robot's frame [m]."""
        return float(self.standing[0, 0]), float(self.standing[-1, 0])


def highest_step(view: SideView, friction: float) -> float:
    """The highest single step that the robot climbs slowly, limited by tipping over its edge or by friction [m].

    `friction` is the coefficient between belt and ground, and belt and step [-].
    """
    low, high = 0.0, float((view.wheels[:, 1] + view.wheels[:, 2]).max() - view.ground + view.ahead)
    for _ in range(_ROUNDS):
        heights = np.linspace(low, high, _HEIGHTS + 1)[1:]
        failing = ~climbs(view, friction, heights)
        first = int(np.argmax(failing)) if failing.any() else _HEIGHTS - 1
        low, high = (heights[first - 1] if first else low), heights[first]
    return float((low + high) / 2)


def climbs(view: SideView, friction: float, height: Array) -> np.ndarray:
    """Mask (H,) of the heights [m] of single steps that the robot climbs slowly."""
    push, over = push_on_step(view, friction, height)
    on_the_way = np.cumsum(over, axis=1) == 0
    return over.any(axis=1) & ((push >= 0) | ~on_the_way).all(axis=1)


def push_on_step(view: SideView, friction: float, height: Array) -> tuple[Array, np.ndarray]:
    """Forward push over the weight (H, P) of belts that slip on both contacts, and whether the robot is over the edge.

    For steps of heights (H,) [m] and PITCHES (P,); (H, P) bool where the centre of mass has passed the edge. Where the
    push at the edge would lift the rear, the rear pushes nothing.
    """
    sin, cos = np.sin(PITCHES), np.cos(PITCHES)
    wheels = _pitched(view.wheels[:, :2], sin, cos)  # (2, W, P)
    radius = view.wheels[:, 2, None]
    rear = np.argmin(wheels[1] - radius, axis=0)[None]  # the wheel that stands on the ground
    origin = np.stack([np.take_along_axis(wheels[0], rear, 0), np.take_along_axis(wheels[1] - radius, rear, 0)])
    ends, normal = _runs(view.wheels)
    first, second = (_pitched(end, sin, cos) - origin for end in ends.swapaxes(0, 1))
    contacts = [
        _on_wheels(wheels - origin, radius, height),
        _on_runs(first, second, _pitched(normal, sin, cos), height),
    ]
    places, angles, heights = (np.concatenate(parts) for parts in zip(*contacts, strict=True))  # (C, H, P) each
    foremost = np.argmax(places, axis=0)[None]
    edge, angle, touched = (np.take_along_axis(values, foremost, 0)[0] for values in (places, angles, heights))
    centre = (_pitched(np.array([view.centre_of_mass]), sin, cos) - origin)[0, 0]
    forwards = friction * np.cos(angle) - np.sin(angle)  # of the force on the robot, per normal force
    upwards = friction * np.sin(angle) + np.cos(angle)
    load = centre / (edge * upwards - touched * forwards)
    return friction * np.maximum(1 - load * upwards, 0) + load * forwards, centre >= edge


def _pitched(points: Array, sin: Array, cos: Array) -> Array:
    """Points or directions (K, 2) of a robot at P pitches, (2, K, P)."""
    x, z = points.T[:, :, None]
    return np.stack([cos * x - sin * z, sin * x + cos * z])


def _runs(wheels: Array) -> tuple[Array, Array]:
    """The straight runs of the hull of wheels (W, 3): ends (K, 2, 2) [m] and outward normals (K, 2)."""
    centre, radius = wheels[:, :2], wheels[:, 2]
    i, k = np.nonzero(~np.eye(len(wheels), dtype=bool))
    way = centre[k] - centre[i]
    length = np.hypot(*way.T)
    share = (radius[i] - radius[k]) / length
    apart = np.abs(share) < 1  # neither wheel within the other
    i, k, share, way = i[apart], k[apart], share[apart, None], (way / length[:, None])[apart]
    normal = share * way + np.sqrt(1 - share**2) * np.column_stack([way[:, 1], -way[:, 0]])
    beyond = (normal @ centre.T + radius).max(axis=1) - np.sum(normal * centre[i], axis=1) - radius[i]
    outer = beyond < _TOUCHES
    ends = np.stack([centre[j] + radius[j, None] * normal for j in (i, k)], axis=1)
    return ends[outer], normal[outer]


def _on_wheels(wheels: Array, radius: Array, height: Array) -> tuple[Array, Array, Array]:
    """Where wheels (2, W, P) reach furthest ahead at or below heights (H,): place, angle of the normal to the vertical,
    and height of that point, (W, H, P) [m, rad, m]; -inf where a wheel is above.
    """
    x, z, step = wheels[0][:, None], wheels[1][:, None], height[:, None]
    above = (z - step) / radius[:, None]
    angle = np.arccos(np.clip(above, 0, 1))
    place = np.where(above <= 1, x + radius[:, None] * np.sin(angle), -np.inf)
    return place, angle, np.minimum(z, step)


def _on_runs(first: Array, second: Array, normal: Array, height: Array) -> tuple[Array, Array, Array]:
    """The same for runs with ends (2, K, P) and outward normals (2, K, P), at the heights (H,) themselves."""
    step = height[:, None]
    (x0, z0), (x1, z1) = (end[:, :, None] for end in (first, second))
    rise = z1 - z0
    share = (step - z0) / np.where(rise == 0, np.inf, rise)
    within = (rise != 0) & (share >= 0) & (share <= 1)
    place = np.where(within, x0 + share * (x1 - x0), -np.inf)
    angle = np.broadcast_to(np.arctan2(normal[0], -normal[1])[:, None], place.shape)
    return place, angle, np.broadcast_to(step, place.shape)
