"""Options of `trackslip predict`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from experiments.options.checks import refuse_unused, require_between, require_positive_up_to
from experiments.options.help import default_is
from experiments.options.world import MAX_RADIUS, MIN_FRICTION_RATIO, MIN_RADIUS
from sim.drive.drive import MAX_RADIUS_ERROR
from sim.drive.pull import Pull
from sim.ground.ground import MAX_FRICTION, Ground
from trackslip.errors import InvalidValueError
from trackslip.paper import OBSERVED_RADII

_ROBOTS = default_is("the robot's", "FLOAT")


@dataclass(frozen=True)
class PredictConfig:
    """Predict slip from quasi-static theory, without simulating: on Coulomb ground a law, on other ground its slips.

    With --shear, --slope or --pull, slips depend on radius and load; the law is then that of the mean over the radii.
    """

    robot: Annotated[Path | None, default_is("the shipped robot", "FILE")] = None
    """Robot file that supplies the values not given below."""
    half_gauge: Annotated[float | None, _ROBOTS] = None
    """Half the distance between the tracks [m]."""
    contact_length: Annotated[float | None, _ROBOTS] = None
    """Length of a track on the ground [m]."""
    friction_ratio: Annotated[float | None, _ROBOTS] = None
    """Friction across the track over friction along it; without a load, slip depends on no other friction [-]."""
    friction: Annotated[float | None, default_is("the robot's ground's", "FLOAT")] = None
    """Friction coefficient along the track; needs --slope or --pull [-]."""
    shear: Annotated[float | None, default_is("the robot's ground's", "FLOAT")] = None
    """Shear modulus of ground that gives way before it slides, 0 for Coulomb friction [m]."""
    slope: float = 0.0
    """Angle of the ground to the horizontal [rad]."""
    uphill: float = 0.0
    """Direction of uphill as the robot sees it, 0 straight ahead, positive to the left; needs --slope [rad]."""
    pull: float = 0.0
    """Drawbar force, backwards along the robot [N]."""
    pull_height: float = Pull.height
    """Height of the hitch above the ground; needs --pull [m]."""
    com_x: Annotated[float | None, _ROBOTS] = None
    """Centre of mass, forward of the middle of the tracks [m]."""
    sprocket_radius: Annotated[float | None, _ROBOTS] = None
    """Radius of the sprockets, stored with the law; slip does not depend on it [m]."""
    radius_error: float = 0.0
    """Relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    radii: tuple[float, ...] = OBSERVED_RADII
    """Radii driven that the table lists [m]."""
    out: Path = Path("out/predict")
    """Folder for the results."""

    def __post_init__(self) -> None:
        Ground(shear=self.shear or 0.0, slope=self.slope, uphill=self.uphill)
        require_positive_up_to("friction", self.friction, MAX_FRICTION)
        Pull(self.pull, self.pull_height)
        if self.slope == 0:
            refuse_unused(self, ("uphill",), "without --slope")
        if self.pull == 0:
            refuse_unused(self, ("pull_height",), "without --pull")
        if self.slope == 0 and self.pull == 0:
            refuse_unused(self, ("friction",), "without --slope and --pull")
        for name in ("half_gauge", "contact_length", "friction_ratio", "sprocket_radius"):
            require_positive_up_to(name, getattr(self, name), 100.0)
        require_between("radius_error", self.radius_error, -MAX_RADIUS_ERROR, MAX_RADIUS_ERROR)
        if not self.radii:
            raise InvalidValueError("radii", self.radii, "at least one number")
        for radius in self.radii:
            require_positive_up_to("radii", radius, MAX_RADIUS, "m")
            if radius < MIN_RADIUS:
                raise InvalidValueError("radii", radius, f"at least {MIN_RADIUS:g} m")
        if self.friction_ratio is not None and self.friction_ratio < MIN_FRICTION_RATIO:
            raise InvalidValueError("friction_ratio", self.friction_ratio, f"at least {MIN_FRICTION_RATIO:g}")
