"""Turns of given radius: the belt speeds that they take, slips and the tracks' ICRs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array
from trackslip.skid_theory.contact import Contact, Load
from trackslip.skid_theory.steady import steady_twist

_ITERATIONS = 60
_TOLERANCE = 1e-7  # relative
_UNLOADED = Load()


@dataclass(frozen=True)
class Turns:
    """M steady turns to the left, one for each radius."""

    radius: Array  # (M,) driven [m]
    belts: Array  # (M, 2) speeds of the belts, in units of the yaw rate [m]
    half_gauge: float
    """Half the distance between the tracks [m]."""

    @property
    def slip(self) -> Array:
        """Slips (M, 2) of the (left, right) tracks, i = 1 - V / r omega [-]."""
        tracks = self.radius[:, None] + self.half_gauge * np.array([-1.0, 1.0])
        return 1 - tracks / self.belts

    @property
    def icr(self) -> Array:
        """Places (M, 2) of the ICRs of the (left, right) tracks, to the left of the robot's middle [m]."""
        return self.radius[:, None] - self.belts

    @property
    def offset(self) -> Array:
        """D (M,), by which the ICRs lie farther out than the tracks, the mean of both [m]."""
        return (self.belts[:, 1] - self.belts[:, 0]) / 2 - self.half_gauge

    @property
    def loss(self) -> Array:
        """Part (M,) of the belts' mean speed that the robot lacks [-]."""
        return 1 - self.radius / self.belts.mean(axis=1)


def steady_turns(radius: ArrayLike, contact: Contact, shear: float = 0.0, load: Load = _UNLOADED) -> Turns:
    """The turns to the left of radii (M,) driven [m]; arguments as for `steady_twist`.

    Raises InvalidValueError for a load that the ground does not carry, and a radius that no speeds of the belts drive.
    """
    radius = np.asarray(radius, float)
    half_gauge = float(np.abs(contact.y).mean())
    mean, spread = radius.copy(), np.full(radius.shape, half_gauge)
    for _ in range(_ITERATIONS):
        belts = np.stack([mean - spread, mean + spread], axis=-1)
        v, _, w = steady_twist(belts, contact, shear=shear, load=load).T
        if not ((v > 0) & (w > 0)).all():
            break
        new_mean, new_spread = mean / v * radius, spread / w
        done = max(np.abs(new_mean / mean - 1).max(), np.abs(new_spread / spread - 1).max()) < _TOLERANCE
        mean, spread = new_mean, new_spread
        if done:
            return Turns(radius, np.stack([mean - spread, mean + spread], axis=-1), half_gauge)
    raise InvalidValueError("radius", radius.tolist(), "radii that the robot can drive under its load")
