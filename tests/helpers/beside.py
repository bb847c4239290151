"""An independent simulation of a robot with a plate in front of a scanner beside the field."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array, RobotGeometry
from trackslip.se2 import advance, compose, inverse

GEOMETRY = RobotGeometry(half_gauge=0.168, sprocket_radius=0.06)
D, EPSILON = 0.045, 0.0066
RATE = 50.0  # of the encoders [Hz]
LENGTH, THICKNESS = 0.6, 0.04

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
    knots = rng.uniform(-top, top, (int(duration / 2) + 2, 2))
    knots[0] = 0.0
    which = np.arange(rows) / RATE / 2
    k = which.astype(int)
    share = np.clip((which - k) * 4, 0.0, 1.0)[:, None]
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
    r, b = GEOMETRY.sprocket_radius * (1 + EPSILON), GEOMETRY.half_gauge + D
    v, w = r * (omega[:, 1] + omega[:, 0]) / 2, r * (omega[:, 1] - omega[:, 0]) / (2 * b)
    motion = np.column_stack([v, 0 * v, w])[1:] / RATE
    robot = se2.chain(np.array(start), se2.exp(motion))
    encoder_time = np.arange(len(omega)) / RATE

    def at(time: Array) -> Array:
        k = np.clip((np.asarray(time) * RATE).astype(int), 0, len(omega) - 2)
        return advance(
            robot[k], np.stack([v[k + 1], w[k + 1]], axis=-1), np.asarray(time) - k / RATE
        )

    def path(time: Array) -> Array:
        return compose(at(time), np.asarray(place, float))

    time = np.arange(0.1, encoder_time[-1] - 0.1, 0.05)
    increment = (fov / (beams - 1)) * (-1 if clockwise else 1)
    first = -increment * (beams - 1) / 2
    bearings = first + increment * np.arange(beams)
    step = scan_duration / (beams - 1)
    when = time[:, None] + step * np.arange(beams)
    origin = np.asarray(mount, float)
    direction = origin[2] + bearings + rng.normal(0.0, jitter, (len(time), 1))
    u = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    ranges = rectangle(path(when), (LENGTH, THICKNESS))(origin[:2], u, when)
    for thing in things:
        ranges = np.minimum(ranges, thing(origin[:2], u, when))
    ranges = ranges + rng.normal(0.0, noise, ranges.shape)
    if quantisation:
        ranges = np.round(ranges / quantisation) * quantisation
    return Session(encoder_time, omega, time, ranges, first, increment, step, origin, path, at)


def rectangle(pose: Array, size: tuple[float, float]) -> Thing:
    """A plate at poses (..., 3), one per ray."""

    def ranges(origin: Array, u: Array, time: Array) -> Array:
        cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        x, y = origin[0] - pose[..., 0], origin[1] - pose[..., 1]
        enter, leave = np.full(u.shape[:-1], -np.inf), np.full(u.shape[:-1], np.inf)
        for a, b, half in ((cos, sin, size[0] / 2), (-sin, cos, size[1] / 2)):
            o, d = a * x + b * y, a * u[..., 0] + b * u[..., 1]
            d = np.where(d == 0, 1e-12, d)
            ends = np.stack([(-half - o) / d, (half - o) / d])
            enter, leave = np.maximum(enter, ends.min(axis=0)), np.minimum(leave, ends.max(axis=0))
        return np.where((enter < leave) & (enter > 0), enter, np.inf)

    return ranges


def wall(start: Sequence[float], end: Sequence[float]) -> Thing:
    """A wall from `start` to `end` (2,)."""

    def ranges(origin: Array, u: Array, time: Array) -> Array:
        p, side = np.subtract(start, origin), np.subtract(end, start)
        cross = u[..., 0] * side[1] - u[..., 1] * side[0]
        cross = np.where(cross == 0, 1e-12, cross)
        distance = (p[0] * side[1] - p[1] * side[0]) / cross
        share = (p[0] * u[..., 1] - p[1] * u[..., 0]) / cross
        return np.where((distance > 0) & (share >= 0) & (share <= 1), distance, np.inf)

    return ranges


def cylinder(place: Callable[[Array], Array], radius: float) -> Thing:
    """An upright cylinder about `place(time)` (..., 2)."""

    def ranges(origin: Array, u: Array, time: Array) -> Array:
        c = place(time) - origin
        along = np.sum(c * u, axis=-1)
        inside = radius**2 - (np.sum(c * c, axis=-1) - along**2)
        near = along - np.sqrt(np.maximum(inside, 0.0))
        return np.where((inside > 0) & (near > 0), near, np.inf)

    return ranges


def post(x: float, y: float, radius: float = 0.05) -> Thing:
    return cylinder(lambda time: np.broadcast_to(np.array([x, y]), (*np.shape(time), 2)), radius)


def room() -> list[Thing]:
    corners = [(-4.0, -0.5), (-4.0, 7.0), (4.0, 7.0), (4.0, -0.5)]
    walls = [wall(a, b) for a, b in pairwise(corners)]
    return [*walls, post(-2.5, 1.0), post(2.6, 5.2), post(1.5, 6.5, 0.15)]
