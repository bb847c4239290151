"""Dataclasses of arrays with one row for each scan or pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np


@dataclass(frozen=True)
class Rows:
    """Base class of dataclasses of arrays with the same first axis."""

    def take(self, rows: np.ndarray) -> Self:
        """Select the rows with indices `rows`, in that order, possibly repeated."""
        selected = {name: values[rows] for name, values in vars(self).items()}
        return type(self)(**selected)

    def put(self, rows: np.ndarray, other: Self) -> None:
        """Overwrite the rows with indices `rows` (R,) with the R rows of `other`."""
        for name, values in vars(self).items():
            values[rows] = getattr(other, name)
