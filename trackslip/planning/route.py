"""Routes: drives between nine waypoints of an area, straight or on arcs, forwards or backwards, with spins between.

The search varies routes. A route says where to go and how, not how far: its waypoints move together until the robot
stays in the area under every law that it may have. Each spin is followed by an equal one to the other side, so that
the heading after both does not depend on the law.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import SIDES, Array, wrap_angle
from trackslip.planning.limits import DriveLimits, Knowledge
from trackslip.planning.maneuvers import Maneuvers, durations, longest_spin

WAYPOINTS = np.array([(x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)])
"""Places (9, 2) in halves of the area's length and width, or of what can be driven in a larger one."""
BOWS = np.radians([-60.0, -30.0, 0.0, 30.0, 60.0])
"""Angles (5,) between the chord of a leg and its ends."""
STRAIGHT = 2
"""Index of a straight leg in BOWS."""
_FITTED = 8  # rounds in which the places move together
_SLACK = 1e-3  # relative, by which they move further than they seem to have to
_LONGEST = 0.25  # way from the middle to a place in a large area, of what can be driven in all [-]
_SMALLEST = 0.02  # scale below which there is no room
_PARTS = 8  # of each maneuver
_DEVIATIONS = 3.5  # of slip that the area allows for


@dataclass(frozen=True)
class Route:
    """Legs, repeated until the time is up, and spins."""

    start: int
    """Index of the first waypoint."""
    place: np.ndarray  # (n,) int, ends of the legs, indices into WAYPOINTS
    backwards: np.ndarray  # (n,) bool: whether a leg is driven backwards
    bow: np.ndarray  # (n,) int, indices into BOWS
    spinning: float
    """Share of the time for spins to both sides [-]."""
    pairs: int
    """Number of such pairs, spread over the route."""
    size: float = 1.0
    """Distances of the waypoints, relative to the largest useful ones [-]."""
    ends: float = 0.5
    """Length of the first and the last pair over that of the others, which are measured for two legs [-]."""
    shrink: float = 0.0
    """Relative reduction of the distance from the middle at each leg, as slip adds up [-]."""


@dataclass(frozen=True)
class PlacedRoute:
    """A route within limits."""

    maneuvers: Maneuvers
    start: Array  # (3,) where it begins, from the middle of the area [m, m, rad]
    places: Extent  # from the middle of the area


def placed(route: Route, limits: DriveLimits, knowledge: Knowledge) -> PlacedRoute | None:
    """The route, as large as the area allows; None if it doesn't fit at all."""
    scale = route.size
    for _ in range(_FITTED):
        maneuvers, heading = _maneuvers(route, scale, limits, knowledge)
        if not len(maneuvers.way):
            return None
        found = extent(maneuvers, heading, knowledge)
        over = float((found.size / limits.room).max())
        if over <= 1:
            middle = (found.low + found.high) / 2
            return PlacedRoute(
                maneuvers, np.array([*-middle, wrap_angle(heading)]), Extent(found.low - middle, found.high - middle)
            )
        scale /= over * (1 + _SLACK)
        if scale < _SMALLEST:
            return None
    return None


def _maneuvers(route: Route, scale: float, limits: DriveLimits, knowledge: Knowledge) -> tuple[Maneuvers, float]:
    """The maneuvers, with places `scale` times as far apart as they can be, and the heading at the start."""
    half = scale * np.minimum(limits.room / 2, _LONGEST * limits.max_speed * limits.duration)
    rounds = max(1, int(np.ceil(limits.duration * limits.max_speed / (len(route.place) * half.min()))))
    end = np.tile(route.place, rounds)
    begin = np.concatenate([[route.start], end[:-1]])
    moving = begin != end
    backwards, bow = (np.tile(gene, rounds)[moving] for gene in (route.backwards, BOWS[route.bow]))
    size = (1 - route.shrink) ** np.arange(len(end) + 1)[:, None]
    chord = (size[1:] * WAYPOINTS[end] - size[:-1] * WAYPOINTS[begin])[moving] * half
    if not len(chord):
        return Maneuvers.of(np.zeros((0, 2)), limits), 0.0
    heading = np.arctan2(chord[:, 1], chord[:, 0]) - bow + np.pi * backwards
    turn = wrap_angle(heading - np.concatenate([heading[:1], heading[:-1] + 2 * bow[:-1]]))
    length = np.hypot(*chord.T) / np.sinc(bow / np.pi) * np.where(backwards, -1.0, 1.0)
    legs = np.stack([_ways(0 * turn, turn, knowledge), _ways(length, 2 * bow, knowledge)], axis=1)
    return _timed(legs, route, limits), float(heading[0])


