"""Obstacles in the scanner's field: posts, walls and walkers, by name, or from a TOML file."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from sim.toml_file import build, read_named
from trackslip.errors import Checked, checked, require, require_at_most, require_finite, require_positive
from trackslip.kinematics import Array

_MAX_COORDINATE = 1000.0  # largest coordinate [m]
_MAX_RADIUS = 10.0  # largest radius of a post or a person [m]
_MAX_SPEED = 20.0  # largest speed of a person along either axis [m/s]
PERSON = 0.25
"""Radius of a person [m]."""
_MAX_STANDING = 10_000  # largest number of posts, and of walls
_MAX_WALKERS = 100  # largest number of walkers, whose ranges must be computed for every scan
_MIN_DISTANCE = 0.01  # smallest distance of an obstacle from the scanner [m]


@dataclass(frozen=True)
class Post(Checked):
    """An upright cylinder."""

    x: float
    """Centre, in the world [m]."""
    y: float
    """Centre, in the world [m]."""
    radius: float = checked(0.05, require_positive, _MAX_RADIUS, "m")
    """Radius [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_coordinates(x=self.x, y=self.y)

    def ranges(self, origin: Array, direction: Array, time: Array) -> Array:
        """See `Obstacles.ranges`."""
        return _to_circle(np.array([self.x, self.y]) - origin, self.radius, direction)


@dataclass(frozen=True)
class Wall:
    """A thin straight wall."""

    x0: float
    """One end, in the world [m]."""
    y0: float
    """One end, in the world [m]."""
    x1: float
    """Other end, in the world [m]."""
    y1: float
    """Other end, in the world [m]."""

    def __post_init__(self) -> None:
        _require_coordinates(x0=self.x0, y0=self.y0, x1=self.x1, y1=self.y1)
        end = self.x1, self.y1
        require(end != (self.x0, self.y0), "x1, y1", end, "another place than x0, y0")

    def ranges(self, origin: Array, direction: Array, time: Array) -> Array:
        """See `Obstacles.ranges`; a beam parallel to the wall misses it."""
        start = np.array([self.x0, self.y0]) - origin
        side = np.array([self.x1 - self.x0, self.y1 - self.y0])
        # range * direction = start + share * side
        determinant = _cross(direction, side)
        with np.errstate(all="ignore"):
            distance = _cross(start, side) / determinant
            share = _cross(start, direction) / determinant
        return np.where((distance >= 0) & (share >= 0) & (share <= 1), distance, np.nan)


@dataclass(frozen=True)
class Walker(Checked):
    """A person: an upright cylinder that walks in a straight line, or to and fro."""

    x: float
    """Start of the centre, in the world [m]."""
    y: float
    """Start of the centre, in the world [m]."""
    vx: float
    """Velocity along the world's x axis [m/s]."""
    vy: float
    """Velocity along the world's y axis [m/s]."""
    radius: float = checked(PERSON, require_positive, _MAX_RADIUS, "m")
    """Radius [m]."""
    turns_after: float = math.inf
    """Time after which the person turns round, again and again [s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_coordinates(x=self.x, y=self.y)
        for name, speed in (("vx", self.vx), ("vy", self.vy)):
            require(abs(speed) <= _MAX_SPEED, name, speed, f"from {-_MAX_SPEED:g} to {_MAX_SPEED:g} m/s")
        require(self.turns_after > 0, "turns_after", self.turns_after, "a number > 0, or inf to walk straight on")

    def place(self, time: Array) -> Array:
        """Centre (..., 2) at times (...) since the start of the run [s] [m]."""
        time = np.asarray(time, float)
        if math.isfinite(self.turns_after):
            there_and_back = 2 * self.turns_after
            time = np.minimum(time % there_and_back, there_and_back - time % there_and_back)
        return np.stack([self.x + self.vx * time, self.y + self.vy * time], axis=-1)

    def ranges(self, origin: Array, direction: Array, time: Array) -> Array:
        """See `Obstacles.ranges`."""
        return _to_circle(self.place(time) - origin, self.radius, direction)


@dataclass(frozen=True)
class Obstacles:
    """Everything in the field, except the plate, that beams may hit."""

    posts: tuple[Post, ...] = ()
    walls: tuple[Wall, ...] = ()
    walkers: tuple[Walker, ...] = ()

    def __post_init__(self) -> None:
        for name, limit in (("posts", _MAX_STANDING), ("walls", _MAX_STANDING), ("walkers", _MAX_WALKERS)):
            require_at_most(f"number of {name}", len(getattr(self, name)), limit)

    def __bool__(self) -> bool:
        return any(getattr(self, f.name) for f in fields(self))

    def ranges(self, origin: Array, direction: Array, time: Array) -> Array:
        """Distances (...) to the nearest obstacle, NaN where there is none [m].

        The beams start at `origin` (2,) [m] in the directions (..., 2), unit vectors, each at its `time` since the
        start of the run, which broadcasts against (...) [s]. The distance is 0 inside a post or a person.
        """
        nearest = np.full(direction.shape[:-1], np.nan)
        for f in fields(self):
            for obstacle in getattr(self, f.name):
                nearest = np.fmin(nearest, obstacle.ranges(origin, direction, time))
        return nearest

    def require_clear(self, scanner: Array) -> None:
        """Raise InvalidValueError if an obstacle stands on the scanner (2,) [m]; a walker, at the start of the run."""
        angle = np.linspace(0.0, 2 * np.pi, 360)
        around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        x, y = np.round(scanner, 3) + 0.0
        allowed = f"at least {_MIN_DISTANCE:g} m away from the scanner, which is at ({x:g}, {y:g})"
        for f in fields(self):
            for k, obstacle in enumerate(getattr(self, f.name)):
                near = (obstacle.ranges(scanner, around, np.zeros(1)) < _MIN_DISTANCE).any()
                require(not near, f"{f.name}[{k}]", obstacle, allowed)


def _to_circle(centre: Array, radius: float, direction: Array) -> Array:
    """Distances (...) along unit vectors (..., 2) from the origin to circles around `centre` (..., 2), or NaN."""
    along = np.sum(centre * direction, axis=-1)
    across = _cross(direction, centre)
    half_chord = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    met = (np.abs(across) <= radius) & (along + half_chord >= 0)
    return np.where(met, np.maximum(along - half_chord, 0.0), np.nan)


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _require_coordinates(**coordinates: float) -> None:
    for name, value in coordinates.items():
        require_finite(name, value)
        require(abs(value) <= _MAX_COORDINATE, name, value, f"from {-_MAX_COORDINATE:g} to {_MAX_COORDINATE:g} m")


NAMED_OBSTACLES: dict[str, Obstacles] = {
    # beside and behind the circles, two of them closer to the largest one than a plate is long
    "posts": Obstacles(
        posts=(Post(2.3, 2.0), Post(-5.3, 4.0), Post(1.6, 6.0), Post(-1.5, 7.2, 0.15), Post(-3.5, -0.8))
    ),
    "room": Obstacles(
        walls=(
            Wall(-6.0, -2.0, -6.0, 8.0),
            Wall(-6.0, 8.0, 3.0, 8.0),
            Wall(3.0, 8.0, 3.0, -2.0),
            Wall(3.0, -2.0, -6.0, -2.0),
        )
    ),
    # between the scanner and the circles, so that the plate is hidden at times
    "walker": Obstacles(walkers=(Walker(-4.5, -0.7, 1.0, 0.0, turns_after=6.0),)),
    # it hides a part of every circle
    "occluded": Obstacles(posts=(Post(-1.61, -0.71),)),
}
"""Obstacles around the circles of a grid, in front of the scanner.

It stands at (-1.5, -1.5) and looks along +y. The circles touch each other at (-1.5, 0) and lie beyond it, the largest
from x = -4.7 to 1.7 and up to y = 6.3. No obstacle stands in the way of a robot of the grid.
"""


def load_obstacles(source: str) -> Obstacles:
    """Load obstacles by name, or from a TOML file with tables `[[posts]]`, `[[walls]]` and `[[walkers]]`.

    Raises InvalidValueError for any other source, SettingsFileError for an unreadable file and invalid fields.
    """
    if source in NAMED_OBSTACLES:
        return NAMED_OBSTACLES[source]
    return build(Obstacles, read_named("obstacles", source, NAMED_OBSTACLES), source)
