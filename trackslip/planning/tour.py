"""Tours: drives between nine places of the area, straight or on arcs, forwards or backwards, with spins between.

A tour is what is searched for. It says where to go and how, not how far: places move together until the robot stays in
the area by every law that it may have. A spin to one side is followed by the same to the other, so that the heading
after both doesn't depend on the law.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import SIDES, Array, wrap_angle
from trackslip.planning.limits import DriveLimits, Knowledge
from trackslip.planning.place import Places, places
from trackslip.planning.strokes import Strokes, durations, longest_spin

PLACES = np.array([(x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)])
"""Places (9, 2) in halves of the area's length and width, or of what can be driven in a larger one."""
BOWS = np.radians([-60.0, -30.0, 0.0, 30.0, 60.0])
"""Angles (5,) between the chord of a leg and its ends."""
STRAIGHT = 2
"""Index of a straight leg in BOWS."""
_FITTED = 8  # rounds in which the places move together
_SLACK = 1e-3  # relative, by which they move further than they seem to have to
_LONGEST = 0.25  # way from the middle to a place in a large area, of what can be driven in all [-]
_SMALLEST = 0.02  # scale below which there is no room


@dataclass(frozen=True)
class Tour:
    """Legs, repeated until the time is up, and spins."""

    start: int
    """Where it begins, an index into PLACES."""
    place: np.ndarray  # (n,) int, ends of the legs, indices into PLACES
    backwards: np.ndarray  # (n,) bool: whether a leg is driven backwards
    bow: np.ndarray  # (n,) int, indices into BOWS
    spinning: float
    """Share of the time for spins to both sides [-]."""
    pairs: int
    """Number of such pairs, spread over the tour."""
    size: float = 1.0
    """How far apart the places are, relative to the largest distances that matter [-]."""
    ends: float = 0.5
    """Length of the first and the last pair over that of the others, which are measured for two legs [-]."""
    shrink: float = 0.0
    """How much nearer to the middle each leg leads than the one before, as slip adds up [-]."""


@dataclass(frozen=True)
class Drawn:
    """A tour within limits."""

    strokes: Strokes
    start: Array  # (3,) where it begins, from the middle of the area [m, m, rad]
    places: Places  # from the middle of the area


def drawn(tour: Tour, limits: DriveLimits, knowledge: Knowledge) -> Drawn | None:
    """The tour, as large as the area allows; None if it doesn't fit at all."""
    scale = tour.size
    for _ in range(_FITTED):
        strokes, heading = _strokes(tour, scale, limits, knowledge)
        if not len(strokes.way):
            return None
        found = places(strokes, heading, knowledge)
        over = float((found.size / limits.room).max())
        if over <= 1:
            middle = (found.low + found.high) / 2
            return Drawn(
                strokes, np.array([*-middle, wrap_angle(heading)]), Places(found.low - middle, found.high - middle)
            )
        scale /= over * (1 + _SLACK)
        if scale < _SMALLEST:
            return None
    return None


def _strokes(tour: Tour, scale: float, limits: DriveLimits, knowledge: Knowledge) -> tuple[Strokes, float]:
    """The strokes, with places `scale` times as far apart as they can be, and the heading at the start."""
    half = scale * np.minimum(limits.room / 2, _LONGEST * limits.max_speed * limits.duration)
    rounds = max(1, int(np.ceil(limits.duration * limits.max_speed / (len(tour.place) * half.min()))))
    end = np.tile(tour.place, rounds)
    begin = np.concatenate([[tour.start], end[:-1]])
    moving = begin != end
    backwards, bow = (np.tile(gene, rounds)[moving] for gene in (tour.backwards, BOWS[tour.bow]))
    size = (1 - tour.shrink) ** np.arange(len(end) + 1)[:, None]
    chord = (size[1:] * PLACES[end] - size[:-1] * PLACES[begin])[moving] * half
    if not len(chord):
        return Strokes.of(np.zeros((0, 2)), limits), 0.0
    heading = np.arctan2(chord[:, 1], chord[:, 0]) - bow + np.pi * backwards
    turn = wrap_angle(heading - np.concatenate([heading[:1], heading[:-1] + 2 * bow[:-1]]))
    length = np.hypot(*chord.T) / np.sinc(bow / np.pi) * np.where(backwards, -1.0, 1.0)
    legs = np.stack([_ways(0 * turn, turn, knowledge), _ways(length, 2 * bow, knowledge)], axis=1)
    return _timed(legs, tour, limits), float(heading[0])


def _timed(legs: Array, tour: Tour, limits: DriveLimits) -> Strokes:
    """As many of the legs (n, 2, 2), each a spin and a stroke, as there is time for, and pairs of spins between."""
    for_legs = limits.duration * (1 - tour.spinning)
    times = durations(legs.reshape(-1, 2), limits).reshape(-1, 2).sum(axis=1)
    count = int(np.searchsorted(np.cumsum(times), for_legs + 1e-9))
    share = np.ones(tour.pairs + 1)
    share[[0, -1]] = tour.ends if tour.pairs > 1 else 1.0
    share /= share.sum()
    rest = limits.duration - times[:count].sum()
    spins = [longest_spin(rest * part / 2, limits) * np.outer([1.0, -1.0], SIDES) for part in share]
    before = np.linspace(0, count, tour.pairs + 1).astype(int)
    parts = np.split(legs[:count].reshape(-1, 2), 2 * before[1:])
    turned = [(1 - 2 * (k % 2)) * spin for k, spin in enumerate(spins)]
    return Strokes.of(np.concatenate([one for both in zip(turned, parts, strict=True) for one in both]), limits)


def _ways(length: Array, turn: Array, knowledge: Knowledge) -> Array:
    """Ways (n, 2) of the belts for lengths (n,) [m] and turns (n,) [rad] of the robot."""
    real = length[:, None] + SIDES * knowledge.reach * turn[:, None]
    return np.asarray(real / (1 + knowledge.radius_error))
