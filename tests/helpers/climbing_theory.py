"""The highest step that a tracked robot climbs slowly, by statics with Coulomb friction.

Seen from its side, a track is the convex hull of its wheels. The robot touches the ground at its
rear and the step's edge (or, below the edge, its face) further ahead. The belts push as hard as
friction allows at both. The robot climbs as long as this push is not negative, until its centre of
mass is above the edge; then it tips over onto the step. For a hull whose rear wheel of radius R
stays on the ground and whose straight run lies on the edge, the centre of mass is above the edge of
a step of

    h = R (1 - cos theta) + (a - c tan theta) sin theta

at the pitch theta, with a the distance of the centre of mass ahead of the rear wheel's axis and c
its height.
"""

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array

PITCHES = np.radians(np.arange(0.0, 85.0, 0.2))
_NORMALS = np.linspace(-np.pi / 2, 0, 500)  # angles of a hull's normals from below to ahead [rad]
_OUTWARD = np.stack([np.cos(_NORMALS), np.sin(_NORMALS)], axis=-1)
_TOUCHES = 1e-6  # tolerance of contact [m]


@dataclass(frozen=True)
class SideView:
    """A track and the robot's centre of mass, seen from the robot's left; x points forwards and z
    up.
    """

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
    def touching(self) -> tuple[float, float]:
        """Rear and front x of the contact with level ground in the robot's frame [m]."""
        lowest = self.wheels[:, 1] - self.wheels[:, 2]
        x = self.wheels[lowest < self.ground + _TOUCHES, 0]
        return float(x.min()), float(x.max())


def highest_step(view: SideView, friction: float) -> float:
    """Height of the highest step that the robot climbs [m].

    `friction` is the coefficient between belt and ground, and belt and step [-].
    """
    top = float((view.wheels[:, 1] + view.wheels[:, 2]).max())
    low = 0.0
    high = top - view.ground + view.ahead
    while high - low > 1e-6:
        middle = (low + high) / 2
        if climbs(view, friction, middle):
            low = middle
        else:
            high = middle
    return low


def climbs(view: SideView, friction: float, height: float) -> bool:
    """Whether the robot climbs a step of `height` [m] slowly, from pitch to pitch."""
    for pitch in PITCHES:
        push, over = push_on_step(view, friction, height, pitch)
        if over or push < 0:
            return over
    return False


def push_on_step(
    view: SideView, friction: float, height: float, pitch: float
) -> tuple[float, bool]:
    """Forward push over the weight of belts that slip on both contacts, and whether the robot is
    over the edge.

    Where the push at the edge would lift the rear, the rear pushes nothing.
    """
    turn = np.array([[np.cos(pitch), np.sin(pitch)], [-np.sin(pitch), np.cos(pitch)]])
    wheels = view.wheels[:, :2] @ turn
    radius = view.wheels[:, 2]
    lowest = np.argmin(wheels[:, 1] - radius)
    rear = wheels[lowest] - [0, radius[lowest]]
    centre = (view.centre_of_mass @ turn - rear)[0]

    # the hull's outline about the rear contact, from its lowest point to its front
    outer = np.argmax(_OUTWARD @ wheels.T + radius, axis=1)
    outline = wheels[outer] - rear + radius[outer, None] * _OUTWARD
    x, z = outline.T
    if z[-1] > height:
        edge = np.interp(height, z, x)
        touched = height
        angle = np.interp(height, z, _NORMALS)
    else:
        edge = x[-1]
        touched = z[-1]
        angle = 0.0

    # force of the edge per load: normal and friction forwards
    normal = -np.array([np.cos(angle), np.sin(angle)])
    tangent = np.array([normal[1], -normal[0]])
    force = normal + friction * tangent
    # forwards, upwards and moment about the rear contact: loads of the rear and of the edge, and
    # the push that is left
    moment = edge * force[1] - touched * force[0]
    system = [
        [friction, force[0], -1],
        [1, force[1], 0],
        [0, moment, 0],
    ]
    rear_load, front_load, push = np.linalg.solve(system, [0, 1, centre])
    if rear_load <= 0:
        push = front_load * force[0]
    return float(push), bool(centre >= edge)
