"""Routes: drives back and forth between two of nine places in an area, with spins in between.

Routes consist of maneuvers from rest to rest, in which the ratio of the belt speeds is constant. A
leg is a turn on the spot, to the heading at which the leg starts, and an arc to the other place.
Pairs of spins are driven before the first leg, between legs and after the last one, to determine
how the robot turns. Both spins of a pair are equal, to either side, so the heading after them does
not depend on the law.

The search varies routes. A route fixes directions and manner of driving, but not distances: its
places are moved closer together until the robot stays in the area under every possible law.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.optimize

from trackslip.kinematics import TRACK_SIGNS, Array, wrap_angle
from trackslip.planning.limits import DriveLimits, Knowledge

RATE: Final = 50.0  # commands per second; maneuvers last whole command periods [Hz]
YAW_RATE_SHARE: Final = 0.65
"""Largest yaw rate as a fraction of that in the fastest spin [-].

The ICRs of real tracks move outwards with the yaw rate, so faster spins would identify a law for
unusual driving.
"""
WAYPOINTS: Final = np.array([(x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)])
"""Places (9, 2), in half lengths and widths of the area, or in longest useful distances."""
LAST_WAYPOINT: Final = len(WAYPOINTS) - 1
"""Index in WAYPOINTS of the corner opposite to the first place."""
BOW: Final = np.radians(30.0)
"""Unit of the angle between a leg's chord and its ends [rad]."""
MAX_BOW: Final = 2
"""Largest angle between a leg's chord and its ends, in units of BOW."""

_MIN_LENGTH: Final = 1e-9  # length above which a maneuver is driven [m]
_TIME_ROUNDING: Final = 1e-9  # rounding error of a time, in s or in periods, that doesn't count
_MAX_REDUCTIONS: Final = 8  # maximum number of times that places are moved closer together
_REDUCTION_MARGIN: Final = 1e-3
"""Relative margin by which places are moved closer together than seems necessary [-]."""
_MAX_DISTANCE_SHARE: Final = 0.25
"""Largest distance of a place from the centre, relative to the longest drivable distance [-]."""
_MIN_SCALE: Final = 0.02  # smallest scale of a route that is driven [-]
_PATH_PARTS: Final = 8  # number of parts into which a maneuver is divided for its path
_SLIP_DEVIATIONS: Final = 3.5  # standard deviations of slip for which the area leaves room
_POPULATION: Final = 40  # number of routes in each generation of a search
_FIRST_SPINNING: Final = (0.25, 0.35, 0.45, 0.55)  # shares of spins in a search's first routes [-]
_FIRST_STRETCHES: Final = (2, 3, 4, 6)  # stretches of legs in a search's first routes
_FIRST_SHRINK: Final = 0.01  # `Route.shrink` in a search's first routes [-]


@dataclass(frozen=True)
class Gene:
    """A number in a route that the search varies."""

    name: str
    low: float  # smallest value
    high: float  # largest value
    whole: bool  # whether only whole numbers are allowed


GENES: Final = (
    Gene("start", 0, LAST_WAYPOINT, whole=True),
    Gene("end", 0, LAST_WAYPOINT, whole=True),
    Gene("backwards_out", 0, 1, whole=True),
    Gene("backwards_back", 0, 1, whole=True),
    Gene("bow_out", -MAX_BOW, MAX_BOW, whole=True),
    Gene("bow_back", -MAX_BOW, MAX_BOW, whole=True),
    Gene("spinning", 0.02, 0.6, whole=False),
    Gene("stretches", 1, 12, whole=True),
    Gene("size", 0.2, 1.0, whole=False),
    Gene("ends", 0.0, 1.0, whole=False),
    Gene("shrink", 0.0, 0.05, whole=False),
)
"""The numbers that make a Route, with their bounds; `_out` and `_back` are its two legs."""


