"""Returns of a laser range finder as points, and the pieces they form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array


@dataclass(frozen=True)
class Returns:
    """Returns in the order of scans and beams."""

    row: np.ndarray  # (H,) the scan
    beam: np.ndarray  # (H,)
    x: Array  # (H,) in the LRF's frame [m]
    y: Array  # (H,)

    def split(self, gap: float) -> ReturnPieces:
        """Pieces, separated where neighbours lie more than `gap` [m] apart."""
        apart = (self.x[1:] - self.x[:-1]) ** 2 + (self.y[1:] - self.y[:-1]) ** 2 > gap**2
        apart |= self.row[1:] != self.row[:-1]
        starts = np.ones(len(self.row), bool)
        starts[1:] = apart
        first = np.flatnonzero(starts)
        label = np.cumsum(starts) - 1
        count = np.append(first[1:], len(starts)) - first
        spans = [np.maximum.reduceat(c, first) - np.minimum.reduceat(c, first) for c in (self.x, self.y)]
        return ReturnPieces(self.row[first], label, count[: len(first)], np.maximum(*spans))

    def centres(self, pieces: ReturnPieces) -> Array:
        """Mean points (P, 2) of pieces [m]."""
        sums = [np.bincount(pieces.label, c, len(pieces.count)) for c in (self.x, self.y)]
        return np.stack(sums, axis=-1) / pieces.count[:, None]


@dataclass(frozen=True)
class ReturnPieces:
    """Runs of neighbouring returns."""

    row: np.ndarray  # (P,) the scan
    label: np.ndarray  # (H,) the piece of each return
    count: np.ndarray  # (P,) of returns
    extent: Array  # (P,) the longer side of the box around it [m]


def best_of_each(row: np.ndarray, score: Array) -> np.ndarray:
    """Mask (P,) of the piece with the highest score of each row; the last of equal ones."""
    order = np.lexsort((score, row))
    best = np.zeros(len(row), bool)
    best[order[np.append(np.diff(row[order]) != 0, True)[: len(order)]]] = True
    return best
