"""The options of `trackslip plan`."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import tyro

from experiments.common.options import Exclusion, Needs, Positive, Whole, Within, default_is
from experiments.simulate.options import Repeatable
from trackslip.errors import InvalidValueError
from trackslip.planning.limits import DriveLimits
from trackslip.ros.choice import require_topic

EXAMPLES = (
    ("the best minute in 3 x 3 m", "trackslip plan --half-gauge 0.168 --sprocket-radius 0.06"),
    ("outdoors, with GNSS", "trackslip plan --half-gauge 0.3 --sprocket-radius 0.1 --area 12x8 --poses gnss"),
    ("where the law is least known", "trackslip plan --after out/identify --duration 30"),
    ("simulated a hundred times", "trackslip plan --after out/identify --drive --repeats 100"),
)


PLAN_FILE = "plan.csv"
BAG_FILE = "cmd_vel.mcap"
_AREA = re.compile(r"(\d+(?:\.\d*)?|\.\d+)x(\d+(?:\.\d*)?|\.\d+)")
_OF_AFTER = default_is("from --after", "FLOAT")


@dataclass(frozen=True)
class Config(Repeatable):
    """Plan the shortest experiment: a drive within limits that determines a slip law as well as possible."""

    half_gauge: Annotated[float | None, Positive(10.0, "m"), _OF_AFTER] = None
    """Half the distance between the tracks [m]."""
    sprocket_radius: Annotated[float | None, Positive(10.0, "m"), _OF_AFTER] = None
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
    """Source of the poses: SLAM, motion capture, GNSS (no headings), or a stationary scanner."""
    law: Literal["icr", "icr_radius", "icr_sides", "turn_loss", "turn_loss_sides", "exponential"] = "icr_radius"
    """Slip law to identify."""
    offset: Annotated[float | None, default_is("from --after, else 0.3 half gauges", "FLOAT")] = None
    """Expected D: distance of the ICRs (instantaneous centres of rotation) outside the tracks [m]."""
    doubt: Annotated[float | None, Within(0, 0.9), default_is("from --after, else 0.15", "FLOAT")] = None
    """Relative error of half gauge + D at which the robot still stays within the area [-]."""
    after: Annotated[Path | None, default_is("none", "FOLDER")] = None
    """Results of identify to go on from: the drive targets what they left uncertain."""
    drive: bool = False
    """Also drive it, and the paper's 25 runs, identify the law from each, and compare the errors."""
    repeats: Annotated[int, Whole(1, 10_000)] = 1
    """Number of trials, each with its own noise; with --motion mujoco, all measure the same drives. Needs --drive."""
    motion: Literal["law", "mujoco"] = "law"
    """Model that moves the robot with --drive: a law with random slip, or the simulated ground."""
    bag: bool = True
    """Also write the commands as a ROS 2 bag to OUT/bags, if the package rosbags is installed."""
    topic: str = "/cmd_vel"
    """Topic of the commands in the bag, such as a controller's: /diff_drive_controller/cmd_vel."""
    pdf: bool = False
    """Also write the figure as PDF."""
    out: Path = Path("out/plan")
    """Folder for the results."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (Needs(("repeats", "motion"), "drive"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("half_gauge", "sprocket_radius"):
            if self.after is None and getattr(self, name) is None:
                raise InvalidValueError(name, None, f"given (--{name.replace('_', '-')} on the command line)")
        require_topic(self.topic)
        self.limits()

    def limits(self) -> DriveLimits:
        """Limits of the drive."""
        sides = _AREA.fullmatch(self.area.strip().lower())
        if sides is None:
            raise InvalidValueError("area", self.area, "length x width in metres, such as 3x3 or 4.5x2")
        area = (float(sides[1]), float(sides[2]))
        return DriveLimits(self.max_speed, self.acceleration, area, self.duration, self.clearance)
