"""The laser range finder (LRF) with its beams, rate and errors, and obstacles by name or from a
TOML file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, dataclass
from typing import Final

import numpy as np

from sim.common.settings import build, read_named
from trackslip.arguments import checks_arguments
from trackslip.errors import (
    Checked,
    checked,
    require,
    require_at_most,
    require_non_negative,
    require_positive,
    require_within,
)
from trackslip.kinematics import Array
from trackslip.localization.scan import Scan

_MAX_BEAMS: Final = 20_000  # largest number of beams per scan
_MIN_RATE: Final = 5.0  # smallest scan rate [Hz]
_MAX_ERROR: Final = 0.5  # largest range error from a single cause [m]
_MIN_STEP: Final = 1e-6  # smallest step to which ranges are rounded [m]
_COORDINATE: Final = (require_within, -1000.0, 1000.0, "m")  # check for coordinates
_MAX_RADIUS: Final = 10.0  # largest radius of a post [m]
_MAX_NUMBER: Final = 10_000  # largest number of posts and of walls
_MIN_DISTANCE: Final = 0.01  # smallest distance between an obstacle and the scanner [m]


def require_share(name: str, value: float) -> None:
    """Raise InvalidValueError unless `value` is at least 0 and less than 1."""
    require(0 <= value < 1, name, value, "at least 0 and less than 1")


@dataclass(frozen=True)
class LaserScanner(Checked):
    """A line scanner like the SICK LMS 200; the paper doesn't name its scanner."""

    field_of_view: float = checked(float(np.pi), require_positive)
    """Angle between the first and the last beam [rad]."""
    resolution: float = checked(float(np.radians(0.25)), require_positive)
    """Angle between adjacent beams [rad]."""
    rate: float = checked(20.0, require_positive)
    """Scans per second [Hz]."""
    noise: float = checked(0.005, require_non_negative, _MAX_ERROR, "m")
    """Standard deviation of the noise in each range [m]."""
    max_range: float = checked(20.0, require_positive, 1000.0, "m")
    """Largest distance from which surfaces return an echo [m]."""
    dropout: float = checked(0.0, require_share)
    """Probability that a beam that hits a surface returns no echo [-]."""
    quantisation: float = checked(0.0, require_non_negative, _MAX_ERROR, "m")
    """Step to whose multiples noisy ranges are rounded; 0 for no rounding [m]."""
    range_bias: float = checked(0.0, require_within, -_MAX_ERROR, _MAX_ERROR, "m")
    """Constant error in all ranges [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        rounding = self.quantisation
        is_step = rounding == 0 or rounding >= _MIN_STEP
        require(is_step, "quantisation", rounding, f"0, or at least {_MIN_STEP:g} m")
        require(self.rate >= _MIN_RATE, "rate", self.rate, f"at least {_MIN_RATE:g} Hz")
        beams = self.field_of_view / self.resolution
        allowed = f"at least field_of_view / {_MAX_BEAMS}, for at most that many beams"
        require(beams <= _MAX_BEAMS, "resolution", self.resolution, allowed)
        is_opened = self.resolution < self.field_of_view <= 2 * np.pi
        allowed = "greater than the resolution, at most 2 pi"
        require(is_opened, "field_of_view", self.field_of_view, allowed)

    def measure(
        self, true_ranges: Array, random: Sequence[np.random.Generator], noise: Array | None = None
    ) -> Array:
        """Measured ranges (N, ..., B) for true ranges (N, ..., B), NaN for no echo [m].

        Each of the N rows has its own generator in `random` and, with `noise` (N,), its own
        standard deviation [m]. Noise, bias, rounding, dropout and the largest range are applied
        only in this method.
        """
        shape = true_ranges.shape[1:]
        deviation = self.noise if noise is None else noise.reshape(-1, *np.ones(len(shape), int))
        ranges = np.stack([generator.standard_normal(shape) for generator in random])
        ranges *= deviation
        ranges += true_ranges
        ranges += self.range_bias
        if self.quantisation > 0:
            ranges = np.round(ranges / self.quantisation) * self.quantisation
        if self.dropout > 0:
            drawn = np.stack([generator.random(shape) for generator in random])
            ranges[drawn < self.dropout] = np.nan
        ranges[true_ranges > self.max_range] = np.nan
        return ranges

    def scan(self, ranges: Array, mount: Array) -> Scan:
        """Scans with measured ranges (..., B) [m] from this scanner at `mount` (3,) [m, m, rad]."""
        return Scan(self.bearings, ranges, self.range_std, mount, self.max_range, self.dropout)

    @property
    def period(self) -> float:
        """Time between scans [s]."""
        return 1 / self.rate

    @property
    def bearings(self) -> Array:
        """Directions (B,) of the beams in the LRF's frame [rad]."""
        beams = round(self.field_of_view / self.resolution) + 1
        return (np.arange(beams) - (beams - 1) / 2) * self.resolution

    @property
    def range_std(self) -> float:
        """Standard deviation of a range due to noise and rounding [m]."""
        return float(np.hypot(self.noise, self.quantisation / np.sqrt(12)))


