"""The options that say what to take from a bag, shared by every command that reads one."""

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from experiments.common.options import default_is
from trackslip.errors import InvalidValueError
from trackslip.localization.scan import Plate
from trackslip.ros.choice import BagChoice

Reversed = Literal["left", "right", "both", "none"]
_CLEAR = "where the bag leaves no doubt"


@dataclass(frozen=True)
class BagOptions:
    """Topics, joints and sensors to take from a bag."""

    encoders: Annotated[str | None, default_is(_CLEAR, "TOPIC")] = None
    """Topics of sensor_msgs/JointState with the wheels, separated by commas, or one of odometry computed from them."""
    left: Annotated[str | None, default_is("by their names", "NAMES")] = None
    """Names of the joints on the left, separated by commas; their mean is used."""
    right: Annotated[str | None, default_is("by their names", "NAMES")] = None
    """The same on the right."""
    reversed: Annotated[
        Literal["left", "right", "both", "none"] | None, default_is("found", "{left,right,both,none}")
    ] = None
    """Encoders that count backwards; none says that the bag's signs are right whatever the motion."""
    poses: Annotated[str | None, default_is(_CLEAR, "TOPIC")] = None
    """Topic of the poses, or tf:PARENT:CHILD for the pose of a frame, as in tf:map:base_link."""
    imu: Annotated[str | None, default_is("found", "TOPIC")] = None
    """Topic of sensor_msgs/Imu whose gyro measures the yaw rate; none to take no gyro."""
    plate: Annotated[str | None, default_is("poses are read", "LENGTHxTHICKNESS")] = None
    """Find a plate of this size on the robot, such as 0.5x0.02, in the scans of a stationary scanner [m]."""
    scan: Annotated[str | None, default_is("the only one", "TOPIC")] = None
    """Topic of sensor_msgs/LaserScan of the stationary scanner; needs --plate."""
    mount: Annotated[tuple[float, float, float] | None, default_is("by transforms, else 0 0 0", "X Y YAW")] = None
    """Pose of the scanner in the frame of the poses; with --plate and --poses, it is found by these [m, m, rad]."""
    noise: Annotated[float | None, default_is("found", "FLOAT")] = None
    """Standard deviation of the scanner's ranges [m]."""
    max_expanded: Annotated[float | None, default_is("268, and 100 times the file", "MB")] = None
    """Largest size of a bag's file once decompressed [MB]."""

    def __post_init__(self) -> None:
        self.choice()

    def choice(self) -> BagChoice:
        """The choice as the readers of bags take it."""
        return BagChoice(
            self.encoders,
            _names("left", self.left),
            _names("right", self.right),
            self.reversed,
            self.poses,
            self.imu,
            self.scan,
            None if self.plate is None else plate_of(self.plate),
            self.mount,
            self.noise,
            max_expanded=self.max_expanded,
        )


Bag = Annotated[BagOptions, tyro.conf.arg(name="")]
"""BagOptions without a prefix on the command line."""


def _names(option: str, given: str | None) -> tuple[str, ...] | None:
    """The names in a list separated by commas."""
    if given is None:
        return None
    names = tuple(name.strip() for name in given.split(","))
    if not all(names):
        raise InvalidValueError(option, given, "names of joints, separated by commas")
    return names


def plate_of(given: str) -> Plate:
    """The plate of a size such as 0.5x0.02; raises InvalidValueError for anything else."""
    try:
        length, thickness = map(float, given.lower().split("x"))
        return Plate(length, thickness)
    except ValueError:
        allowed = "LENGTHxTHICKNESS in m, as in 0.5x0.02, longer than thick"
        raise InvalidValueError("plate", given, allowed) from None
