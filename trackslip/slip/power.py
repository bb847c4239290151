"""A power law in radius."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array
from trackslip.slip.base import SlipLaw, by_side, radius_of, require_within


@dataclass(frozen=True)
class Power(SlipLaw):
    """i(R) = alpha (1 + R / b)^beta for the outer and the inner track: a power law that is finite at zero radius."""

    alpha_outer: float
    """Slip of the outer track at zero radius [-]."""
    beta_outer: float
    """Exponent of the outer track's slip [-], < 0."""
    alpha_inner: float
    """Slip of the inner track at zero radius [-]."""
    beta_inner: float
    """Exponent of the inner track's slip [-], < 0."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""

    def __post_init__(self) -> None:
        require_within("half_gauge", self.half_gauge, 0, np.inf, "finite and > 0")
        for name in ("alpha_outer", "alpha_inner"):
            require_within(
                name, getattr(self, name), -np.inf, 1, "finite and < 1 (slip 1 is a track that stands still)"
            )
        for name in ("beta_outer", "beta_inner"):
            require_within(name, getattr(self, name), -np.inf, 0, "finite and < 0 (no slip on a straight path)")

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...)."""
        with np.errstate(over="ignore"):
            base = 1 + radius_of(kappa) / self.half_gauge
        inner = self.alpha_inner * base**self.beta_inner
        outer = self.alpha_outer * base**self.beta_outer
        return by_side(kappa, inner, outer)
