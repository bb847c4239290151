"""Steady turns: slips of the inner and outer track with standard errors, and slips according to
laws.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import TRACK_SIGNS, Array, RobotGeometry
from trackslip.laws.base import SlipLaw

TRACKS = ("inner", "outer")
"""Order of the tracks on the last axis, here and in the figures."""
_STRAIGHT = 20.0  # radius from which a run counts as straight [m]


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
        turning = samples.take(
            (np.abs(samples.radius) < _STRAIGHT) & np.isfinite(samples.slip).all(axis=1)
        )
        left = turning.curvature > 0
        errors = _errors(turning, left, geometry)
        return cls(
            turning.twist, np.abs(turning.radius), left, _inner_outer(turning.slip, left), *errors
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
    """
    if samples.covariance is None:
        return None, None
    v, w = samples.twist.T
    commanded = geometry.sprocket_radius * samples.omega  # (n, 2)
    # (n, 1, 2) gradient with respect to the twist
    of_radius = np.stack([1 / w, -v / w**2], axis=-1)[:, None]
    # (n, 2, 2)
    of_slip = -np.stack([1 / commanded, TRACK_SIGNS * geometry.half_gauge / commanded], axis=-1)
    radius, slip = (
        np.sqrt(np.einsum("nki,nij,nkj->nk", gradient, samples.covariance, gradient))
        for gradient in (of_radius, of_slip)
    )
    return radius[:, 0], _inner_outer(slip, left)
