"""Routes: drives back and forth between two of nine places in an area, with spins in between.

Routes consist of maneuvers from rest to rest, in which the ratio of the belt speeds is constant.

The search varies routes. A route fixes directions and manner of driving, but not distances: its
places are moved closer together until the robot stays in the area under every possible law. Each
spin is followed by an equal spin to the other side, so the heading after both does not depend on
the law.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from trackslip.kinematics import SIDES, Array, wrap_angle
from trackslip.planning.limits import DriveLimits, Knowledge

RATE = 50.0  # commands per second; maneuvers last whole command periods [Hz]
TURNING = 0.65
"""Largest yaw rate as a fraction of that in the fastest spin [-]. The ICRs of real tracks move
outwards with the yaw rate, so faster spins would identify a law for unusual driving.
"""
_LEAST = 1e-9  # length above which a maneuver is driven [m]
WAYPOINTS = np.array([(x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)])
"""Places (9, 2), in half lengths and half widths of the area, or in the longest useful distances if
shorter.
"""
BOW = np.radians(30.0)
"""Unit of the angle between a leg's chord and its ends, from -MOST_BOW to MOST_BOW units [rad]."""
MOST_BOW = 2
_FITTED = 8  # maximum number of times that places are moved closer together
_SLACK = 1e-3  # relative margin by which places are moved closer together than seems necessary
# largest distance of a place from the centre, relative to the longest drivable distance [-]
_LONGEST = 0.25
_SMALLEST = 0.02  # smallest scale of a route that is driven [-]
_PARTS = 8  # number of parts into which a maneuver is divided for its path
_DEVIATIONS = 3.5  # standard deviations of slip for which the area leaves room
_POPULATION = 40
# shares and pairs of spins in a search's initial lines
_SHARES, _PAIRS = (0.25, 0.35, 0.45, 0.55), (2, 3, 4, 6)
_LAST = len(WAYPOINTS) - 1
# lower bounds on the fields of a Route
_LOW = np.array([0, 0, 0, 0, -MOST_BOW, -MOST_BOW, 0.02, 1, 0.2, 0.0, 0.0])
_HIGH = np.array([_LAST, _LAST, 1, 1, MOST_BOW, MOST_BOW, 0.6, 12, 1.0, 1.0, 0.05])
_WHOLE = np.array([True] * 6 + [False, True, False, False, False])  # fields that are whole numbers


@dataclass(frozen=True)
class Route:
    """Two legs, out and back, repeated until the time is up, with spins in between."""

    start: int  # index of the first place in WAYPOINTS
    end: int  # index of the second place
    backwards: tuple[bool, bool]  # whether the legs out and back are driven in reverse
    bow: tuple[int, int]  # angle between the chord and the ends of each leg, in units of BOW
    spinning: float  # fraction of the time for pairs of spins, which turn to both sides [-]
    pairs: int  # number of pairs of spins, spread over the route
    size: float = 1.0  # distances between the places, relative to the largest useful distances [-]
    ends: float = 0.5
    """Length of the first and last pair of spins relative to the other pairs, each of which serves
    two legs [-].
    """
    # relative reduction of the distance from the centre at each leg, as slip adds up [-]
    shrink: float = 0.0


@dataclass(frozen=True)
class PlacedRoute:
    """A route placed in the area, driven within the limits."""

    maneuvers: Maneuvers
    start: Array  # (3,) first pose, relative to the centre of the area [m, m, rad]
    # (2, 2) lowest and highest x and y of the robot's centre, relative to the area's centre [m]
    places: Array


