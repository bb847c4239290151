"""Stretches of a run in which both sprocket speeds are constant."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array

SETTLE = 1.5
"""Default time from steady sprockets to a steady robot [s]."""
_BLOCK = 0.5  # time over which sprocket speeds are averaged for comparison [s]
_DRIFT = 0.05  # maximum change of a steady sprocket's mean speed, relative to the faster sprocket
_SLOW = 0.2  # sprocket speed below which the maximum change is absolute, relative to the run's fastest
_NOISE = 4.0  # change of mean speeds that the encoder's noise explains [standard deviations]


@dataclass(frozen=True)
class _Blocks:
    """Means of successive rows, and the furthest block up to which the speeds stay constant from each on."""

    start: np.ndarray  # (n,) first row
    end: np.ndarray  # (n,) last row
    furthest: np.ndarray  # (n,)


def constant_stretches(
    time: Array, omega: Array, breaks: np.ndarray, least: float
) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """First and last rows of all stretches that last at least `least` [s], in order; and of the longest of all.

    Stretches do not overlap, nor extend across `breaks`, the rows after which a new section begins. The longest is
    taken first, then the longest of what is left.
    """
    size = max(1, round(min(_BLOCK / float(np.median(np.diff(time))), len(time))))
    jitter = 1.4826 * float(np.median(np.abs(np.diff(omega, axis=0)))) / np.sqrt(2)
    edges = np.concatenate([[0], breaks + 1, [len(time)]])
    sections = [(int(first), _block_means(omega[first:end], size)) for first, end in itertools.pairwise(edges)]
    fastest = max(float(np.abs(mean).max()) for _, mean in sections)
    floor = _DRIFT * _SLOW * fastest, _NOISE * jitter / np.sqrt(size)
    found: list[tuple[int, int]] = []
    longest = (0, 0)
    for (first, mean), end in zip(sections, edges[1:], strict=True):
        start = first + size * np.arange(len(mean))
        blocks = _Blocks(start, np.append(start[1:], end) - 1, _furthest(mean, *floor))
        for stretch in _longest_first(time, blocks, least):
            duration = time[stretch[1]] - time[stretch[0]]
            if duration >= least:
                found.append(stretch)
            if duration > time[longest[1]] - time[longest[0]]:
                longest = stretch
    return sorted(found), longest


def _longest_first(time: Array, blocks: _Blocks, least: float) -> list[tuple[int, int]]:
    """The longest stretch of a section, the longest before and after it, and so on while they last `least` [s]."""
    found: list[tuple[int, int]] = []
    left = [(0, len(blocks.start) - 1)]
    while left:
        first, last = left.pop()
        end = np.minimum(blocks.furthest[first : last + 1], last)
        duration = time[blocks.end[end]] - time[blocks.start[first : last + 1]]
        k = int(np.argmax(duration))
        if found and duration[k] < least:
            continue
        begin, end_k = first + k, int(end[k])
        found.append((int(blocks.start[begin]), int(blocks.end[end_k])))
        left += [part for part in ((first, begin - 1), (end_k + 1, last)) if part[0] <= part[1]]
    return found


def _block_means(values: Array, size: int) -> Array:
    """Means (blocks, 2) of blocks of `size` rows out of (T, 2); the last block includes the remainder."""
    blocks = max(1, len(values) // size)
    starts = np.arange(blocks) * size
    counts = np.diff(np.append(starts, len(values)))
    return np.add.reduceat(values, starts, axis=0) / counts[:, None]


def _furthest(mean: Array, floor: float, noise: float) -> np.ndarray:
    """For each block, the last block (n,) up to which neither column of `mean` (n, 2) varies too much.

    The variation allowed is a share of the faster sprocket's speed, at least `floor`, and that of the `noise`. Spans of
    2^k blocks are appended, from the longest to the shortest, while they fit.
    """
    count = len(mean)
    low, high = [mean], [mean]
    while 2 << (len(low) - 1) <= count:
        half = 1 << (len(low) - 1)
        low.append(np.minimum(low[-1][:-half], low[-1][half:]))
        high.append(np.maximum(high[-1][:-half], high[-1][half:]))
    least, most = mean.copy(), mean.copy()
    after = np.arange(1, count + 1)  # the first block not yet included
    for k in range(len(low) - 1, -1, -1):
        fits = np.flatnonzero(after + (1 << k) <= count)
        lower = np.minimum(least[fits], low[k][after[fits]])
        upper = np.maximum(most[fits], high[k][after[fits]])
        speed = np.maximum(np.abs(lower), np.abs(upper)).max(axis=1)
        constant = (upper - lower).max(axis=1) <= np.maximum(_DRIFT * speed, floor) + noise
        chosen = fits[constant]
        least[chosen], most[chosen] = lower[constant], upper[constant]
        after[chosen] += 1 << k
    return after - 1
