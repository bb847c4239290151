"""Options of `trackslip plan`."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from experiments.options.checks import refuse_unused, require_between, require_integer, require_positive_up_to
from experiments.options.help import default_is
from experiments.options.world import Repeatable
from trackslip.errors import InvalidValueError, require_finite
from trackslip.planning.limits import DriveLimits

MAX_REPEATS = 10_000
_AREA = re.compile(r"(\d+(?:\.\d*)?|\.\d+)x(\d+(?:\.\d*)?|\.\d+)")
_KNOWN = default_is("that of --after", "FLOAT")
_USUAL = default_is("that of --after, else 0.3 half gauges", "FLOAT")
_DOUBT = default_is("that of --after, else 0.15", "FLOAT")


@dataclass(frozen=True)
class PlanConfig(Repeatable):
    """Plan the shortest experiment: a drive within limits that tells a slip law as well as possible."""

    half_gauge: Annotated[float | None, _KNOWN] = None
    """Half the distance between the tracks [m]."""
    sprocket_radius: Annotated[float | None, _KNOWN] = None
    """Radius of the sprockets [m]."""
    max_speed: float = 0.3
    """Largest speed of a belt [m/s]."""
    acceleration: float = 0.5
    """Largest acceleration of a belt [m/s^2]."""
    area: Annotated[str, tyro.conf.arg(metavar="LENGTHxWIDTH")] = "3x3"
    """Area that the middle of the robot may not leave, in metres."""
    clearance: float = 0.0
    """Distance that the middle of the robot keeps from the area's edge, such as half the robot's diagonal [m]."""
    duration: float = 60.0
    """Length of the drive [s]."""
    poses: Literal["slam", "mocap", "gnss", "scanner"] = "slam"
    """Where the poses will come from: SLAM, motion capture, GNSS (no headings), or a scanner beside the field."""
    law: Literal["icr", "icr_radius", "icr_sides", "turn_loss", "exponential", "power"] = "icr_radius"
    """Slip law that is to be identified."""
    offset: Annotated[float | None, _USUAL] = None
    """D that is expected: distance of the ICRs outside the tracks [m]."""
    doubt: Annotated[float | None, _DOUBT] = None
    """Largest relative error of half gauge + D that the area allows for [-]."""
    after: Annotated[Path | None, default_is("none", "FOLDER")] = None
    """Results of identify to go on from: the drive tells most of what they leave open."""
    drive: bool = False
    """Also drive it, and the paper's 25 runs, identify the law from each, and compare the errors."""
    repeats: int = 1
    """Number of times, with different random numbers; with --motion mujoco, of measurements of the same drives."""
    motion: Literal["law", "mujoco"] = "law"
    """What moves the robot then: a law with random slip, or the simulated ground."""
    bag: bool = True
    """Also write the commands as a ROS 2 bag to OUT/bags, if the package rosbags is installed."""
    pdf: bool = False
    """Also write the figure as PDF."""
    out: Path = Path("out/plan")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive_up_to("half_gauge", self.half_gauge, 10.0, "m")
        require_positive_up_to("sprocket_radius", self.sprocket_radius, 10.0, "m")
        require_integer("repeats", self.repeats, 1, MAX_REPEATS)
        if self.offset is not None:
            require_finite("offset", self.offset)
        if self.doubt is not None:
            require_between("doubt", self.doubt, 0, 0.9)
        for name in ("half_gauge", "sprocket_radius"):
            if self.after is None and getattr(self, name) is None:
                raise InvalidValueError(name, None, f"given (--{name.replace('_', '-')} on the command line)")
        if not self.drive:
            refuse_unused(self, ("repeats", "motion"), "without --drive")
        self.limits()

    def limits(self) -> DriveLimits:
        """What the drive keeps to."""
        sides = _AREA.fullmatch(self.area.strip().lower())
        if sides is None:
            raise InvalidValueError("area", self.area, "length x width in metres, such as 3x3 or 4.5x2")
        area = (float(sides[1]), float(sides[2]))
        return DriveLimits(self.max_speed, self.acceleration, area, self.duration, self.clearance)
