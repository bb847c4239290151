"""The paper's exponential law, and an extension that depends on speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array, curvature
from trackslip.slip.base import SlipLaw, by_side, radius_of, require_within


@dataclass(frozen=True)
class Exponential(SlipLaw):
    """The paper's law, i(R) = alpha exp(beta R) for the outer and the inner track (Eqs. 10-13)."""

    alpha_outer: float
    """Slip of the outer track at zero radius [-]."""
    beta_outer: float
    """Decay of the outer track's slip with radius [1/m], < 0."""
    alpha_inner: float
    """Slip of the inner track at zero radius [-]."""
    beta_inner: float
    """Decay of the inner track's slip with radius [1/m], < 0."""

    def __post_init__(self) -> None:
        for name in ("alpha_outer", "alpha_inner"):
            require_within(
                name, getattr(self, name), -np.inf, 1, "finite and < 1 (slip 1 is a track that stands still)"
            )
        for name in ("beta_outer", "beta_inner"):
            require_within(name, getattr(self, name), -np.inf, 0, "finite and < 0 (no slip on a straight path)")

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...)."""
        radius = radius_of(kappa)
        inner = self.alpha_inner * np.exp(self.beta_inner * radius)
        outer = self.alpha_outer * np.exp(self.beta_outer * radius)
        return by_side(kappa, inner, outer)


@dataclass(frozen=True)
class ExponentialSpeed(Exponential):
    """An exponential whose slip at zero radius grows with speed: i(R, v) = (alpha + gamma |v|) exp(beta R)."""

    gamma_outer: float
    """Growth of the outer track's slip with speed [s/m]."""
    gamma_inner: float
    """Growth of the inner track's slip with speed [s/m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("gamma_outer", "gamma_inner"):
            require_within(name, getattr(self, name), -np.inf, np.inf, "finite")

    def slip(self, twist: ArrayLike) -> Array:
        """Slips (..., 2) at twists (..., 2); calling the law gives the limit |v| = 0."""
        kappa, speed = curvature(twist), np.abs(np.asarray(twist, float)[..., 0])
        radius = radius_of(kappa)
        inner = (self.alpha_inner + self.gamma_inner * speed) * np.exp(self.beta_inner * radius)
        outer = (self.alpha_outer + self.gamma_outer * speed) * np.exp(self.beta_outer * radius)
        return by_side(kappa, inner, outer)


PUBLISHED = Exponential(alpha_outer=0.07, beta_outer=-0.68, alpha_inner=-0.15, beta_inner=-0.63)
"""Eq. 11 of the paper, identified from 25 runs of ResQuake on stone paving."""
