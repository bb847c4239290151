"""An independent simulation of a robot with a plate in front of a scanner beside the field."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array, RobotGeometry
from trackslip.se2 import advance, compose, inverse

GEOMETRY = RobotGeometry(half_gauge=0.168, sprocket_radius=0.06)
OFFSET = 0.045  # of the ICRs beyond the tracks [m]
RADIUS_ERROR = 0.0066  # of the sprockets, relative
RATE = 50.0  # of the encoders [Hz]
LENGTH = 0.6  # of the plate [m]
THICKNESS = 0.04  # of the plate [m]
NEVER_ZERO = 1e-12  # replaces a 0 that would be divided by

Thing = Callable[[Array, Array, Array], Array]
"""From the scanner (2,), directions (..., 2) and times (...) to ranges (...), inf for a miss."""


@dataclass(frozen=True)
class Session:
    encoder_time: Array  # (E,) [s]
    omega: Array  # (E, 2) mean since the previous reading [rad/s]
    time: Array  # (S,) of the first rays [s]
    ranges: Array  # (S, B) [m]; inf for no return
    angle_min: float
    angle_increment: float
    time_increment: float
    mount: Array  # (3,) of the scanner in the world
    path: Callable[[Array], Array]  # times (...) to true poses (..., 3) of the plate in the world
    robot: Callable[[Array], Array]  # the same of the robot

    def local(self, time: Array) -> Array:
        """True poses (..., 3) of the plate in the scanner's frame."""
        return compose(inverse(self.mount), self.path(time))


def teleoperated(rng: np.random.Generator, duration: float, top: float = 5.0) -> Array:
    """Sprocket speeds (E, 2) at RATE: a new random pair every two seconds, reached within half a
    second.
    """
    rows = round(duration * RATE)
    pairs = int(duration / 2) + 2
    knots = rng.uniform(-top, top, (pairs, 2))
    knots[0] = 0.0
    periods = np.arange(rows) / RATE / 2
    k = periods.astype(int)
    share = np.clip((periods - k) * 4, 0.0, 1.0)[:, None]
    return knots[k] * (1 - share) + knots[k + 1] * share


def drive(
    omega: Array,
    start: Sequence[float] = (0.0, 3.0, 0.0),
    mount: Sequence[float] = (0.0, 0.0, np.pi / 2),
    place: Sequence[float] = (0.0, 0.0, 0.0),
    things: Sequence[Thing] = (),
    noise: float = 0.005,
    seed: int = 0,
    beams: int = 361,
    fov: float = np.pi,
    scan_duration: float = 0.0,
    clockwise: bool = False,
    quantisation: float = 0.0,
    jitter: float = 0.0,
) -> Session:
    """Drive exactly by the law of constant ICRs, and scan."""
    rng = np.random.default_rng(seed)
    radius = GEOMETRY.sprocket_radius * (1 + RADIUS_ERROR)
    half_width = GEOMETRY.half_gauge + OFFSET
    left = omega[:, 0]
    right = omega[:, 1]
    v = radius * (right + left) / 2
    w = radius * (right - left) / (2 * half_width)
    motion = np.column_stack([v, 0 * v, w])[1:] / RATE
    robot = se2.chain(np.array(start), se2.exp(motion))
    encoder_time = np.arange(len(omega)) / RATE

    def at(time: Array) -> Array:
        """Poses (..., 3) of the robot."""
        time = np.asarray(time)
        k = np.clip((time * RATE).astype(int), 0, len(omega) - 2)
        twist = np.stack([v[k + 1], w[k + 1]], axis=-1)
        return advance(robot[k], twist, time - k / RATE)

    def path(time: Array) -> Array:
        """Poses (..., 3) of the plate."""
        return compose(at(time), np.asarray(place, float))

    # every ray at its own time
    time = np.arange(0.1, encoder_time[-1] - 0.1, 0.05)
    sense = -1 if clockwise else 1
    increment = (fov / (beams - 1)) * sense
    first = -increment * (beams - 1) / 2
    bearings = first + increment * np.arange(beams)
    step = scan_duration / (beams - 1)
    when = time[:, None] + step * np.arange(beams)

    scanner = np.asarray(mount, float)
    wobble = rng.normal(0.0, jitter, (len(time), 1))
    direction = scanner[2] + bearings + wobble
    u = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    plate = rectangle(path(when), (LENGTH, THICKNESS))
    ranges = plate(scanner[:2], u, when)
    for thing in things:
        ranges = np.minimum(ranges, thing(scanner[:2], u, when))
    ranges = ranges + rng.normal(0.0, noise, ranges.shape)
    if quantisation:
        ranges = np.round(ranges / quantisation) * quantisation
    return Session(
        encoder_time=encoder_time,
        omega=omega,
        time=time,
        ranges=ranges,
        angle_min=first,
        angle_increment=increment,
        time_increment=step,
        mount=scanner,
        path=path,
        robot=at,
    )