@dataclass(frozen=True)
class Route:
    """Two legs, out and back, repeated until the time is up, with spins in between."""

    start: int  # index of the first place in WAYPOINTS
    end: int  # index of the second place
    backwards: tuple[bool, bool]  # whether the legs out and back are driven in reverse
    bow: tuple[int, int]  # angle between the chord and the ends of each leg, in units of BOW
    spinning: float  # fraction of the time for pairs of spins, which turn to both sides [-]
    # number of stretches of legs; a pair of spins is driven before the first, between and after
    # the last, so there is one pair more
    stretches: int
    size: float = 1.0  # distances between the places, relative to the largest useful distances [-]
    ends: float = 0.5
    """Length of the first and last pair of spins relative to others, which serve two stretches
    [-].
    """
    # relative reduction of the distance from the centre at each leg, as slip adds up [-]
    shrink: float = 0.0

    @classmethod
    def of(cls, genes: Array) -> Route:
        """The route made by the values (11,) of GENES."""
        value = dict(zip((gene.name for gene in GENES), genes.tolist(), strict=True))
        return cls(
            start=int(value["start"]),
            end=int(value["end"]),
            backwards=(bool(value["backwards_out"]), bool(value["backwards_back"])),
            bow=(int(value["bow_out"]), int(value["bow_back"])),
            spinning=value["spinning"],
            stretches=int(value["stretches"]),
            size=value["size"],
            ends=value["ends"],
            shrink=value["shrink"],
        )

    @property
    def genes(self) -> Array:
        """Values (11,) of GENES that make the route."""
        value = vars(self) | {
            "backwards_out": self.backwards[0],
            "backwards_back": self.backwards[1],
            "bow_out": self.bow[0],
            "bow_back": self.bow[1],
        }
        return np.array([float(value[gene.name]) for gene in GENES])


@dataclass(frozen=True)
class PlacedRoute:
    """A route placed in the area, driven within the limits."""

    maneuvers: Maneuvers
    start: Array  # (3,) first pose, relative to the centre of the area [m, m, rad]
    # (2, 2) lowest and highest x and y of the robot's centre, relative to the area's centre [m]
    places: Array


@dataclass(frozen=True)
class Maneuvers:
    """A sequence of maneuvers: distances that the belts drive, and durations within the limits."""

    distance: Array  # (n, 2) distances driven by the left and right belts, negative backwards [m]
    duration: Array  # (n,) durations, in whole command periods [s]
    acceleration: float  # acceleration of the faster belt [m/s^2]

    @classmethod
    def of(cls, distance: Array, limits: DriveLimits) -> Maneuvers:
        """Return the fastest maneuvers within the limits that drive `distance` (n, 2) [m].

        Maneuvers of length 0 are left out.
        """
        length = np.abs(distance).max(axis=1, initial=0.0)
        distance = distance[length > _MIN_LENGTH]
        return cls(distance, durations(distance, limits), limits.acceleration)

    def speeds(self, duration: float) -> Array:
        """Mean belt speeds (T, 2) [m/s] in each command period until `duration` [s]; 0 afterwards.

        Means over periods satisfy the limits on speed and acceleration if the speeds themselves do.
        """
        edges = np.arange(round(duration * RATE) + 1) / RATE
        start_time = np.concatenate([[0.0], np.cumsum(self.duration)])
        start_distance = np.concatenate([np.zeros((1, 2)), np.cumsum(self.distance, axis=0)])

        # the maneuver at each edge, and the time since its start
        k = np.searchsorted(start_time, edges + _TIME_ROUNDING, side="right") - 1
        k = np.clip(k, 0, len(self.distance) - 1)
        elapsed = np.clip(edges - start_time[k], 0.0, self.duration[k])

        length = np.abs(self.distance).max(axis=1)
        share = self._driven(elapsed, k) / length[k]
        driven = start_distance[k] + share[:, None] * self.distance[k]
        return np.asarray(np.diff(driven, axis=0) * RATE)

    def _driven(self, elapsed: Array, k: np.ndarray) -> Array:
        """Distances (T,) [m] of the faster belt, `elapsed` (T,) [s] after maneuvers k (T,) start.

        Its speed rises with the acceleration a to a peak p, stays there, and falls to 0 at the time
        T. It drives the length L, so p (T - p / a) = L, and

            p = (a T - sqrt((a T)^2 - 4 a L)) / 2
        """
        a = self.acceleration
        duration = self.duration[k]
        length = np.abs(self.distance).max(axis=1)[k]
        root = np.sqrt(np.maximum((a * duration) ** 2 - 4 * a * length, 0.0))
        peak = (a * duration - root) / 2
        ramp = peak / a  # duration of the rise, and of the fall
        remaining = duration - elapsed

        rising = a * elapsed**2 / 2
        steady = peak * (elapsed - ramp / 2)
        falling = length - a * remaining**2 / 2
        return np.where(elapsed < ramp, rising, np.where(remaining < ramp, falling, steady))


