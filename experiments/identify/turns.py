"""Steady turns: slips of the inner and outer track with standard errors, and slips according to
laws.
"""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import TRACK_SIGNS, Array, RobotGeometry
from trackslip.laws.base import SlipLaw

TRACKS: Final = ("inner", "outer")
"""Order of the tracks on the last axis, here and in the figures."""
_STRAIGHT: Final = 20.0  # radius from which a run counts as straight [m]


@dataclass(frozen=True)
class Turns:
    """Steady turns, with slips by inner and outer track.

    Runs without an inner track (straight ones) or with undefined slip (because a sprocket stands
    still) are left out.
    """

    twist: Array  # (n, 2) [m/s, rad/s]
    radius: Array  # (n,) of the observed path [m], >= 0
    left: np.ndarray  # (n,) bool, True for left turns, whose inner track is the left track
    slip: Array  # (n, 2) of the inner and outer track [-]
    # (n,) standard errors of measurement [m]; None where the samples have none
    radius_error: Array | None
    # (n, 2) standard errors of measurement [-]; None where the samples have none
    slip_error: Array | None

    @classmethod
    def of(cls, samples: SlipSamples, geometry: RobotGeometry) -> Self:
        """The turns among samples; the inner track is the left track for positive curvature, else
        the right track.
        """
        is_turn = np.abs(samples.radius) < _STRAIGHT
        is_known = np.isfinite(samples.slip).all(axis=1)
        turning = samples.take(is_turn & is_known)
        left = turning.curvature > 0
        radius_error, slip_error = _errors(turning, left, geometry)
        return cls(
            twist=turning.twist,
            radius=np.abs(turning.radius),
            left=left,
            slip=_inner_outer(turning.slip, left),
            radius_error=radius_error,
            slip_error=slip_error,
        )

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def speed(self) -> Array:
        """Absolute speeds (n,) [m/s]."""
        return np.abs(self.twist[:, 0])

    def curves(self, law: SlipLaw, radius: Array) -> list[Array]:
        """Slips (m, 2) of the inner and outer track at radii (m,) [m] > 0 and the median speed.

        One curve if left and right turns have the same slip, otherwise one for each side that was
        driven.
        """
        speed = float(np.median(self.speed)) or 1.0
        sides = [side for side in (True, False) if (self.left == side).any()]
        curves = [slip_at(law, radius, speed, left=side) for side in sides]
        return curves[:1] if np.allclose(curves[0], curves[-1], equal_nan=True) else curves


def slip_at(law: SlipLaw, radius: Array, speed: float, *, left: bool = True) -> Array:
    """Slips (m, 2) of the inner and outer track at radii (m,) [m] > 0 and a speed [m/s], in turns
    to one side.
    """
    side = 1 if left else -1
    slip = law.slip(np.column_stack([np.full(len(radius), speed), side * speed / radius]))
    return slip[:, ::side]


def _inner_outer(values: Array, left: np.ndarray) -> Array:
    """Values (n, 2) for the inner and outer track from values for the left and right track; `left`
    is (n,) bool.
    """
    return np.where(left[:, None], values, values[:, ::-1])


def _errors(
    samples: SlipSamples, left: np.ndarray, geometry: RobotGeometry
) -> tuple[Array | None, Array | None]:
    """Standard errors of the radius (n,) and of both slips (n, 2), propagated linearly from the
    twists' errors.

    The radius is v / w, with the gradient (1 / w, -v / w^2) by (v, w); the slip of a track at s b
    from the middle, with s = -1 or 1, is 1 - (v + s b w) / u, with the belt's speed u, and has the
    gradient -(1, s b) / u. A value with the gradient g has the variance g C g^T.
    """
    covariance = samples.covariance
    if covariance is None:
        return None, None

    def standard_errors(gradient: Array) -> Array:
        """Standard errors (n, k) of values with gradients (n, k, 2) by the twist."""
        variance = np.einsum("nki,nij,nkj->nk", gradient, covariance, gradient)
        return np.sqrt(variance)

    v, w = samples.twist.T
    of_radius = np.stack([1 / w, -v / w**2], axis=-1)  # (n, 2)
    belts = geometry.sprocket_radius * samples.omega
    sideways = TRACK_SIGNS * geometry.half_gauge
    of_slip = -np.stack([1 / belts, sideways / belts], axis=-1)  # (n, 2, 2)
    radius = standard_errors(of_radius[:, None])[:, 0]
    slip = standard_errors(of_slip)
    return radius, _inner_outer(slip, left)
