"""Steady slip by a track's role in the turn, (inner, outer), with its errors; and slip laws seen the same way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import SIDES, Array, RobotGeometry
from trackslip.slip.base import SlipLaw

ROLES = ("inner", "outer")
_STRAIGHT = 20.0  # radius from which a run counts as straight [m]


@dataclass(frozen=True)
class RoleErrors:
    """Standard errors of measurement, propagated linearly from those of the twists."""

    speed: Array  # (n,) [m/s]
    radius: Array  # (n,) [m]
    slip: Array  # (n, 2) of the inner and outer track [-]


@dataclass(frozen=True)
class RoleSamples:
    """Steady turns, seen from their centres: a straight run has none and isn't here."""

    twist: Array  # (n, 2) [m/s, rad/s]
    radius: Array  # (n,) of the observed path [m], >= 0
    left: np.ndarray  # (n,) bool: the turn's centre is to the left, and so is the inner track
    slip: Array  # (n, 2) of the inner and outer track [-]
    errors: RoleErrors | None
    """None where the samples don't know theirs."""

    @classmethod
    def of(cls, samples: SlipSamples, geometry: RobotGeometry) -> RoleSamples:
        """The left track is the inner one where the curvature is positive, the right one elsewhere."""
        turning = np.abs(samples.radius) < _STRAIGHT
        some = samples.take(turning)
        left = some.curvature > 0
        radius = np.abs(some.radius)
        return cls(some.twist, radius, left, by_role(some.slip, left), _errors(some, left, geometry))

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def speed(self) -> Array:
        """(n,) [m/s], >= 0."""
        return np.abs(self.twist[:, 0])

    def residual(self, law: SlipLaw) -> Array:
        """Measured slip minus the law's at the measured motion, (n, 2) of the inner and outer track [-]."""
        return self.slip - by_role(law.slip(self.twist), self.left)

    def curves(self, law: SlipLaw, radius: Array) -> list[Array]:
        """Slips (m, 2) of the inner and outer track at radii (m,) [m] > 0 and the median speed.

        One curve if the law takes turns to both sides alike, else one for each side that was driven to.
        """
        speed = float(np.median(self.speed)) or 1.0
        sides = [side for side in (True, False) if (self.left == side).any()]
        drawn = [slip_at(law, radius, speed, left=side) for side in sides]
        return drawn[:1] if np.allclose(drawn[0], drawn[-1], equal_nan=True) else drawn


def by_role(values: Array, left: np.ndarray) -> Array:
    """Values (n, 2) of the left and right track as those of the inner and outer one, (n, 2)."""
    return np.where(left[:, None], values, values[:, ::-1])


def slip_at(law: SlipLaw, radius: Array, speed: Array | float, *, left: bool = True) -> Array:
    """Slips (m, 2) of the inner and outer track at radii (m,) [m] > 0 and speeds (m,) [m/s], in turns to one side."""
    side = 1 if left else -1
    speed = np.broadcast_to(speed, np.shape(radius))
    slip = law.slip(np.column_stack([speed, side * speed / radius]))
    return slip[:, ::side]


def _errors(samples: SlipSamples, left: np.ndarray, geometry: RobotGeometry) -> RoleErrors | None:
    if samples.covariance is None:
        return None
    v, w = samples.twist.T
    commanded = geometry.sprocket_radius * samples.omega  # (n, 2)
    of_slip = -np.stack([1 / commanded, SIDES * geometry.half_gauge / commanded], axis=-1)  # (n, 2, 2)
    of_radius = np.column_stack([1 / w, -v / w**2])
    return RoleErrors(
        speed=np.sqrt(samples.covariance[:, 0, 0]),
        radius=_propagated("ni,nij,nj->n", of_radius, samples.covariance),
        slip=by_role(_propagated("nki,nij,nkj->nk", of_slip, samples.covariance), left),
    )


def _propagated(path: str, gradient: Array, covariance: Array) -> Array:
    variance: Array = np.einsum(path, gradient, covariance, gradient)
    return np.sqrt(np.maximum(variance, 0.0))
