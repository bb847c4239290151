"""Options of `trackslip predict`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from experiments.options.checks import require_between, require_positive_up_to
from experiments.options.help import default_is
from experiments.options.world import MAX_RADIUS, MIN_FRICTION_RATIO, MIN_RADIUS
from sim.drive.drive import MAX_RADIUS_ERROR
from trackslip.errors import InvalidValueError
from trackslip.paper import OBSERVED_RADII

_ROBOTS = default_is("the robot's", "FLOAT")


@dataclass(frozen=True)
class PredictConfig:
    """Predict a slip law from quasi-static Coulomb theory, without simulating."""

    robot: Annotated[Path | None, default_is("the shipped robot", "FILE")] = None
    """Robot file that supplies the values not given below."""
    half_gauge: Annotated[float | None, _ROBOTS] = None
    """Half the distance between the tracks [m]."""
    contact_length: Annotated[float | None, _ROBOTS] = None
    """Length of a track on the ground [m]."""
    friction_ratio: Annotated[float | None, _ROBOTS] = None
    """Friction across the track over friction along it; slip depends on nothing else of the ground [-]."""
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