@dataclass(frozen=True)
class Maneuvers:
    """A sequence of maneuvers: the distances that the belts drive, and the durations within the
    limits.
    """

    way: Array  # (n, 2) distances driven by the left and right belts, negative backwards [m]
    duration: Array  # (n,) durations, in whole command periods [s]
    acceleration: float  # acceleration of the faster belt [m/s^2]

    @classmethod
    def of(cls, way: Array, limits: DriveLimits) -> Maneuvers:
        """Return the fastest maneuvers within the limits that drive `way` (n, 2) [m], without
        maneuvers of length 0.
        """
        way = way[np.abs(way).max(axis=1, initial=0.0) > _LEAST]
        return cls(way, durations(way, limits), limits.acceleration)

    def speeds(self, duration: float) -> Array:
        """Mean belt speeds (T, 2) [m/s] in each command period until `duration` [s]; 0 after the
        last maneuver.

        Means over periods satisfy the limits on speed and acceleration if the speeds themselves do.
        """
        edges = np.arange(round(duration * RATE) + 1) / RATE
        begin = np.concatenate([[0.0], np.cumsum(self.duration)])
        k = np.clip(np.searchsorted(begin, edges + 1e-9, side="right") - 1, 0, len(self.way) - 1)
        into = np.clip(edges - begin[k], 0.0, self.duration[k])
        length = np.abs(self.way).max(axis=1)
        share = (self._driven(into, k) / length[k])[:, None]
        before = np.concatenate([np.zeros((1, 2)), np.cumsum(self.way, axis=0)])
        return np.asarray(np.diff(before[k] + share * self.way[k], axis=0) * RATE)

    def _driven(self, into: Array, k: np.ndarray) -> Array:
        """Distances (T,) [m] of the faster belt at times `into` (T,) [s] since the start of
        maneuvers `k` (T,).
        """
        a, whole, length = self.acceleration, self.duration[k], np.abs(self.way).max(axis=1)[k]
        peak = (a * whole - np.sqrt(np.maximum((a * whole) ** 2 - 4 * a * length, 0.0))) / 2
        ramp = peak / a
        rest = whole - into
        middle = peak * (into - ramp / 2)
        return np.where(
            into < ramp, a * into**2 / 2, np.where(rest < ramp, length - a * rest**2 / 2, middle)
        )


def durations(way: Array, limits: DriveLimits) -> Array:
    """Shortest durations (n,) [s], in whole periods, of maneuvers from rest to rest that drive
    `way` (n, 2) [m].
    """
    length = np.abs(way).max(axis=1)
    turn = np.abs(way[:, 1] - way[:, 0])
    v = limits.max_speed * np.minimum(
        1.0, 2 * TURNING * np.maximum(length, _LEAST) / np.maximum(turn, _LEAST)
    )
    a = limits.acceleration
    shortest = np.where(length >= v**2 / a, length / v + v / a, 2 * np.sqrt(length / a))
    return np.asarray(np.ceil(shortest * RATE - 1e-9) / RATE)


def longest_spin(duration: float, limits: DriveLimits) -> float:
    """Longest distance [m] that each belt drives in a spin of `duration` [s], rounded down to whole
    periods.
    """
    whole = np.floor(max(duration, 0.0) * RATE + 1e-9) / RATE
    v, a = TURNING * limits.max_speed, limits.acceleration
    return float(v * (whole - v / a) if whole >= 2 * v / a else a * whole**2 / 4)


def placed(route: Route, limits: DriveLimits, knowledge: Knowledge) -> PlacedRoute | None:
    """Scale a route to the size that the area allows. None if it doesn't fit or has no length."""
    scale = route.size
    for _ in range(_FITTED):
        if route.start == route.end or scale < _SMALLEST:
            return None
        maneuvers, heading = _maneuvers(route, scale, limits, knowledge)
        reached = extent(maneuvers, heading, knowledge)
        over = float((np.ptp(reached, axis=0) / limits.room).max())
        if over <= 1:
            middle = reached.mean(axis=0)
            return PlacedRoute(
                maneuvers, np.array([*-middle, wrap_angle(heading)]), reached - middle
            )
        scale /= over * (1 + _SLACK)
    return None


def _maneuvers(
    route: Route, scale: float, limits: DriveLimits, knowledge: Knowledge
) -> tuple[Maneuvers, float]:
    """Maneuvers of a route with places `scale` times as far apart as possible, and the initial
    heading [rad].
    """
    half = scale * np.minimum(limits.room / 2, _LONGEST * limits.max_speed * limits.duration)
    rounds = max(1, int(np.ceil(limits.duration * limits.max_speed / (2 * half.min()))))
    place = WAYPOINTS[[*[route.start, route.end] * rounds, route.start]]
    backwards, bow = np.tile(route.backwards, rounds), BOW * np.tile(route.bow, rounds)
    size = (1 - route.shrink) ** np.arange(len(place))[:, None]
    chord = np.diff(size * place, axis=0) * half
    heading = np.arctan2(chord[:, 1], chord[:, 0]) - bow + np.pi * backwards
    turn = wrap_angle(heading - np.concatenate([heading[:1], heading[:-1] + 2 * bow[:-1]]))
    length = np.hypot(*chord.T) / np.sinc(bow / np.pi) * np.where(backwards, -1.0, 1.0)
    legs = np.stack([_ways(0 * turn, turn, knowledge), _ways(length, 2 * bow, knowledge)], axis=1)
    return _timed(legs, route, limits), float(heading[0])