def _timed(legs: Array, route: Route, limits: DriveLimits) -> Maneuvers:
    """As many of the legs (n, 2, 2), each a spin and a maneuver, as there is time for, and pairs of spins between."""
    for_legs = limits.duration * (1 - route.spinning)
    times = durations(legs.reshape(-1, 2), limits).reshape(-1, 2).sum(axis=1)
    count = int(np.searchsorted(np.cumsum(times), for_legs + 1e-9))
    share = np.ones(route.pairs + 1)
    share[[0, -1]] = route.ends if route.pairs > 1 else 1.0
    share /= share.sum()
    rest = limits.duration - times[:count].sum()
    spins = [longest_spin(rest * part / 2, limits) * np.outer([1.0, -1.0], SIDES) for part in share]
    before = np.linspace(0, count, route.pairs + 1).astype(int)
    parts = np.split(legs[:count].reshape(-1, 2), 2 * before[1:])
    turned = [(1 - 2 * (k % 2)) * spin for k, spin in enumerate(spins)]
    return Maneuvers.of(np.concatenate([one for both in zip(turned, parts, strict=True) for one in both]), limits)


def _ways(length: Array, turn: Array, knowledge: Knowledge) -> Array:
    """Ways (n, 2) of the belts for lengths (n,) [m] and turns (n,) [rad] of the robot."""
    real = length[:, None] + SIDES * knowledge.reach * turn[:, None]
    return np.asarray(real / (1 + knowledge.radius_error))


@dataclass(frozen=True)
class Extent:
    """The rectangle that the middle of the robot stays in."""

    low: Array  # (2,) [m]
    high: Array  # (2,) [m]

    @property
    def size(self) -> Array:
        """Length and width (2,) [m]."""
        return np.asarray(self.high - self.low)


def extent(maneuvers: Maneuvers, heading: float, knowledge: Knowledge) -> Extent:
    """Extent of the motion of the robot's middle from the origin, with `heading` [rad] at the start."""
    x, y = path(maneuvers, heading, knowledge.extremes)
    spread = _DEVIATIONS * _slipped(maneuvers, x, y, knowledge)  # (2, L, K)
    both = np.stack([x, y])
    return Extent((both - spread).min(axis=(1, 2)), (both + spread).max(axis=(1, 2)))


def path(maneuvers: Maneuvers, heading: float, laws: Array) -> tuple[Array, Array]:
    """Positions x, y (L, K) of the turning centre by laws (L, 3) of b + D [m] and 1 + epsilon of left and right."""
    way = np.repeat(maneuvers.way, _PARTS, axis=0) / _PARTS * laws[:, None, 1:]  # (L, M, 2)
    turn = (way[..., 1] - way[..., 0]) / (2 * laws[:, :1])
    after = heading + np.cumsum(turn, axis=1)
    chord = way.mean(axis=-1) * np.sinc(turn / (2 * np.pi))
    step = chord * np.exp(1j * (after - turn / 2))
    at = np.concatenate([np.zeros((len(laws), 1)), np.cumsum(step, axis=1)], axis=1)
    return at.real, at.imag


def _slipped(maneuvers: Maneuvers, x: Array, y: Array, knowledge: Knowledge) -> Array:
    """Standard deviations (2, L, K) of the positions by white slip."""
    along, across, turning = knowledge.slip
    part = np.repeat(np.abs(maneuvers.way).mean(axis=1), _PARTS) / _PARTS
    driven = np.concatenate([[0.0], np.cumsum(part)])

    def swung(lever: Array) -> Array:
        """Sum of the squares of levers from all parts before, times their ways."""
        middle = (lever[:, 1:] + lever[:, :-1]) / 2
        first = np.concatenate([np.zeros((len(lever), 1)), np.cumsum(middle * part, axis=1)], axis=1)
        second = np.concatenate([np.zeros((len(lever), 1)), np.cumsum(middle**2 * part, axis=1)], axis=1)
        return np.maximum(lever**2 * driven - 2 * lever * first + second, 0.0)

    moved = max(along, across) ** 2 * driven
    return np.sqrt(np.stack([moved + turning**2 * swung(y), moved + turning**2 * swung(x)]))
