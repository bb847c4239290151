"""Powers of radius: a power law, and a hyperbola with a free pole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import SIDES, Array
from trackslip.slip.base import SlipLaw, by_side, radius_of, require_between, require_decays, require_slips


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
        require_between(self, ("half_gauge",), 0, np.inf, "finite and > 0")
        require_slips(self, "alpha_outer", "alpha_inner")
        require_decays(self, "beta_outer", "beta_inner")

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...)."""
        with np.errstate(over="ignore"):
            base = 1 + radius_of(kappa) / self.half_gauge
        return by_side(kappa, self.alpha_inner * base**self.beta_inner, self.alpha_outer * base**self.beta_outer)


@dataclass(frozen=True)
class Hyperbola(SlipLaw):
    """i = a / (R + p) outside and -a / (R - p) inside; the constant ICR is the special case p = b + a.

    In terms of curvature, i = +-a kappa / (1 +- p kappa), which is regular except for the pole of the inner
    track at R = p.
    """

    size: float
    """a: slip times radius in wide turns [m]."""
    pole: float
    """p: radius of the pole of the inner track's slip [m], >= 0."""

    twist_iterations = 40  # convergence is slow near the poles

    def __post_init__(self) -> None:
        require_between(self, ("size",), -np.inf, np.inf, "finite")
        require_between(self, ("pole",), np.nextafter(0, -1), np.inf, "finite and >= 0")

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...)."""
        direction = np.arctan(np.asarray(kappa, float))[..., None]  # finite for infinite curvature
        along, turning = np.cos(direction), np.sin(direction)
        size, pole = np.asarray(self.size)[..., None], np.asarray(self.pole)[..., None]
        with np.errstate(divide="ignore", invalid="ignore"):
            return SIDES * size * turning / (along + SIDES * pole * turning)
