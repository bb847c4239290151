"""Poses that jump off a path: single wild ones, which come back, and lasting ones, as of a relocalisation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trackslip.kinematics import Array

MOST_WILD = 3  # successive poses that are wild, or placeholders, rather than a path of their own
_NOISE = 0.1  # share of outlying motions above which all of them are noise

Missed = Callable[[np.ndarray, np.ndarray], tuple[Array, Array]]
"""From the first and the last of some poses, (n,) each, by how much motions miss the path, and how much of that slip
explains, (2, n) [m, rad]."""


def find_jumps(count: int, missed: Missed, limit: Array) -> tuple[list[int], list[int]]:
    """Indices of wild poses out of `count`, and of the first pose after each lasting jump.

    No motion jumps that slip explains to within `limit` (2,) [m, rad].
    """
    step, limit = np.arange(1, count), limit[:, None]
    size, slip = missed(step - 1, step)
    outlying = step[(size - slip > limit).any(axis=0)]
    wild, lasting, last = list[int](), list[int](), 0
    for k in outlying.tolist() if len(outlying) <= max(1, _NOISE * count) else []:
        if k <= last:
            continue
        after = np.arange(k + 1, min(k + 1 + MOST_WILD, count))
        size, slip = missed(np.full(len(after), k - 1), after)
        back = after[(size - slip <= limit).all(axis=0)]
        if back.size:
            last = int(back[0])
            wild += range(k, last)
        else:
            lasting.append(k)
    return wild, lasting
