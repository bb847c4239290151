"""Targets of a calibration: M steady turns with measured or published slips, and the misfit of a simulated robot."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import Array, RobotGeometry, limit_sprocket_speeds, sprocket_speeds, track_slip, track_speeds
from trackslip.metrics import rms
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII, SPEEDS
from trackslip.slip.exponential import PUBLISHED

SLIP_SCALE = 0.007
"""Scale of the slip residuals [-]: about the residual of the best fit to the published slips."""
_RADIUS_SCALE = (
    0.07  # of the relative radius residuals [-]: the best fit leaves 0.05; radii count half as much as slips
)
_TOP_SPEED = 0.3  # of the paper's robot, which scales faster commands by the same factor for both tracks [m/s]


@dataclass(frozen=True)
class TurnTable:
    """Left turns, commanded by radius and speed without slip compensation, with published slips and radii.

    The slips refer to the nominal geometry of the robot being calibrated.
    """

    commanded_radius: Array  # (M,) [m]
    speed: Array  # (M,) [m/s]
    observed_radius: Array  # (M,) [m]
    slip: Array  # (M, 2) of the left, inner, and the right, outer track [-]
    independent: int
    """Number of independent residuals."""
    radius_scale: float = _RADIUS_SCALE
    """Scale of the relative radius residuals [-]; infinite to ignore the radii."""
    of_plate: ClassVar[bool] = False
    """True if the twists are the plate's, as the scanner sees them, rather than the tracks'."""

    @classmethod
    def published(cls) -> TurnTable:
        """The paper's 25 runs: Eq. 11 at the observed radii, independent of speed, so that five radii count."""
        radius, speed = np.array(list(itertools.product(COMMANDED_RADII, SPEEDS))).T
        observed = np.repeat(OBSERVED_RADII, len(SPEEDS))
        return cls(radius, speed, observed, PUBLISHED(1 / observed), 3 * len(COMMANDED_RADII))

    def omega(self, geometry: RobotGeometry) -> Array:
        """Sprocket speeds (M, 2) commanded to a robot of this geometry, without slip compensation [rad/s]."""
        twist = np.stack([self.speed, self.speed / self.commanded_radius], axis=-1)
        return limit_sprocket_speeds(sprocket_speeds(twist, 0.0, geometry), _TOP_SPEED / geometry.sprocket_radius)

    def residual(self, twist: Array, geometry: RobotGeometry) -> Array:
        """Residuals (n,) of steady twists (M, 2): of slips and of logarithms of radii, each over its scale."""
        slip = (self._slip(twist, geometry) - self.slip) / SLIP_SCALE
        radius = np.log(twist[:, 0] / twist[:, 1] / self.observed_radius) / self.radius_scale
        return np.concatenate([slip.ravel(), radius]) * np.sqrt(self.independent / (slip.size + radius.size))

    def slip_rms(self, twist: Array, geometry: RobotGeometry) -> float:
        """RMS error of the slips of both tracks [-]."""
        return rms(self._slip(twist, geometry) - self.slip)

    def radius_rms(self, twist: Array) -> float:
        """RMS relative error of the radii of all turns [-]."""
        return rms(twist[:, 0] / twist[:, 1] / self.observed_radius - 1)

    def _slip(self, twist: Array, geometry: RobotGeometry) -> Array:
        return track_slip(self.omega(geometry), twist, geometry)


@dataclass(frozen=True)
class MeasuredTurns:
    """Steady samples of a real or simulated robot: sprocket speeds and twists."""

    samples: SlipSamples
    geometry: RobotGeometry
    """Geometry that defines the slips, whatever the calibrated robot's."""
    of_plate: bool = False
    """True if the twists are the plate's, as the scanner sees them, rather than the tracks'."""

    @property
    def independent(self) -> int:
        """Number of independent residuals: two per sample."""
        return int(self.samples.omega.size)

    def omega(self, geometry: RobotGeometry) -> Array:
        """The measured sprocket speeds (M, 2) [rad/s]."""
        return self.samples.omega

    def residual(self, twist: Array, geometry: RobotGeometry) -> Array:
        """Residuals (n,) of the track speeds over the faster track's, which has no pole where the slower one rests."""
        difference = track_speeds(twist - self.samples.twist, self.geometry.half_gauge)
        fastest = np.abs(self.samples.omega).max(axis=1, keepdims=True) * self.geometry.sprocket_radius
        return (difference / fastest / SLIP_SCALE).ravel()

    def slip_rms(self, twist: Array, geometry: RobotGeometry) -> float:
        """RMS error of the slips of both tracks, except where a sprocket rests [-]."""
        error = track_slip(self.samples.omega, twist, self.geometry) - self.samples.slip
        return rms(error[~np.isnan(error)])

    def radius_rms(self, twist: Array) -> float | None:
        """RMS relative error of the radii, without straight runs [-]; None if there are no turns."""
        v, w = self.samples.twist.T
        turning = (np.abs(w) > 0.01 * np.abs(self.samples.omega).max(axis=1)) & (v != 0)
        if not turning.any():
            return None
        radius = twist[turning, 0] / twist[turning, 1]
        return rms(radius / (v[turning] / w[turning]) - 1)


Target = TurnTable | MeasuredTurns
"""A target of a calibration. The sum of the squares of its weighted residuals is minimized."""
