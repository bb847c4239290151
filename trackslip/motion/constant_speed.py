"""Stretches of a run in which both sprocket speeds are constant."""

from __future__ import annotations

import itertools

import numpy as np

from trackslip.kinematics import Array

SETTLE = 1.5
"""Default time from steady sprockets to a steady robot [s]."""
_BLOCK = 0.5  # time over which sprocket speeds are averaged for comparison [s]
_DRIFT = 0.05  # maximum change of a steady sprocket's mean speed, relative to the faster sprocket
_SLOW = 0.2  # sprocket speed below which the maximum change is absolute, relative to the run's fastest
_NOISE = 4.0  # change of mean speeds that the encoder's noise explains [standard deviations]


def constant_stretches(
    time: Array, omega: Array, breaks: np.ndarray, least: float
) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """First and last rows of all stretches that last at least `least` [s], in order; and of the longest of all.

    Stretches do not overlap, nor extend across `breaks`, the rows after which a new section begins. The longest of a
    section is taken first, then the longest of what is left.
    """
    size = max(1, round(min(_BLOCK / float(np.median(np.diff(time))), len(time))))
    jitter = 1.4826 * float(np.median(np.abs(np.diff(omega, axis=0)))) / np.sqrt(2)
    edges = np.concatenate([[0], breaks + 1, [len(time)]]).tolist()
    means = [_block_means(omega[first:end], size) for first, end in itertools.pairwise(edges)]
    fastest = max(float(np.abs(mean).max()) for mean in means)
    floor = _DRIFT * _SLOW * fastest, _NOISE * jitter / np.sqrt(size)
    stretches, longest = list[tuple[int, int]](), (0, 0)
    for (first, end), mean in zip(itertools.pairwise(edges), means, strict=True):
        begin = first + size * np.arange(len(mean))  # first and last rows of the blocks
        last, furthest = np.append(begin[1:], end) - 1, _furthest(mean, *floor)
        left = [(0, len(mean) - 1)]
        while left:
            low, high = left.pop()
            to = np.minimum(furthest[low : high + 1], high)
            duration = time[last[to]] - time[begin[low : high + 1]]
            k = int(np.argmax(duration))
            stretch = int(begin[low + k]), int(last[to[k]])
            if duration[k] > time[longest[1]] - time[longest[0]]:
                longest = stretch
            if duration[k] >= least:
                stretches.append(stretch)
                parts = (low, low + k - 1), (int(to[k]) + 1, high)
                left += [part for part in parts if part[0] <= part[1]]
    return sorted(stretches), longest


def _block_means(values: Array, size: int) -> Array:
    """Means (blocks, 2) of blocks of `size` rows out of (T, 2); the last block includes the remainder."""
    blocks = max(1, len(values) // size)
    starts = np.arange(blocks) * size
    counts = np.diff(np.append(starts, len(values)))
    return np.add.reduceat(values, starts, axis=0) / counts[:, None]


def _furthest(mean: Array, floor: float, noise: float) -> np.ndarray:
    """For each block, the last block (n,) up to which neither column of `mean` (n, 2) varies too much.

    The variation allowed is a share of the faster sprocket's speed, at least `floor`, and that of the `noise`. It grows
    by less than the variation, so that no later block goes less far.
    """
    furthest, end = np.empty(len(mean), int), 0
    for first in range(len(mean)):
        end = max(first, end)
        low, high = mean[first : end + 1].min(axis=0), mean[first : end + 1].max(axis=0)
        for block in mean[end + 1 :]:
            low, high = np.minimum(low, block), np.maximum(high, block)
            speed = max(np.abs(low).max(), np.abs(high).max())
            if (high - low).max() > max(_DRIFT * speed, floor) + noise:
                break
            end += 1
        furthest[first] = end
    return furthest