def rectangle(pose: Array, size: tuple[float, float]) -> Thing:
    """A plate at poses (..., 3), one per ray.

    In the plate's frame it is the overlap of two slabs, |x| <= length / 2 and |y| <= thickness / 2.
    A ray is inside from the later entry into a slab to the earlier exit from one.
    """
    half_length = size[0] / 2
    half_thickness = size[1] / 2

    def ranges(origin: Array, u: Array, time: Array) -> Array:
        cos = np.cos(pose[..., 2])
        sin = np.sin(pose[..., 2])
        x = origin[0] - pose[..., 0]
        y = origin[1] - pose[..., 1]
        enter = np.full(u.shape[:-1], -np.inf)
        leave = np.full(u.shape[:-1], np.inf)
        # along and across the plate: the axis' components and the slab's half
        for axis_x, axis_y, half in ((cos, sin, half_length), (-sin, cos, half_thickness)):
            offset = axis_x * x + axis_y * y
            advance = axis_x * u[..., 0] + axis_y * u[..., 1]
            advance = np.where(advance == 0, NEVER_ZERO, advance)
            ends = np.stack([(-half - offset) / advance, (half - offset) / advance])
            enter = np.maximum(enter, ends.min(axis=0))
            leave = np.minimum(leave, ends.max(axis=0))
        hit = (enter < leave) & (enter > 0)
        return np.where(hit, enter, np.inf)

    return ranges


def wall(start: Sequence[float], end: Sequence[float]) -> Thing:
    """A wall from `start` to `end` (2,).

    With p from the scanner to `start` and s along the wall, distance u = p + share s is solved by
    cross products: distance = p x s / u x s and share = p x u / u x s.
    """

    def cross(a: Array, b: Array) -> Array:
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

    def ranges(origin: Array, u: Array, time: Array) -> Array:
        p = np.subtract(start, origin)
        side = np.subtract(end, start)
        slant = cross(u, side)
        slant = np.where(slant == 0, NEVER_ZERO, slant)
        distance = cross(p, side) / slant
        share = cross(p, u) / slant
        hit = (distance > 0) & (share >= 0) & (share <= 1)
        return np.where(hit, distance, np.inf)

    return ranges


def cylinder(place: Callable[[Array], Array], radius: float) -> Thing:
    """An upright cylinder about `place(time)` (..., 2)."""

    def ranges(origin: Array, u: Array, time: Array) -> Array:
        centre = place(time) - origin
        along = np.sum(centre * u, axis=-1)
        aside_squared = np.sum(centre * centre, axis=-1) - along**2
        half_chord_squared = radius**2 - aside_squared
        near = along - np.sqrt(np.maximum(half_chord_squared, 0.0))
        hit = (half_chord_squared > 0) & (near > 0)
        return np.where(hit, near, np.inf)

    return ranges


def post(x: float, y: float, radius: float = 0.05) -> Thing:
    def place(time: Array) -> Array:
        return np.broadcast_to(np.array([x, y]), (*np.shape(time), 2))

    return cylinder(place, radius)


def room() -> list[Thing]:
    corners = [(-4.0, -0.5), (-4.0, 7.0), (4.0, 7.0), (4.0, -0.5)]
    walls = [wall(a, b) for a, b in pairwise(corners)]
    return [*walls, post(-2.5, 1.0), post(2.6, 5.2), post(1.5, 6.5, 0.15)]
