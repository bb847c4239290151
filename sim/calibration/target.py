"""Targets of a calibration: slips and radii of steady turns, and the misfit of a simulated robot."""

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
"""Scale of the slip residuals [-]: about the residual of the best fit to the published slips."""
RADIUS_SCALE = 0.07
"""Scale of the relative radius residuals [-]: the best fit leaves about 0.05, and radii count half as much as slips."""
_TOP_SPEED = 0.3  # of the paper's robot, which scales faster commands by the same factor for both tracks [m/s]


class Target(ABC):
    """M steady turns with measured or published slips."""

    independent: int
    """Number of independent residuals."""
    of_plate: bool = False
    """Whether the twists are those of the plate, as the scanner sees them, rather than those of the tracks."""

    @abstractmethod
    def omega(self, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (M, 2) commanded to a robot of this geometry [rad/s]."""

    @abstractmethod
    def residual(self, twist: Array, geometry: RobotGeometry) -> Array:
        """Weighted residuals (n,) of steady twists (M, 2); the sum of their squares is minimized."""

    @abstractmethod
    def slip_rms(self, twist: Array, geometry: RobotGeometry) -> float:
        """RMS error of the slips [-]."""

    @abstractmethod
    def radius_rms(self, twist: Array, geometry: RobotGeometry) -> float | None:
        """RMS relative error of the radii [-]; None for a target without radii."""


@dataclass(frozen=True)
class TurnTable(Target):
    """Left turns, commanded by radius and speed without slip compensation, with published slips and radii.

    The slips refer to the nominal geometry, which is that of the robot being calibrated.
    """

    commanded_radius: Array  # (M,) [m]
    speed: Array  # (M,) [m/s]
    observed_radius: Array  # (M,) [m]
    slip: Array  # (M, 2) of the left, inner, and the right, outer track [-]
    independent: int
    """Number of independent residuals."""
    radius_scale: float = RADIUS_SCALE
    """Scale of the relative radius residuals [-]; infinite to ignore the radii."""

    @classmethod
    def published(cls) -> TurnTable:
        """The paper's 25 runs: Eq. 11 at the observed radii, independent of speed, so that five radii count."""
        radius, speed = np.array(list(itertools.product(COMMANDED_RADII, SPEEDS))).T
        observed = np.repeat(OBSERVED_RADII, len(SPEEDS))
        return cls(radius, speed, observed, PUBLISHED(1 / observed), 3 * len(COMMANDED_RADII))

    def omega(self, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (M, 2) of the kinematics without slip [rad/s]."""
        twist = np.stack([self.speed, self.speed / self.commanded_radius], axis=-1)
        return limit_sprocket_speeds(sprocket_speeds(twist, 0.0, geometry), _TOP_SPEED / geometry.sprocket_radius)

    def residual(self, twist: Array, geometry: RobotGeometry) -> Array:
        """Residuals of slips and of logarithms of radii, each over its scale."""
        slip = (self._slip(twist, geometry) - self.slip) / SLIP_SCALE
        radius = np.log(twist[:, 0] / twist[:, 1] / self.observed_radius) / self.radius_scale
        total = slip.size + radius.size
        return np.concatenate([slip.ravel(), radius]) * np.sqrt(self.independent / total)

    def slip_rms(self, twist: Array, geometry: RobotGeometry) -> float:
        """RMS error of the slips of both tracks [-]."""
        return rms(self._slip(twist, geometry) - self.slip)

    def radius_rms(self, twist: Array, geometry: RobotGeometry) -> float | None:
        """RMS relative error of the radii of all turns [-]."""
        return rms(twist[:, 0] / twist[:, 1] / self.observed_radius - 1)

    def _slip(self, twist: Array, geometry: RobotGeometry) -> Array:
        return track_slip(self.omega(geometry), twist, geometry)


@dataclass(frozen=True)
class MeasuredTurns(Target):
    """Steady samples of a real or simulated robot: sprocket speeds and twists."""

    samples: SlipSamples
    geometry: RobotGeometry
    """Geometry to which the slips refer, whatever that of the robot being calibrated."""
    of_plate: bool = False
    """See Target."""

    @property
    def independent(self) -> int:  # type: ignore[override]
        """Two numbers per sample."""
        return int(self.samples.omega.size)

    def omega(self, geometry: RobotGeometry) -> Array:
        """The measured sprocket speeds (M, 2) [rad/s]."""
        return self.samples.omega

    def residual(self, twist: Array, geometry: RobotGeometry) -> Array:
        """Residuals of the track speeds over that of the faster track: no pole where the slower one is at rest."""
        difference = track_speeds(twist - self.samples.twist, self.geometry.half_gauge)
        fastest = np.abs(self.samples.omega).max(axis=1, keepdims=True) * self.geometry.sprocket_radius
        return (difference / fastest / SLIP_SCALE).ravel()

    def slip_rms(self, twist: Array, geometry: RobotGeometry) -> float:
        """RMS error of the slips of both tracks [-]."""
        return rms(track_slip(self.samples.omega, twist, self.geometry) - self.samples.slip)

    def radius_rms(self, twist: Array, geometry: RobotGeometry) -> float | None:
        """RMS relative error of the radii, without straight runs [-]; None if there are no turns."""
        w, measured = twist[:, 1], self.samples.twist[:, 1]
        turning = np.abs(measured) > 0.01 * np.abs(self.samples.omega).max(axis=1)
        turning &= self.samples.twist[:, 0] != 0
        if not turning.any():
            return None
        radius = twist[turning, 0] / w[turning]
        return rms(radius / (self.samples.twist[turning, 0] / measured[turning]) - 1)