def durations(distance: Array, limits: DriveLimits) -> Array:
    """Shortest durations (n,) [s], in whole periods, of maneuvers that drive `distance` (n, 2) [m].

    The faster belt drives the length L from rest to rest at most at the acceleration a and the
    speed v, in L / v + v / a, or in 2 sqrt(L / a) if it doesn't reach v. In the fastest spin the
    belts' speeds differ by twice the maximum speed, so the limit on the yaw rate is also one on the
    speed: v |difference of the distances| / L <= YAW_RATE_SHARE 2 max_speed.
    """
    length = np.abs(distance).max(axis=1)
    difference = np.abs(distance[:, 1] - distance[:, 0])
    # not 0, as the difference is on a straight line; shorter maneuvers are not driven
    safe_length = np.maximum(length, _MIN_LENGTH)
    safe_difference = np.maximum(difference, _MIN_LENGTH)
    by_yaw_rate = 2 * YAW_RATE_SHARE * safe_length / safe_difference
    v = limits.max_speed * np.minimum(1.0, by_yaw_rate)
    a = limits.acceleration
    reaches_v = length >= v**2 / a
    shortest = np.where(reaches_v, length / v + v / a, 2 * np.sqrt(length / a))
    return _whole_periods(shortest)


def _whole_periods(time: Array) -> Array:
    """Times (n,) [s] rounded up to whole command periods."""
    return np.asarray(np.ceil(time * RATE - _TIME_ROUNDING) / RATE)


def longest_spin(duration: float, limits: DriveLimits) -> float:
    """Longest distance [m] of each belt in a spin of `duration` [s], cut to whole periods.

    It is v (T - v / a) for the time T at the speed v and the acceleration a, or a T^2 / 4 if the
    time is too short to reach v.
    """
    periods = math.floor(max(duration, 0.0) * RATE + _TIME_ROUNDING)
    time = periods / RATE
    v = YAW_RATE_SHARE * limits.max_speed
    a = limits.acceleration
    if time >= 2 * v / a:
        return v * (time - v / a)
    return a * time**2 / 4


def placed(route: Route, limits: DriveLimits, knowledge: Knowledge) -> PlacedRoute | None:
    """Scale a route to the size that the area allows. None if it doesn't fit or has no length.

    The places are moved closer together until the robot's extent, under every expected law and with
    slip, is as long and wide as the area. The middle of the extent is put in the area's centre.
    """
    scale = route.size
    for _ in range(_MAX_REDUCTIONS):
        if route.start == route.end or scale < _MIN_SCALE:
            return None
        maneuvers, heading = _maneuvers(route, scale, limits, knowledge)
        reached = extent(maneuvers, heading, knowledge)
        excess = float((np.ptp(reached, axis=0) / limits.room).max())
        if excess <= 1:
            middle = reached.mean(axis=0)
            start = np.array([*-middle, wrap_angle(heading)])
            return PlacedRoute(maneuvers, start, reached - middle)
        scale /= excess * (1 + _REDUCTION_MARGIN)
    return None


