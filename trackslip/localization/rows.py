"""Dataclasses of arrays that share their first axis: a row per scan, cluster or pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np


@dataclass(frozen=True)
class Rows:
    """Base of such dataclasses; fields that are not arrays belong to all rows."""

    def take(self, rows: np.ndarray) -> Self:
        """The rows `rows`, in that order, possibly repeated."""
        taken = object.__new__(type(self))  # not by way of __init__, which takes longer than the arrays of a few rows
        values = {name: value[rows] if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}
        vars(taken).update(values)
        return taken

    def put(self, rows: np.ndarray, other: Self) -> None:
        """Overwrite the rows `rows` (R,) with the R rows of `other`."""
        for mine, others in zip(vars(self).values(), vars(other).values(), strict=True):
            if isinstance(mine, np.ndarray):
                mine[rows] = others
