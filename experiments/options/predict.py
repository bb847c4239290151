"""Options of `trackslip predict`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from experiments.options.world import (
    MAX_RADIUS,
    MIN_FRICTION_RATIO,
    MIN_RADIUS,
)
from sim.drive.drive import MAX_RADIUS_ERROR
from trackslip.errors import InvalidValueError, require_at_most, require_positive
from trackslip.paper import OBSERVED_RADII


@dataclass(frozen=True)
class PredictConfig:
    """A slip law from quasi-static Coulomb theory, without simulating."""

    robot: Path | None = None
    """A robot file: what isn't given below is taken from it; by default the shipped robot."""
    half_gauge: float | None = None
    """Half the distance between the tracks [m]; by default the robot's."""
    contact_length: float | None = None
    """Length of track on the ground [m]; by default the robot's."""
    friction_ratio: float | None = None
    """Friction across the track over friction along it, all that slip asks of the ground; by default the robot's."""
    com_x: float | None = None
    """Centre of mass, forward of the middle of the tracks [m]; by default the robot's."""
    sprocket_radius: float | None = None
    """Radius of the sprockets [m], stored with the law, slip doesn't depend on it; by default the robot's."""
    radius_error: float = 0.0
    """Relative error of the effective sprocket radius, real / nominal - 1."""
    radii: tuple[float, ...] = OBSERVED_RADII
    """Radii driven, for the table [m]."""
    out: Path = Path("out/predict")
    """Folder for the results."""

    def __post_init__(self) -> None:
        for name in ("half_gauge", "contact_length", "friction_ratio", "sprocket_radius"):
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
                require_at_most(name, getattr(self, name), 100.0)
        if not -MAX_RADIUS_ERROR <= self.radius_error <= MAX_RADIUS_ERROR:
            raise InvalidValueError("radius_error", self.radius_error, "from -0.5 to 0.5")
        if not self.radii:
            raise InvalidValueError("radii", self.radii, "at least one number")
        for radius in self.radii:
            require_positive("radii", radius)
            require_at_most("radii", radius, MAX_RADIUS, "m")
            if radius < MIN_RADIUS:
                raise InvalidValueError("radii", radius, f"at least {MIN_RADIUS:g} m")
        if self.friction_ratio is not None and self.friction_ratio < MIN_FRICTION_RATIO:
            raise InvalidValueError("friction_ratio", self.friction_ratio, f"at least {MIN_FRICTION_RATIO:g}")
