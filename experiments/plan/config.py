"""The options of `trackslip plan`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

import tyro

from experiments.common.options import (
    Excludes,
    Exclusion,
    Needs,
    Positive,
    ResultsOptions,
    Whole,
    Within,
    default_is,
)
from sim.bags.writer import require_topic
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.planning.limits import CORNER_DISTANCE, DriveLimits

EXAMPLES: Final = (
    ("the best minute in 3 x 3 m", "trackslip plan --half-gauge 0.168 --sprocket-radius 0.06"),
    (
        "outdoors, with GNSS",
        "trackslip plan --after out/identify --area 12x8 --poses gnss --out out/far",
    ),
    (
        "where the law is least known",
        "trackslip plan --after out/identify --duration 30 --out out/next",
    ),
)
ESSENTIAL: Final = (
    "half_gauge",
    "sprocket_radius",
    "after",
    "law",
    "max_speed",
    "area",
    "duration",
    "poses",
    "bag",
    "out",
    "overwrite",
)
_OF_AFTER: Final = default_is("from --after", "FLOAT")


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Plan the shortest experiment: a drive within limits that determines a slip law as well as
    possible.
    """

    half_gauge: Annotated[float | None, Positive(10.0, "m"), _OF_AFTER] = None
    """Half the distance between the tracks [m]."""
    sprocket_radius: Annotated[float | None, Positive(10.0, "m"), _OF_AFTER] = None
    """Radius of the sprockets [m]."""
    max_speed: float = 0.3
    """Largest speed of a belt [m/s]."""
    acceleration: float = 0.5
    """Largest acceleration of a belt [m/s^2]."""
    area: Annotated[str, tyro.conf.arg(metavar="LENGTHxWIDTH")] = "3x3"
    """Size of the area that the robot may not leave, in metres."""
    clearance: Annotated[float | None, default_is("2 half gauges", "FLOAT")] = None
    """Distance that the robot's middle keeps from the area's edge, to leave room for its farthest
    corner [m].
    """
    duration: float = 60.0
    """Length of the drive [s]."""
    poses: Literal["slam", "mocap", "gnss", "scanner"] = "slam"
    """Source of the poses: SLAM, motion capture, GNSS (no headings), or a stationary scanner."""
    law: Annotated[
        Literal["icr_radius", "icr_sides", "turn_loss", "turn_loss_sides"] | None,
        default_is("the best of --after, else icr_radius", "NAME"),
    ] = None
    """Slip law to identify."""
    offset: Annotated[float | None, default_is("from --after, else 0.3 half gauges", "FLOAT")] = (
        None
    )
    """Expected D: distance of the ICRs (instantaneous centres of rotation) outside the tracks
    [m].
    """
    doubt: Annotated[
        float | None, Within(0, 0.9), default_is("from --after, else 0.15", "FLOAT")
    ] = None
    """Relative error in half gauge + D up to which the robot still stays within the area [-]."""
    after: Annotated[Path | None, default_is("none", "FOLDER")] = None
    """Results of identify to continue from; the drive targets the parameters that they left
    uncertain.
    """
    seed: Annotated[int, Whole()] = 0
    """Seed for the search."""
    bag: bool = True
    """Also write the commands as a ROS 2 bag to OUT/bags, if the package rosbags is installed."""
    topic: str = "/cmd_vel"
    """Topic of the commands in the bag, such as a controller's: /diff_drive_controller/cmd_vel."""
    pdf: bool = False
    """Also write the figure as PDF."""
    out: Path = Path("out/plan")
    """Folder for the results."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Excludes(("half_gauge", "sprocket_radius"), "after"),
        Needs(("topic",), "bag", (True,)),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        require_topic(self.topic)
        self.limits(self.geometry() if self.after is None else None)

    def geometry(self) -> RobotGeometry:
        """The robot's geometry, which must be given without --after."""
        sizes: dict[str, Any] = {
            "half_gauge": self.half_gauge,
            "sprocket_radius": self.sprocket_radius,
        }
        for name, value in sizes.items():
            if value is None:
                raise InvalidValueError(
                    name, None, f"given (--{name.replace('_', '-')} on the command line)"
                )
        return RobotGeometry(**sizes)

    def limits(self, robot: RobotGeometry | None) -> DriveLimits:
        """Drive limits; clearance defaults to 0 without a robot."""
        try:
            length, width = map(float, self.area.lower().split("x"))
        except ValueError:
            raise InvalidValueError(
                "area", self.area, "length x width in metres, such as 3x3 or 4.5x2"
            ) from None
        clearance = self.clearance
        if clearance is None:
            clearance = 0.0 if robot is None else CORNER_DISTANCE * robot.half_gauge
        return DriveLimits(
            self.max_speed, self.acceleration, (length, width), self.duration, clearance
        )