def _maneuvers(
    route: Route, scale: float, limits: DriveLimits, knowledge: Knowledge
) -> tuple[Maneuvers, float]:
    """Maneuvers of a route of relative size `scale`, and the initial heading [rad].

    A leg is an arc that turns by 2 beta, where beta is its bow: the robot starts at the angle
    -beta to the chord and arrives at the angle beta. The arc is longer than its chord by the factor
    beta / sin(beta). Before it, the robot turns on the spot to the heading at which it starts. The
    belts are driven as the expected law says.
    """
    # x and y of places with the coordinates 1
    longest = _MAX_DISTANCE_SHARE * limits.max_speed * limits.duration
    unit = scale * np.minimum(limits.room / 2, longest)

    # the places in turn, for at least as many legs as there is time for: at top speed, a round out
    # and back takes at least twice the shorter unit
    rounds = math.ceil(limits.duration * limits.max_speed / (2 * unit.min()))
    rounds = max(1, rounds)
    indices = [route.start, route.end] * rounds + [route.start]
    shrinkage = (1 - route.shrink) ** np.arange(len(indices))
    places = shrinkage[:, None] * WAYPOINTS[indices]

    # the legs
    chord = np.diff(places, axis=0) * unit
    chord_length = np.hypot(chord[:, 0], chord[:, 1])
    backwards = np.tile(route.backwards, rounds)
    bow = BOW * np.tile(route.bow, rounds)
    sine_ratio = np.sinc(bow / np.pi)  # sin(bow) / bow
    length = chord_length / sine_ratio * np.where(backwards, -1.0, 1.0)

    # the turns on the spot before them
    heading = np.arctan2(chord[:, 1], chord[:, 0]) - bow + np.pi * backwards
    arrival = heading + 2 * bow
    heading_before = np.concatenate([heading[:1], arrival[:-1]])
    turn = wrap_angle(heading - heading_before)

    turns = _belt_distances(np.zeros_like(turn), turn, knowledge)
    arcs = _belt_distances(length, 2 * bow, knowledge)
    legs = np.stack([turns, arcs], axis=1)
    return _timed(legs, route, limits), float(heading[0])


def _timed(legs: Array, route: Route, limits: DriveLimits) -> Maneuvers:
    """Pairs of spins, and as many `legs` (n, 2, 2), each a turn and an arc, as there is time for.

    The pairs are spread evenly over the legs: the first pair before the first leg, the last pair
    after the last leg. Successive pairs begin to different sides.
    """
    # the legs for which there is time
    time_for_legs = limits.duration * (1 - route.spinning)
    times = durations(legs.reshape(-1, 2), limits).reshape(-1, 2).sum(axis=1)
    count = int(np.searchsorted(np.cumsum(times), time_for_legs + _TIME_ROUNDING))

    # the remaining time is shared among the pairs, of which the first and the last serve only one
    # stretch; a spin takes half of its pair's time
    share = np.ones(route.stretches + 1)
    share[[0, -1]] = route.ends if route.stretches > 1 else 1.0
    share /= share.sum()
    remaining = limits.duration - times[:count].sum()
    to_the_left_and_back = np.outer([1.0, -1.0], TRACK_SIGNS)
    pairs = [longest_spin(remaining * part / 2, limits) * to_the_left_and_back for part in share]
    pairs[1::2] = [-pair for pair in pairs[1::2]]

    # the stretch of legs after each pair, empty after the last one; a leg has two maneuvers
    legs_before_pair = np.linspace(0, count, route.stretches + 1).astype(int)
    maneuvers = legs[:count].reshape(-1, 2)
    stretches = np.split(maneuvers, 2 * legs_before_pair[1:])

    sequence = []
    for pair, stretch in zip(pairs, stretches, strict=True):
        sequence += [pair, stretch]
    return Maneuvers.of(np.concatenate(sequence), limits)


def _belt_distances(length: Array, turn: Array, knowledge: Knowledge) -> Array:
    """Distances (n, 2) [m] of the belts for path lengths (n,) [m] and turns (n,) [rad]."""
    over_ground = length[:, None] + TRACK_SIGNS * knowledge.reach * turn[:, None]
    return np.asarray(over_ground / (1 + knowledge.radius_error))


def extent(maneuvers: Maneuvers, heading: float, knowledge: Knowledge) -> Array:
    """Lowest and highest x and y (2, 2) [m] of the robot from the origin with `heading` [rad]."""
    places = np.stack(path(maneuvers, heading, knowledge.extremes))
    margin = _SLIP_DEVIATIONS * _slip_deviations(maneuvers, places, knowledge)
    lowest = (places - margin).min(axis=(1, 2))
    highest = (places + margin).max(axis=(1, 2))
    return np.stack([lowest, highest])


