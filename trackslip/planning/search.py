"""The search for the tour that tells most."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from trackslip.planning.tour import BOWS, PLACES, STRAIGHT, Tour

_LEGS = 12  # of a tour, before it repeats
_DRAWS = 0.35  # share of the evaluations spent on tours at random
_MOST_PAIRS = 12
_MAX_SPINNING = 0.8
_CORNERS = (0, 2, 8, 6)  # of PLACES, in order


def best_tour(cost: Callable[[Tour], float], evaluations: int, rng: np.random.Generator) -> tuple[Tour, float]:
    """The best of `evaluations` tours, and its cost: known ones and random ones first, then changes of the best."""
    tours = _known()
    tours += [_random(rng) for _ in range(max(0, int(_DRAWS * evaluations) - len(tours)))]
    costs = [cost(tour) for tour in tours]
    k = int(np.argmin(costs))
    best, least = tours[k], costs[k]
    for _ in range(evaluations - len(tours)):
        tried = _changed(best, rng)
        value = cost(tried)
        if value < least:
            best, least = tried, value
    return best, least


def _known() -> list[Tour]:
    """Rounds to one side and to the other, and back and forth along the diagonal, with more and less spinning."""
    round_trip = np.array([*_CORNERS[1:], _CORNERS[0], *_CORNERS[:0:-1], _CORNERS[0]])
    diagonal = np.array([_CORNERS[2], _CORNERS[0]])
    forwards, back = np.zeros(len(round_trip), bool), np.array([False, True])
    shares = (0.1, 0.2, 0.3, 0.45)
    tours = [Tour(_CORNERS[0], round_trip, forwards, _straight(8), share, 4) for share in shares]
    return tours + [Tour(_CORNERS[0], diagonal, back, _straight(2), share, 8) for share in shares]


def _straight(count: int) -> np.ndarray:
    return np.full(count, STRAIGHT)


def _random(rng: np.random.Generator) -> Tour:
    count = int(rng.integers(2, _LEGS + 1))
    corners = rng.random(count) < 0.7
    place = np.where(corners, rng.choice(_CORNERS, count), rng.integers(len(PLACES), size=count))
    bow = np.where(rng.random(count) < 0.7, STRAIGHT, rng.integers(len(BOWS), size=count))
    share = rng.uniform(0.02, 0.5)
    return Tour(
        int(rng.choice(_CORNERS)), place, rng.random(count) < 0.5, bow, share, int(rng.integers(1, _MOST_PAIRS + 1))
    )


def _changed(tour: Tour, rng: np.random.Generator) -> Tour:
    """A tour with one or two things changed."""
    for _ in range(int(rng.integers(1, 3))):
        k, kind = int(rng.integers(len(tour.place))), int(rng.integers(8))
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
