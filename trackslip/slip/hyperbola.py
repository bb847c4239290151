"""A hyperbola in radius with a free pole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import SIDES, Array
from trackslip.slip.base import SlipLaw, require_between


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
