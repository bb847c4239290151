"""The search for the tour that tells most."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from trackslip.planning.tour import BOWS, PLACES, STRAIGHT, Tour

_LEGS = 12  # of a tour, before it repeats
_DRAWS = 0.35  # share of the evaluations spent on tours at random
_CLIMBS = 5  # tours that are changed at first
_CLIMBING = 0.5  # share of the changes made to these
_MOST_PAIRS = 12
_MAX_SPINNING = 0.8
_LEAST_SIZE = 0.2
_MAX_SHRINK = 0.05
_CORNERS = (0, 2, 8, 6)  # of PLACES, in order


def best_tour(cost: Callable[[Tour], float], evaluations: int, rng: np.random.Generator) -> tuple[Tour, float]:
    """The best of `evaluations` tours, and its cost.

    Known tours and random ones come first, then changes of the best few of them, then changes of the best one.
    """
    tours = _known()
    tours += [_random(rng) for _ in range(max(0, int(_DRAWS * evaluations) - len(tours)))]
    first = sorted(((cost(tour), k) for k, tour in enumerate(tours[:evaluations])))[:_CLIMBS]
    left = max(0, evaluations - len(tours))
    each = int(_CLIMBING * left) // len(first)
    climbed = [_climbed(tours[k], value, cost, each, rng) for value, k in first]
    best, least = min(climbed, key=lambda found: found[1])
    return _climbed(best, least, cost, left - each * len(first), rng)


def _climbed(
    best: Tour, least: float, cost: Callable[[Tour], float], count: int, rng: np.random.Generator
) -> tuple[Tour, float]:
    """The best after `count` changes, each kept where it is better."""
    for _ in range(count):
        tried = _changed(best, rng)
        value = cost(tried)
        if value < least:
            best, least = tried, value
    return best, least


def _known() -> list[Tour]:
    """Back and forth along the diagonal, and rounds to one side and to the other, with more and less spinning."""
    diagonal = np.array([_CORNERS[2], _CORNERS[0]])
    round_trip = np.array([*_CORNERS[1:], _CORNERS[0], *_CORNERS[:0:-1], _CORNERS[0]])
    forwards, back = np.zeros(len(round_trip), bool), np.array([False, True])
    lines = [
        Tour(_CORNERS[0], diagonal, back, _straight(2), share, pairs, shrink=0.01)
        for share in (0.25, 0.35, 0.45, 0.55)
        for pairs in (2, 3, 4, 6)
    ]
    rounds = [
        Tour(_CORNERS[0], round_trip, forwards, np.full(len(round_trip), bow), share, 4)
        for share in (0.2, 0.35)
        for bow in (STRAIGHT, STRAIGHT + 1)
    ]
    return lines + rounds


def _straight(count: int) -> np.ndarray:
    return np.full(count, STRAIGHT)


def _random(rng: np.random.Generator) -> Tour:
    count = int(rng.integers(2, _LEGS + 1))
    corners = rng.random(count) < 0.7
    place = np.where(corners, rng.choice(_CORNERS, count), rng.integers(len(PLACES), size=count))
    bow = np.where(rng.random(count) < 0.7, STRAIGHT, rng.integers(len(BOWS), size=count))
    share = rng.uniform(0.02, 0.5)
    return Tour(
        int(rng.choice(_CORNERS)),
        place,
        rng.random(count) < 0.5,
        bow,
        share,
        int(rng.integers(1, _MOST_PAIRS + 1)),
        float(np.exp(min(0.0, rng.uniform(np.log(_LEAST_SIZE), 1.0)))),
    )


def _changed(tour: Tour, rng: np.random.Generator) -> Tour:
    """A tour with one or two things changed."""
    for _ in range(int(rng.integers(1, 3))):
        k, kind = int(rng.integers(len(tour.place))), int(rng.integers(11))
        if kind == 0:
            place = tour.place.copy()
            place[k] = rng.integers(len(PLACES))
            tour = replace(tour, place=place)
        elif kind == 1:
            backwards = tour.backwards.copy()
            backwards[k] ^= True
            tour = replace(tour, backwards=backwards)
        elif kind == 2:
            bow = tour.bow.copy()
            bow[k] = rng.integers(len(BOWS))
            tour = replace(tour, bow=bow)
        elif kind == 3:
            tour = replace(tour, pairs=int(rng.integers(1, _MOST_PAIRS + 1)))
        elif kind == 4 and len(tour.place) < _LEGS:
            tour = _with_leg(tour, k, rng)
        elif kind == 5 and len(tour.place) > 2:
            kept = np.arange(len(tour.place)) != k
            tour = replace(tour, place=tour.place[kept], backwards=tour.backwards[kept], bow=tour.bow[kept])
        elif kind == 6:
            tour = replace(tour, start=int(rng.integers(len(PLACES))))
        elif kind == 7:
            size = tour.size * np.exp(0.3 * rng.standard_normal())
            tour = replace(tour, size=float(np.clip(size, _LEAST_SIZE, 1.0)))
        elif kind == 8:
            tour = replace(tour, ends=float(max(0.0, rng.uniform(-0.3, 1.0))))
        elif kind == 9:
            tour = replace(tour, shrink=float(rng.uniform(0.0, _MAX_SHRINK)))
        else:
            spinning = tour.spinning * np.exp(0.25 * rng.standard_normal())
            tour = replace(tour, spinning=float(np.clip(spinning, 0.0, _MAX_SPINNING)))
    return tour


def _with_leg(tour: Tour, k: int, rng: np.random.Generator) -> Tour:
    """A tour with one more leg in front of the leg `k`."""
    return replace(
        tour,
        place=np.insert(tour.place, k, rng.integers(len(PLACES))),
        backwards=np.insert(tour.backwards, k, rng.random() < 0.5),
        bow=np.insert(tour.bow, k, STRAIGHT),
    )
