"""Slip laws: path curvature -> slip of the (left, right) tracks.

A law knows nothing of speed: on a slow robot slip depends on the path's radius only (paper, Sec. III-C). Laws take a
signed curvature kappa = w / v (positive: counter-clockwise when driving forwards), so that a straight path is
kappa = 0 and nothing special. Right turns mirror left turns: the inner law goes to the inner track.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, require_finite, require_positive
from trackslip.kinematics import SIDES, Array, RobotGeometry, curvature, sprocket_speeds


class SlipLaw(ABC):
    """Curvature (...) [1/m] -> slip (..., 2) of the left and right track."""

    @abstractmethod
    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...); infinite curvature is turning in place."""

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that drive a twist (..., 2) under this law; Eq. 15."""
        return sprocket_speeds(twist, self(curvature(twist)), geometry)


@dataclass(frozen=True)
class NoSlip(SlipLaw):
    """Ideal tracks: no slip at any radius."""

    def __call__(self, kappa: ArrayLike) -> Array:
        """Zeros (..., 2)."""
        return np.zeros((*np.shape(kappa), 2))


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
            value = getattr(self, name)
            if not -np.inf < value < 1:
                raise InvalidValueError(name, value, "finite and < 1 (slip 1 is a track that stands still)")
        for name in ("beta_outer", "beta_inner"):
            if not -np.inf < getattr(self, name) < 0:
                raise InvalidValueError(name, getattr(self, name), "finite and < 0 (no slip on a straight path)")

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...)."""
        kappa = np.asarray(kappa, float)
        with np.errstate(divide="ignore", over="ignore"):
            radius = 1 / np.abs(kappa)
        outer = self.alpha_outer * np.exp(self.beta_outer * radius)
        inner = self.alpha_inner * np.exp(self.beta_inner * radius)
        left_is_inner = kappa > 0
        return np.stack([np.where(left_is_inner, inner, outer), np.where(left_is_inner, outer, inner)], axis=-1)


@dataclass(frozen=True)
class ConstantIcr(SlipLaw):
    """Tracks whose instantaneous centres of rotation stay where they are, b + D to the left and right.

    That is what rigid Coulomb friction gives in a slow turn. With V = r omega the commanded track speeds,
    (1 + epsilon) V = v -+ (b + D) w exactly, so i = 1 - (1 + epsilon) (1 -+ b kappa) / (1 -+ (b + D) kappa):
    for epsilon = 0, D / (R + b + D) outside and -D / (R - b - D) inside. The slip ratio has a pole where the inner
    sprocket stands still; the sprocket speeds have none, and are computed without it.
    """

    offset: float
    """D: how far the centres lie outside the tracks' centre lines [m]."""
    half_gauge: float
    """b: half the distance between the tracks' centre lines [m]."""
    radius_error: float = 0.0
    """epsilon: relative error of the effective sprocket radius, real / nominal - 1 [-]."""

    def __post_init__(self) -> None:
        require_positive("half_gauge", self.half_gauge)
        require_finite("radius_error", self.radius_error)
        if not -self.half_gauge < self.offset < np.inf:
            raise InvalidValueError("offset", self.offset, f"finite and > -half_gauge = {-self.half_gauge}")
        if self.radius_error <= -1:
            raise InvalidValueError("radius_error", self.radius_error, "> -1")

    def __call__(self, kappa: ArrayLike) -> Array:
        """Slips (..., 2) at curvatures (...)."""
        direction = np.arctan(np.asarray(kappa, float))[..., None]  # so that infinite curvature is a number
        along, turning = np.cos(direction), np.sin(direction)
        real = along + SIDES * self.half_gauge * turning
        commanded = along + SIDES * (self.half_gauge + self.offset) * turning
        with np.errstate(divide="ignore"):
            return 1 - (1 + self.radius_error) * real / commanded

    def sprocket_speeds(self, twist: ArrayLike, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (..., 2) [rad/s] that drive a twist (..., 2): regular at every radius."""
        twist = np.asarray(twist, float)
        surface = twist[..., :1] + SIDES * (self.half_gauge + self.offset) * twist[..., 1:]
        return surface / (geometry.sprocket_radius * (1 + self.radius_error))


PUBLISHED = Exponential(alpha_outer=0.07, beta_outer=-0.68, alpha_inner=-0.15, beta_inner=-0.63)
"""Eq. 11 of the paper, identified from 25 runs of ResQuake on stone paving."""
