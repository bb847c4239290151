"""The paper's exponential law, and its extension by a dependence on speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array, curvature
from trackslip.laws.base import SlipLaw, by_side, require_between


@dataclass(frozen=True)
class Exponential(SlipLaw):
    """The paper's law, i(R) = alpha exp(beta R), with alpha and beta for the outer and the inner
    track (Eqs. 10-13).

    The law doesn't hold in turns on the spot. The slip of the inner track is negative in wide
    turns, has a pole where this track's sprocket stops, and is positive in tighter turns, where
    the track is driven in reverse. The exponential function stays negative, and the robot turns
    too little.
    """

    turns_on_the_spot = False

    alpha_outer: float
    """Slip of the outer track at zero radius [-]."""
    beta_outer: float
    """Decay of the outer track's slip with radius [1/m], < 0."""
    alpha_inner: float
    """Slip of the inner track at zero radius [-]."""
    beta_inner: float
    """Decay of the inner track's slip with radius [1/m], < 0."""

    def __post_init__(self) -> None:
        slips = "finite and < 1 (slip 1 is a track that stands still)"
        require_between(self, ("alpha_outer", "alpha_inner"), -np.inf, 1, slips)
        decays = "finite and < 0 (no slip on a straight path)"
        require_between(self, ("beta_outer", "beta_inner"), -np.inf, 0, decays)

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...)."""
        return self._decayed(kappa, self.alpha_inner, self.alpha_outer)

    def _decayed(self, kappa: ArrayLike, inner: float | Array, outer: float | Array) -> Array:
        """Slips (..., 2) at curvatures (...), from the `inner` and `outer` slips at zero radius."""
        with np.errstate(divide="ignore", over="ignore"):
            radius = 1 / np.abs(np.asarray(kappa, float))
        inner_slip = inner * np.exp(self.beta_inner * radius)
        outer_slip = outer * np.exp(self.beta_outer * radius)
        return by_side(kappa, inner_slip, outer_slip)


@dataclass(frozen=True)
class ExponentialSpeed(Exponential):
    """An exponential law whose slip at zero radius grows with speed: i(R, v) = (alpha + gamma |v|)
    exp(beta R).
    """

    gamma_outer: float
    """Increase in the outer track's slip with speed [s/m]."""
    gamma_inner: float
    """Increase in the inner track's slip with speed [s/m]."""

    twist_iterations = 24  # convergence is slow if slip increases steeply with speed

    def __post_init__(self) -> None:
        super().__post_init__()
        require_between(self, ("gamma_outer", "gamma_inner"), -np.inf, np.inf, "finite")

    def slip(self, twist: ArrayLike) -> Array:
        """Slips (..., 2) at twists (..., 2). Calls of the law return the limit for |v| = 0."""
        speed = np.abs(np.asarray(twist, float)[..., 0])
        inner = self.alpha_inner + self.gamma_inner * speed
        outer = self.alpha_outer + self.gamma_outer * speed
        return self._decayed(curvature(twist), inner, outer)


PUBLISHED: Final = Exponential(
    alpha_outer=0.07, beta_outer=-0.68, alpha_inner=-0.15, beta_inner=-0.63
)
"""The law of Eq. 11, which the paper identified from 25 runs of ResQuake on stone paving."""