@dataclass(frozen=True)
class Post(Checked):
    """An upright cylinder."""

    x: float = checked(MISSING, *_COORDINATE)
    """x of the centre in the world [m]."""
    y: float = checked(MISSING, *_COORDINATE)
    """y of the centre in the world [m]."""
    radius: float = checked(0.05, require_positive, _MAX_RADIUS, "m")
    """Radius of the cylinder [m]."""

    def ranges(self, origin: Array, direction: Array) -> Array:
        """Distances (...) to the post along beams; see `Obstacles.ranges`."""
        centre = np.array([self.x, self.y]) - origin
        along = np.sum(centre * direction, axis=-1)
        across = _cross(direction, centre)
        half_chord = np.sqrt(np.maximum(self.radius**2 - across**2, 0.0))
        is_beside = np.abs(across) > self.radius
        is_behind = along + half_chord < 0
        distance = np.maximum(along - half_chord, 0.0)
        return np.where(is_beside | is_behind, np.nan, distance)


@dataclass(frozen=True)
class Wall(Checked):
    """A thin straight wall."""

    x0: float = checked(MISSING, *_COORDINATE)
    """x of the first end in the world [m]."""
    y0: float = checked(MISSING, *_COORDINATE)
    """y of the first end in the world [m]."""
    x1: float = checked(MISSING, *_COORDINATE)
    """x of the second end in the world [m]."""
    y1: float = checked(MISSING, *_COORDINATE)
    """y of the second end in the world [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        end = self.x1, self.y1
        require(end != (self.x0, self.y0), "x1, y1", end, "another place than x0, y0")

    def ranges(self, origin: Array, direction: Array) -> Array:
        """Distances (...) to the wall along beams, see `Obstacles.ranges`; a beam parallel to the
        wall misses it.

        A beam meets the wall where distance * direction = start + share * side.
        """
        start = np.array([self.x0, self.y0]) - origin
        side = np.array([self.x1 - self.x0, self.y1 - self.y0])
        determinant = _cross(direction, side)
        with np.errstate(all="ignore"):  # 0 for parallel beams
            distance = _cross(start, side) / determinant
            share = _cross(start, direction) / determinant
        is_met = (distance >= 0) & (share >= 0) & (share <= 1)
        return np.where(is_met, distance, np.nan)


@dataclass(frozen=True)
class Obstacles:
    """All objects in the field, other than the plate, that beams may hit."""

    posts: tuple[Post, ...] = ()
    walls: tuple[Wall, ...] = ()

    def __post_init__(self) -> None:
        for name in ("posts", "walls"):
            require_at_most(f"number of {name}", len(getattr(self, name)), _MAX_NUMBER)

    def ranges(self, origin: Array, direction: Array) -> Array:
        """Distances (...) to the nearest obstacle, NaN if a beam hits none [m].

        The beams start at `origin` (2,) [m] along unit vectors `direction` (..., 2). Inside a post,
        the distance is 0.
        """
        nearest = np.full(direction.shape[:-1], np.nan)
        obstacles: tuple[Post | Wall, ...] = (*self.posts, *self.walls)
        for obstacle in obstacles:
            nearest = np.fmin(nearest, obstacle.ranges(origin, direction))
        return nearest

    def require_clear(self, scanner: Array) -> None:
        """Raise InvalidValueError if an obstacle covers the position `scanner` (2,) of the scanner
        [m].
        """
        angle = np.linspace(0.0, 2 * np.pi, 360)
        around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        x, y = np.round(scanner, 3) + 0.0
        allowed = f"at least {_MIN_DISTANCE:g} m away from the scanner, which is at ({x:g}, {y:g})"
        for name in ("posts", "walls"):
            for k, obstacle in enumerate(getattr(self, name)):
                is_near = obstacle.ranges(scanner, around) < _MIN_DISTANCE
                require(not is_near.any(), f"{name}[{k}]", obstacle, allowed)


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


NAMED_OBSTACLES: Final[dict[str, Obstacles]] = {
    # posts beside and behind the circles, two of them within the length of a plate from the largest
    # circle
    "posts": Obstacles(
        posts=(
            Post(2.3, 2.0),
            Post(-5.3, 4.0),
            Post(1.6, 6.0),
            Post(-1.5, 7.2, 0.15),
            Post(-3.5, -0.8),
        )
    ),
    "room": Obstacles(
        walls=(
            Wall(-6.0, -2.0, -6.0, 8.0),
            Wall(-6.0, 8.0, 3.0, 8.0),
            Wall(3.0, 8.0, 3.0, -2.0),
            Wall(3.0, -2.0, -6.0, -2.0),
        )
    ),
    # a post that hides a part of every circle
    "occluded": Obstacles(posts=(Post(-1.61, -0.71),)),
}
"""Obstacles by name, around the circles in front of the scanner that the robots of a grid drive.

The scanner is at (-1.5, -1.5), with its forward axis along +y. The circles touch each other at
(-1.5, 0) and lie beyond this point; the largest extends from x = -4.7 to 1.7 and up to y = 6.3. No
obstacle is in the way of a robot.
"""


@checks_arguments
def load_obstacles(source: str) -> Obstacles:
    """Load obstacles by name, or from a TOML file with tables `[[posts]]` and `[[walls]]`.

    Raises InvalidValueError for any other source, SettingsFileError for an unreadable file and
    invalid fields.
    """
    if source in NAMED_OBSTACLES:
        return NAMED_OBSTACLES[source]
    return build(Obstacles, read_named("obstacles", source, NAMED_OBSTACLES), source)
