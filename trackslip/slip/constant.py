"""Slip that does not depend on the path, and no slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array
from trackslip.slip.base import SlipLaw, by_side, require_slips


@dataclass(frozen=True)
class NoSlip(SlipLaw):
    """Ideal tracks: no slip at any radius."""

    def __call__(self, kappa: ArrayLike) -> Array:
        """Zeros (..., 2)."""
        return np.zeros((*np.shape(kappa), 2))


@dataclass(frozen=True)
class Constant(SlipLaw):
    """The same slip at every radius, with a jump at the straight path, where it is the mean of both tracks."""

    slip_outer: float
    """Slip of the outer track [-]."""
    slip_inner: float
    """Slip of the inner track [-]."""

    def __post_init__(self) -> None:
        require_slips(self, "slip_outer", "slip_inner")

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...)."""
        return by_side(kappa, np.asarray(self.slip_inner), np.asarray(self.slip_outer))
