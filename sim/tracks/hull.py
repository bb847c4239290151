"""Hulls of tracks, seen from the right: wheels in a convex chain, and the belt around them.

Coordinates are (x, z), forwards and up. When the robot drives forwards, the belt circulates
clockwise: backwards below, forwards above.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trackslip.errors import require

_MAX_SIZE = 10.0  # largest magnitude of any number in a hull [m]
_MIN_RADIUS = 1e-3  # [m]
_MAX_WHEELS = 100
Array = NDArray[np.float64]


@dataclass(frozen=True)
class BeltSpan:
    """A straight piece of belt between two wheels."""

    start: Array  # (2,) point where the belt leaves one wheel [m]
    end: Array  # (2,) point where the belt meets the next wheel [m]
    radius: float  # radius of the smaller of the two wheels [m]

    @property
    def length(self) -> float:
        """Length of the span [m]."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def along(self) -> Array:
        """Unit vector (2,) in which the belt moves when the robot drives forwards."""
        return (self.end - self.start) / self.length

    @property
    def outwards(self) -> Array:
        """Unit normal (2,) that points away from the hull."""
        x, z = self.along
        return np.array([-z, x])


@dataclass(frozen=True)
class Hull:
    """Wheels that bend the belt, in clockwise order, and the runs between them; run i starts at
    wheel i.
    """

    wheels: Array  # (W, 3) x, z, radius [m]
    runs: tuple[BeltSpan, ...]

    @property
    def longest_below(self) -> float:
        """Length of the longest run that faces the ground, or of the longest run if none faces it
        [m].
        """
        return max((run.outwards[1] < 0, run.length) for run in self.runs)[1]

    @property
    def headings(self) -> Array:
        """Directions (W,) of the belt on its runs, measured from x towards z [rad]."""
        return np.array([np.arctan2(*run.along[::-1]) for run in self.runs])

    @property
    def ends(self) -> Array:
        """Distances (2 W,) along the belt to the end of each run and of the arc after it [m]."""
        # clockwise, on the next wheel
        bend = np.mod(self.headings - np.roll(self.headings, -1), 2 * np.pi)
        arc = bend * np.roll(self.wheels[:, 2], -1)
        return np.cumsum(np.column_stack([[run.length for run in self.runs], arc]).ravel())

    def place(self, distance: Array) -> tuple[Array, Array]:
        """Points (..., 2) [m] and directions (...) [rad] of the belt at a `distance` (...) along
        the belt [m].
        """
        ends = self.ends
        along = np.mod(distance, ends[-1])

        # runs have even numbers, and the arcs after them odd ones
        piece = np.minimum(np.searchsorted(ends, along, side="right"), len(ends) - 1)
        run = piece // 2
        is_on_wheel = piece % 2 == 1
        from_start = along - np.append(0.0, ends)[piece]

        # the wheel at the run's end, around which the arc bends
        x, z, radius = np.moveaxis(np.roll(self.wheels, -1, axis=0)[run], -1, 0)
        heading = self.headings[run] - np.where(is_on_wheel, from_start / radius, 0.0)
        ahead = np.cos(heading)
        up = np.sin(heading)
        start = np.array([each.start for each in self.runs])[run]
        straight = start + from_start[..., None] * np.stack([ahead, up], axis=-1)
        bent = np.stack([x - radius * up, z + radius * ahead], axis=-1)
        return np.where(is_on_wheel[..., None], bent, straight), heading

    @classmethod
    def from_wheels(cls, wheels: Sequence[Sequence[float]]) -> Hull:
        """The convex hull of wheels (x, z, radius) in any order [m].

        Wheels that don't bend the belt are omitted.

        Raises:
                InvalidValueError: for fewer than two wheels, numbers out of range, and wheels that
                    all lie inside one.
        """
        chain = wheel_numbers(wheels)
        allowed = (
            f"finite, with radii of at least {_MIN_RADIUS:g} m and nothing beyond {_MAX_SIZE:g} m"
        )
        is_finite = bool(np.isfinite(chain).all())
        is_small = is_finite and np.abs(chain).max() <= _MAX_SIZE
        fits = is_small and chain[:, 2].min() >= _MIN_RADIUS
        require(fits, "hull", chain.tolist(), allowed)
        outer = _outermost(chain)
        require(
            len(outer) > 1,
            "hull",
            chain.tolist(),
            "two wheels or more that don't lie inside one another",
        )
        normals = _tangents(outer)
        following = np.roll(outer, -1, axis=0)
        starts = outer[:, :2] + outer[:, 2:] * normals
        ends = following[:, :2] + following[:, 2:] * normals
        radii = np.minimum(outer[:, 2], following[:, 2])
        spans = zip(starts, ends, radii.tolist(), strict=True)
        return cls(outer, tuple(BeltSpan(start, end, radius) for start, end, radius in spans))


def wheel_numbers(wheels: Sequence[Sequence[float]], least: int = 2) -> Array:
    """The numbers (W, 3) of at least so many wheels; raises InvalidValueError for other values."""
    try:
        listed = [[float(number) for number in wheel] for wheel in wheels]
    except (TypeError, ValueError):
        listed = [[]]
    whole = all(len(wheel) == 3 for wheel in listed)
    require(whole, "hull", wheels, "wheels of three numbers each, (x, z, radius) [m]")
    allowed = f"from {least} to {_MAX_WHEELS} wheels (x, z, radius)"
    require(least <= len(listed) <= _MAX_WHEELS, "hull", listed, allowed)
    return np.array(listed)


def _outermost(wheels: Array) -> Array:
    """The wheels (W', 3) that a belt around all `wheels` touches, clockwise from the first of them
    in `wheels`.

    In each of many directions, the wheel that reaches furthest touches the belt. Wheels that bend
    the belt by less than 0.1° may be missing.
    """
    # the offset avoids ties between wheels in a row
    angle = np.linspace(2 * np.pi, 0, 3600, endpoint=False) + 1e-4
    ahead = np.cos(angle)[:, None] * wheels[:, 0]
    up = np.sin(angle)[:, None] * wheels[:, 1]
    reach = ahead + up + wheels[:, 2]
    touching = reach.argmax(axis=1)

    # once for each wheel, in the order of the directions
    order = touching[touching != np.roll(touching, 1)]
    if not order.size:
        return wheels[touching[:1]]
    first = int(order.argmin())
    return wheels[np.roll(order, -first)]


def _tangents(chain: Array) -> Array:
    """Outward normals (W, 2) of the outer tangents from each wheel to the next one, with the hull
    on their right.
    """
    step = np.roll(chain, -1, axis=0) - chain
    distance = np.hypot(step[:, 0], step[:, 1])
    ahead = step[:, :2] / distance[:, None]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    lean = -step[:, 2:] / distance[:, None]
    normals: Array = lean * ahead + np.sqrt(1 - lean**2) * left
    return normals
