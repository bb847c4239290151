"""Random search for the route whose drive determines a law best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from trackslip.planning.route import BOWS, STRAIGHT, WAYPOINTS, Route

_LEGS = 12  # of a route, before it repeats
_DRAWS = 0.35  # share of the evaluations spent on routes at random
_CLIMBS = 5  # routes that are changed at first
_CLIMBING = 0.5  # share of the changes made to these
_MOST_PAIRS = 12
_MAX_SPINNING = 0.8
_LEAST_SIZE = 0.2
_MAX_SHRINK = 0.05
_CORNERS = (0, 2, 8, 6)  # of WAYPOINTS, in order


def best_route(cost: Callable[[Route], float], evaluations: int, rng: np.random.Generator) -> tuple[Route, float]:
    """The best of `evaluations` routes, and its cost.

    The search starts from simple and random routes, mutates the best few of them, and then the best one.
    """
    routes = _known()
    routes += [_random(rng) for _ in range(max(0, int(_DRAWS * evaluations) - len(routes)))]
    first = sorted(((cost(route), k) for k, route in enumerate(routes[:evaluations])))[:_CLIMBS]
    left = max(0, evaluations - len(routes))
    each = int(_CLIMBING * left) // len(first)
    climbed = [_climbed(routes[k], value, cost, each, rng) for value, k in first]
    best, least = min(climbed, key=lambda found: found[1])
    return _climbed(best, least, cost, left - each * len(first), rng)


def _climbed(
    best: Route, least: float, cost: Callable[[Route], float], count: int, rng: np.random.Generator
) -> tuple[Route, float]:
    """The best after `count` mutations, each kept if it lowers the cost."""
    for _ in range(count):
        tried = _changed(best, rng)
        value = cost(tried)
        if value < least:
            best, least = tried, value
    return best, least


def _known() -> list[Route]:
    """Lines along the diagonal and rounds in both directions, with different shares of spinning."""
    diagonal = np.array([_CORNERS[2], _CORNERS[0]])
    round_trip = np.array([*_CORNERS[1:], _CORNERS[0], *_CORNERS[:0:-1], _CORNERS[0]])
    forwards, back = np.zeros(len(round_trip), bool), np.array([False, True])
    lines = [
        Route(_CORNERS[0], diagonal, back, np.full(2, STRAIGHT), share, pairs, shrink=0.01)
        for share in (0.25, 0.35, 0.45, 0.55)
        for pairs in (2, 3, 4, 6)
    ]
    rounds = [
        Route(_CORNERS[0], round_trip, forwards, np.full(len(round_trip), bow), share, 4)
        for share in (0.2, 0.35)
        for bow in (STRAIGHT, STRAIGHT + 1)
    ]
    return lines + rounds


def _random(rng: np.random.Generator) -> Route:
    count = int(rng.integers(2, _LEGS + 1))
    corners = rng.random(count) < 0.7
    place = np.where(corners, rng.choice(_CORNERS, count), rng.integers(len(WAYPOINTS), size=count))
    bow = np.where(rng.random(count) < 0.7, STRAIGHT, rng.integers(len(BOWS), size=count))
    share = rng.uniform(0.02, 0.5)
    return Route(
        int(rng.choice(_CORNERS)),
        place,
        rng.random(count) < 0.5,
        bow,
        share,
        int(rng.integers(1, _MOST_PAIRS + 1)),
        float(np.exp(min(0.0, rng.uniform(np.log(_LEAST_SIZE), 1.0)))),
    )


def _changed(route: Route, rng: np.random.Generator) -> Route:
    """A route with one or two properties mutated."""
    for _ in range(int(rng.integers(1, 3))):
        k, kind = int(rng.integers(len(route.place))), int(rng.integers(11))
        legs: dict[str, Any] = {name: getattr(route, name).copy() for name in ("place", "backwards", "bow")}
        if kind == 0:
            legs["place"][k] = rng.integers(len(WAYPOINTS))
        elif kind == 1:
            legs["backwards"][k] ^= True
        elif kind == 2:
            legs["bow"][k] = rng.integers(len(BOWS))
        elif kind == 3:
            route = replace(route, pairs=int(rng.integers(1, _MOST_PAIRS + 1)))
        elif kind == 4 and len(route.place) < _LEGS:
            legs["place"] = np.insert(legs["place"], k, rng.integers(len(WAYPOINTS)))
            legs["backwards"] = np.insert(legs["backwards"], k, rng.random() < 0.5)
            legs["bow"] = np.insert(legs["bow"], k, STRAIGHT)
        elif kind == 5 and len(route.place) > 2:
            legs = {name: np.delete(leg, k) for name, leg in legs.items()}
        elif kind == 6:
            route = replace(route, start=int(rng.integers(len(WAYPOINTS))))
        elif kind == 7:
            size = route.size * np.exp(0.3 * rng.standard_normal())
            route = replace(route, size=float(np.clip(size, _LEAST_SIZE, 1.0)))
        elif kind == 8:
            route = replace(route, ends=float(max(0.0, rng.uniform(-0.3, 1.0))))
        elif kind == 9:
            route = replace(route, shrink=float(rng.uniform(0.0, _MAX_SHRINK)))
        else:
            spinning = route.spinning * np.exp(0.25 * rng.standard_normal())
            route = replace(route, spinning=float(np.clip(spinning, 0.0, _MAX_SPINNING)))
        route = replace(route, **legs)
    return route
