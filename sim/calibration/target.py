"""What a calibration aims at: slips and radii of steady turns, and how far a simulated robot is from them."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import Array, RobotGeometry, limit_sprocket_speeds, sprocket_speeds, track_slip, track_speeds
from trackslip.metrics import rms
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII, SPEEDS
from trackslip.slip.exponential import PUBLISHED

SLIP_SCALE = 0.007
"""Misfit of slips [-] that counts as one: about what the best fit to the published ones leaves over."""
RADIUS_SCALE = 0.07
"""The same for published radii, relative [-]: about 0.05 is left over, and they count half as much as the slips."""
_TOP_SPEED = 0.3  # of the paper's robot: it scales commands beyond it, for both tracks alike [m/s]


class Target(ABC):
    """M steady turns."""

    independent: int
    """Numbers among the residuals that are independent of each other."""
    of_plate: bool = False
    """Whether the twists are those of the simulated robot's plate, seen by the scanner, not those of its tracks."""

    @abstractmethod
    def omega(self, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (M, 2) [rad/s] that a robot of this geometry is given."""

    @abstractmethod
    def residual(self, twist: Array, geometry: RobotGeometry) -> Array:
        """Weighted differences (n,) between steady twists (M, 2) and the target; their squares are summed."""

    @abstractmethod
    def slip_rms(self, twist: Array, geometry: RobotGeometry) -> float:
        """Distance in slip [-]."""

    @abstractmethod
    def radius_rms(self, twist: Array, geometry: RobotGeometry) -> float | None:
        """Distance in radius, relative [-]; None for a target without radii."""


@dataclass(frozen=True)
class TurnTable(Target):
    """Left turns commanded by radius and speed without regard to slip, and what slips and radii were published.

    Slips were measured against the nominal geometry, which is that of whichever robot is to explain them.
    """

    commanded_radius: Array  # (M,) [m]
    speed: Array  # (M,) [m/s]
    observed_radius: Array  # (M,) [m]
    slip: Array  # (M, 2) of the left, inner, and the right, outer track [-]
    independent: int
    """Numbers among the residuals that are independent of each other."""
    radius_scale: float = RADIUS_SCALE
    """Weight of the radii: infinite for slips alone."""

    @classmethod
    def published(cls) -> TurnTable:
        """The paper's 25 runs: Eq. 11 at the radii it observed. Its slips have no speed: five radii are independent."""
        radius, speed = np.array(list(itertools.product(COMMANDED_RADII, SPEEDS))).T
        observed = np.repeat(OBSERVED_RADII, len(SPEEDS))
        return cls(radius, speed, observed, PUBLISHED(1 / observed), 3 * len(COMMANDED_RADII))

    def omega(self, geometry: RobotGeometry) -> Array:
        """Those of the kinematics without slip."""
        twist = np.stack([self.speed, self.speed / self.commanded_radius], axis=-1)
        return limit_sprocket_speeds(sprocket_speeds(twist, 0.0, geometry), _TOP_SPEED / geometry.sprocket_radius)

    def residual(self, twist: Array, geometry: RobotGeometry) -> Array:
        """Slips and logarithms of radii, each over its scale."""
        slip = (self._slip(twist, geometry) - self.slip) / SLIP_SCALE
        radius = np.log(twist[:, 0] / twist[:, 1] / self.observed_radius) / self.radius_scale
        alike = slip.size + radius.size
        return np.concatenate([slip.ravel(), radius]) * np.sqrt(self.independent / alike)

    def slip_rms(self, twist: Array, geometry: RobotGeometry) -> float:
        """Of both tracks."""
        return rms(self._slip(twist, geometry) - self.slip)

    def radius_rms(self, twist: Array, geometry: RobotGeometry) -> float | None:
        """Of all turns."""
        return rms(twist[:, 0] / twist[:, 1] / self.observed_radius - 1)

    def _slip(self, twist: Array, geometry: RobotGeometry) -> Array:
        return track_slip(self.omega(geometry), twist, geometry)


@dataclass(frozen=True)
class MeasuredTurns(Target):
    """Steady samples of a robot: sprocket speeds and twists."""

    samples: SlipSamples
    geometry: RobotGeometry
    """With which slip is reckoned, whatever the geometry of the robot that is to explain it."""
    of_plate: bool = False
    """See Target."""

    @property
    def independent(self) -> int:  # type: ignore[override]
        """Two numbers a sample."""
        return int(self.samples.omega.size)

    def omega(self, geometry: RobotGeometry) -> Array:
        """Those that were measured."""
        return self.samples.omega

    def residual(self, twist: Array, geometry: RobotGeometry) -> Array:
        """Speeds of the tracks relative to the faster one: its slip, and no pole where the slower one stands."""
        difference = track_speeds(twist - self.samples.twist, self.geometry.half_gauge)
        fastest = np.abs(self.samples.omega).max(axis=1, keepdims=True) * self.geometry.sprocket_radius
        return (difference / fastest / SLIP_SCALE).ravel()

    def slip_rms(self, twist: Array, geometry: RobotGeometry) -> float:
        """Of both tracks."""
        return rms(track_slip(self.samples.omega, twist, self.geometry) - self.samples.slip)

    def radius_rms(self, twist: Array, geometry: RobotGeometry) -> float | None:
        """Of the turns that are no straight lines."""
        w, measured = twist[:, 1], self.samples.twist[:, 1]
        turning = np.abs(measured) > 0.01 * np.abs(self.samples.omega).max(axis=1)
        turning &= self.samples.twist[:, 0] != 0
        if not turning.any():
            return None
        radius = twist[turning, 0] / w[turning]
        return rms(radius / (self.samples.twist[turning, 0] / measured[turning]) - 1)
