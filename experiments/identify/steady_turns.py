"""Steady turns: slip of inner and outer track with standard errors, laws in the same terms, groups of equal turns."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import SIDES, Array, RobotGeometry
from trackslip.slip.base import SlipLaw

TRACKS = ("inner", "outer")
"""Order of the tracks on the last axis, here and in the figures."""
_STRAIGHT = 20.0  # radius from which a run counts as straight [m]
_MAX_GROUPS = 8
_PARTS = 5  # parts that scattered values are split into
_MIN_SCATTERED = 3  # scattered values per part
_GAP = 0.08  # relative gap between neighbouring values that starts another group


@dataclass(frozen=True)
class StandardErrors:
    """Standard errors of measurement, propagated linearly from the twists' errors."""

    speed: Array  # (n,) [m/s]
    radius: Array  # (n,) [m]
    slip: Array  # (n, 2) of the inner and outer track [-]


@dataclass(frozen=True)
class InnerOuterSamples:
    """Steady turns by inner and outer track. Straight runs have neither and are left out, as are runs without slip,
    where a sprocket stands still."""

    twist: Array  # (n, 2) [m/s, rad/s]
    radius: Array  # (n,) of the observed path [m], >= 0
    left: np.ndarray  # (n,) bool: a left turn, whose inner track is the left one
    slip: Array  # (n, 2) of the inner and outer track [-]
    errors: StandardErrors | None
    """None where the samples have none."""
    load: Array | None = None  # (n, 2) tractions per unit load, if known [-]

    @classmethod
    def of(cls, samples: SlipSamples, geometry: RobotGeometry) -> Self:
        """The left track is the inner one where the curvature is positive, the right one elsewhere."""
        turning = samples.take((np.abs(samples.radius) < _STRAIGHT) & np.isfinite(samples.slip).all(axis=1))
        left = turning.curvature > 0
        slip = inner_outer(turning.slip, left)
        return cls(turning.twist, np.abs(turning.radius), left, slip, _errors(turning, left, geometry), turning.load)

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def speed(self) -> Array:
        """(n,) [m/s], >= 0."""
        return np.abs(self.twist[:, 0])

    def residual(self, law: SlipLaw) -> Array:
        """Measured slip minus the law's at the measured motion, (n, 2) of the inner and outer track [-]."""
        loaded = law if self.load is None else law.under(self.load)
        return self.slip - inner_outer(loaded.slip(self.twist), self.left)

    def curves(self, law: SlipLaw, radius: Array) -> list[Array]:
        """Slips (m, 2) of the inner and outer track at radii (m,) [m] > 0 and the median speed.

        One curve if left and right turns have the same slip, else one for each side that was driven.
        """
        speed = float(np.median(self.speed)) or 1.0
        sides = [side for side in (True, False) if (self.left == side).any()]
        drawn = [slip_at(law, radius, speed, left=side) for side in sides]
        return drawn[:1] if np.allclose(drawn[0], drawn[-1], equal_nan=True) else drawn


def inner_outer(values: Array, left: np.ndarray) -> Array:
    """Values (n, 2) of the inner and outer track from those of the left and right one; `left` is (n,) bool."""
    return np.where(left[:, None], values, values[:, ::-1])


def slip_at(law: SlipLaw, radius: Array, speed: Array | float, *, left: bool = True) -> Array:
    """Slips (m, 2) of the inner and outer track at radii (m,) [m] > 0 and speeds (m,) [m/s], in turns to one side."""
    side = 1 if left else -1
    speed = np.broadcast_to(speed, np.shape(radius))
    slip = law.slip(np.column_stack([speed, side * speed / radius]))
    return slip[:, ::side]


def _errors(samples: SlipSamples, left: np.ndarray, geometry: RobotGeometry) -> StandardErrors | None:
    if samples.covariance is None:
        return None
    v, w = samples.twist.T
    commanded = geometry.sprocket_radius * samples.omega  # (n, 2)
    of_slip = -np.stack([1 / commanded, SIDES * geometry.half_gauge / commanded], axis=-1)  # (n, 2, 2)
    of_radius = np.column_stack([1 / w, -v / w**2])
    return StandardErrors(
        speed=np.sqrt(samples.covariance[:, 0, 0]),
        radius=_propagated("ni,nij,nj->n", of_radius, samples.covariance),
        slip=inner_outer(_propagated("nki,nij,nkj->nk", of_slip, samples.covariance), left),
    )


def _propagated(subscripts: str, gradient: Array, covariance: Array) -> Array:
    variance: Array = np.einsum(subscripts, gradient, covariance, gradient)
    return np.sqrt(np.maximum(variance, 0.0))


def value_groups(values: Array) -> list[np.ndarray]:
    """Indices of `values` (n,) >= 0 in groups of nearly equal values, ascending.

    A grid of commanded values leaves clear gaps between its groups, so that no log has to state what was commanded.
    Values that are scattered, or that form many groups, are split into a few parts of about equal size.
    """
    order = np.argsort(values, kind="stable")
    if not order.size:
        return []
    ranked = values[order]
    starts = np.flatnonzero(np.diff(ranked) > _GAP * ranked[1:]) + 1
    groups = np.split(order, starts)
    if len(groups) <= _MAX_GROUPS and all(is_narrow(values[group]) for group in groups):
        return groups
    return np.array_split(order, max(1, min(_PARTS, order.size // _MIN_SCATTERED)))


def is_narrow(values: Array) -> bool:
    """True if values (n,) >= 0 are nearly equal."""
    return bool(np.ptp(values) <= 2 * _GAP * values.max())


def repeated(values: Array) -> list[np.ndarray]:
    """The groups of two or more nearly equal values; none if all values form one group."""
    groups = value_groups(values)
    return [group for group in groups if len(group) > 1 and is_narrow(values[group])] if len(groups) > 1 else []


def group_label(values: Array, unit: str) -> str:
    """The mean of values that are nearly equal, else their range, with the unit."""
    if is_narrow(values):
        return f"{values.mean():.2f} {unit}"
    return f"{values.min():.2f}–{values.max():.2f} {unit}"