def path(maneuvers: Maneuvers, heading: float, laws: Array) -> tuple[Array, Array]:
    """Positions x, y (L, K) [m] of the turning centre, from the origin with `heading` [rad].

    A law in `laws` (L, 3) is b + D [m], and 1 + epsilon left and right. The positions are the ends
    of the maneuvers' parts. A part is an arc: its chord is shorter by sin(turn / 2) / (turn / 2),
    and is parallel to the heading in the middle of the arc.
    """
    parts = np.repeat(maneuvers.distance, _PATH_PARTS, axis=0) / _PATH_PARTS
    over_ground = parts * laws[:, None, 1:]  # (L, M, 2) distances of the tracks
    turn = (over_ground[..., 1] - over_ground[..., 0]) / (2 * laws[:, :1])
    heading_after = heading + np.cumsum(turn, axis=1)
    heading_between = heading_after - turn / 2
    chord = over_ground.mean(axis=-1) * np.sinc(turn / (2 * np.pi))
    steps = chord * np.exp(1j * heading_between)
    start = np.zeros((len(laws), 1))
    position = np.concatenate([start, np.cumsum(steps, axis=1)], axis=1)
    return position.real, position.imag


def _slip_deviations(maneuvers: Maneuvers, places: Array, knowledge: Knowledge) -> Array:
    """Standard deviations (2, L, K) [m] of `places` (2, L, K) due to white slip.

    The slip in a part of length l turns all places after it about the part's middle. A turn moves
    the place (x, y) along x in proportion to the difference of y, its lever, and along y in
    proportion to that of x. With the lever h of a place and those h_i of the parts before it, the
    variance of the place is thus that of the turns per distance times

        sum_i (h - h_i)^2 l_i = h^2 sum_i l_i - 2 h sum_i h_i l_i + sum_i h_i^2 l_i
    """
    along, across, turning = knowledge.slip
    lengths = np.abs(maneuvers.distance).mean(axis=1)
    part = np.repeat(lengths, _PATH_PARTS) / _PATH_PARTS
    driven = np.append(0.0, np.cumsum(part))
    lever = places[::-1]
    middle = (lever[..., 1:] + lever[..., :-1]) / 2
    first_moment = np.zeros(lever.shape)
    first_moment[..., 1:] = np.cumsum(middle * part, axis=-1)
    second_moment = np.zeros(lever.shape)
    second_moment[..., 1:] = np.cumsum(middle**2 * part, axis=-1)
    by_turns = lever**2 * driven - 2 * lever * first_moment + second_moment
    by_turns = np.maximum(by_turns, 0.0)  # despite rounding
    return np.sqrt(max(along, across) ** 2 * driven + turning**2 * by_turns)


def best_route(
    cost: Callable[[Route], float], evaluations: int, rng: np.random.Generator
) -> tuple[Route, float]:
    """Find the best of about `evaluations` routes, and its cost, by differential evolution.

    The method is that of Storn and Price (1997). The search begins with straight lines along the
    diagonal, with various shares of spins, and with random routes.
    """
    # the bounds of the numbers that the search varies
    low = np.array([gene.low for gene in GENES])
    high = np.array([gene.high for gene in GENES])
    is_whole = np.array([gene.whole for gene in GENES])

    # the first routes
    diagonals = list[Route]()
    for spinning in _FIRST_SPINNING:
        for stretches in _FIRST_STRETCHES:
            diagonal = Route(
                start=0,
                end=LAST_WAYPOINT,
                backwards=(False, True),
                bow=(0, 0),
                spinning=spinning,
                stretches=stretches,
                shrink=_FIRST_SHRINK,
            )
            diagonals.append(diagonal)
    first = rng.uniform(low, high, (_POPULATION, len(GENES)))
    first[: len(diagonals)] = [route.genes for route in diagonals]
    first = np.where(is_whole, np.round(first), first)

    # each generation evaluates as many routes as the first, which doesn't count as an iteration
    generations = evaluations // _POPULATION
    found = scipy.optimize.differential_evolution(
        lambda genes: cost(Route.of(genes)),
        np.column_stack([low, high]),
        integrality=is_whole,
        init=first,
        maxiter=max(0, generations - 1),
        polish=False,
        tol=0.0,
        rng=rng,
    )
    return Route.of(found.x), float(found.fun)