def _timed(legs: Array, route: Route, limits: DriveLimits) -> Maneuvers:
    """Maneuvers for as many legs (n, 2, 2), each with its spin, as time allows, with pairs of spins
    in between.
    """
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
    return Maneuvers.of(
        np.concatenate([part for pair in zip(turned, parts, strict=True) for part in pair]), limits
    )


def _ways(length: Array, turn: Array, knowledge: Knowledge) -> Array:
    """Distances (n, 2) [m] driven by the belts for path lengths (n,) [m] and turns (n,) [rad] of
    the robot.
    """
    real = length[:, None] + SIDES * knowledge.reach * turn[:, None]
    return np.asarray(real / (1 + knowledge.radius_error))


def extent(maneuvers: Maneuvers, heading: float, knowledge: Knowledge) -> Array:
    """Lowest and highest x and y (2, 2) [m] of the robot's centre if it starts at the origin with
    `heading` [rad].
    """
    places = np.stack(path(maneuvers, heading, knowledge.extremes))
    spread = _DEVIATIONS * _slipped(maneuvers, places, knowledge)
    return np.stack([(places - spread).min(axis=(1, 2)), (places + spread).max(axis=(1, 2))])


def path(maneuvers: Maneuvers, heading: float, laws: Array) -> tuple[Array, Array]:
    """Positions x, y (L, K) [m] of the turning centre under laws (L, 3): b + D [m], and 1 + epsilon
    left and right.
    """
    way = np.repeat(maneuvers.way, _PARTS, axis=0) / _PARTS * laws[:, None, 1:]  # (L, M, 2)
    turn = (way[..., 1] - way[..., 0]) / (2 * laws[:, :1])
    after = heading + np.cumsum(turn, axis=1)
    chord = way.mean(axis=-1) * np.sinc(turn / (2 * np.pi))
    step = chord * np.exp(1j * (after - turn / 2))
    at = np.concatenate([np.zeros((len(laws), 1)), np.cumsum(step, axis=1)], axis=1)
    return at.real, at.imag


def _slipped(maneuvers: Maneuvers, places: Array, knowledge: Knowledge) -> Array:
    """Standard deviations (2, L, K) [m] of `places` (2, L, K) due to white slip."""
    along, across, turning = knowledge.slip
    part = np.repeat(np.abs(maneuvers.way).mean(axis=1), _PARTS) / _PARTS
    driven = np.append(0.0, np.cumsum(part))
    lever = places[::-1]  # a turn changes x in proportion to y, and y in proportion to x
    middle = (lever[..., 1:] + lever[..., :-1]) / 2
    first, second = (np.zeros(lever.shape) for _ in range(2))
    np.cumsum(middle * part, axis=-1, out=first[..., 1:])
    np.cumsum(middle**2 * part, axis=-1, out=second[..., 1:])
    # sum of squared levers of all parts so far
    swung = np.maximum(lever**2 * driven - 2 * lever * first + second, 0.0)
    return np.sqrt(max(along, across) ** 2 * driven + turning**2 * swung)


def best_route(
    cost: Callable[[Route], float], evaluations: int, rng: np.random.Generator
) -> tuple[Route, float]:
    """Find the best of about `evaluations` routes, and its cost, by differential evolution (Storn
    and Price, 1997).

    The search begins with straight lines along the diagonal, with various shares of spins, and with
    random routes.
    """
    first = rng.uniform(_LOW, _HIGH, (_POPULATION, len(_LOW)))
    lines = [
        (0, _LAST, 0, 1, 0, 0, share, pairs, 1.0, 0.5, 0.01)
        for share in _SHARES
        for pairs in _PAIRS
    ]
    first[: len(lines)] = lines
    first = np.where(_WHOLE, np.round(first), first)
    found = scipy.optimize.differential_evolution(
        lambda genes: cost(_route(genes)),
        np.column_stack([_LOW, _HIGH]),
        integrality=_WHOLE,
        init=first,
        maxiter=max(0, evaluations // _POPULATION - 1),
        polish=False,
        tol=0.0,
        rng=rng,
    )
    return _route(found.x), float(found.fun)


def _route(genes: Array) -> Route:
    start, end, *legs, spinning, pairs, size, ends, shrink = genes.tolist()
    backwards, bow = (bool(legs[0]), bool(legs[1])), (int(legs[2]), int(legs[3]))
    return Route(int(start), int(end), backwards, bow, spinning, int(pairs), size, ends, shrink)
