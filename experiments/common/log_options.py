"""Options for commands that read logs: what to read from a table or a bag, and where the pose
sensor is mounted.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import tyro

from experiments.common.options import Bound, Positive, Within, default_is
from trackslip.bags.choice import BagChoice
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.localization.scan import Plate
from trackslip.logs.layout import TICKS_PER_TURN, Layout
from trackslip.memory import parse_size

MAX_CLOCK_OFFSET: Final = 0.5
"""Largest difference allowed between encoder clock and pose clock [s]."""
_MAX_LEVER: Final = 100.0  # [m]
_CLEAR: Final = "where the bag leaves no doubt"


@dataclass(frozen=True)
class BagOptions:
    """Topics, joints and sensors to read from a bag."""

    encoders: Annotated[str | None, default_is(_CLEAR, "TOPIC")] = None
    """Topics of sensor_msgs/JointState with the wheels, or of any messages with counters, separated
    by commas, or one topic of wheel odometry.
    """
    left: Annotated[str | None, default_is("by their names", "NAMES")] = None
    """Names of the left joints or counters, separated by commas; their readings are averaged."""
    right: Annotated[str | None, default_is("by their names", "NAMES")] = None
    """Names of the right joints or counters, separated by commas; their readings are averaged."""
    reversed: Annotated[
        Literal["left", "right", "both"] | None, default_is("none", "{left,right,both}")
    ] = None
    """Encoders that count backwards."""
    poses: Annotated[str | None, default_is(_CLEAR, "TOPIC")] = None
    """Topic with the poses, or tf:PARENT:CHILD for a frame's pose, as in tf:map:base_link."""
    imu: Annotated[str | None, default_is("found", "TOPIC")] = None
    """Topic of sensor_msgs/Imu whose gyro measures the yaw rate, or none for no gyro."""
    plate: Annotated[str | None, default_is("poses are read", "LENGTHxTHICKNESS")] = None
    """Find a plate of this size on the robot, such as 0.5x0.02, in scans from a stationary scanner
    [m].
    """
    scan: Annotated[str | None, default_is("the only one", "TOPIC")] = None
    """Topic of sensor_msgs/LaserScan of the stationary scanner; needs --plate."""

    def __post_init__(self) -> None:
        self.choice()

    def choice(self) -> BagChoice:
        """The options in the form that bag readers expect; raises InvalidValueError for a malformed
        option.
        """
        parsed = {
            "left": _names("left", self.left),
            "right": _names("right", self.right),
            "plate": None if self.plate is None else _plate(self.plate),
        }
        return BagChoice(**{**vars(self), **parsed})


Bag = Annotated[BagOptions, tyro.conf.arg(name="")]
"""BagOptions without a prefix on the command line."""


@dataclass(frozen=True)
class LayoutOptions:
    """Names and units of a table's columns, and what encoders and odometry count."""

    columns: Annotated[str | None, default_is("as documented", "NAME=COLUMN[:UNIT],...")] = None
    """Columns of a table that have other names or units, as in
    t=stamp:ms,omega_l=left_rpm:rpm,omega_r=right_rpm:rpm,phi=yaw:deg.
    """
    ticks_per_turn: Annotated[
        float | None, Within(*TICKS_PER_TURN), default_is("none", "FLOAT")
    ] = None
    """Ticks per turn of the encoder, for columns ticks_l and ticks_r, or counters in a bag [-]."""
    odom_half_gauge: Annotated[
        float | None, Positive(100.0, "m"), default_is("the robot's", "FLOAT")
    ] = None
    """Half the distance between the tracks with which odometry in place of encoders was computed
    [m].
    """
    odom_radius: Annotated[
        float | None, Positive(100.0, "m"), default_is("the robot's", "FLOAT")
    ] = None
    """Radius of the sprockets with which odometry in place of encoders was computed [m]."""

    def __post_init__(self) -> None:
        Layout(self.columns)

    def layout(
        self, half_gauge: float | None = None, sprocket_radius: float | None = None
    ) -> Layout:
        """The options in the form that readers expect; raises InvalidValueError if just one of the
        odometry's dimensions is known.

        `half_gauge` and `sprocket_radius` are the robot's [m], if the options state them.
        """
        if self.odom_half_gauge is None and self.odom_radius is None:
            return Layout(self.columns, self.ticks_per_turn)
        assumed_gauge = self.odom_half_gauge or half_gauge
        assumed_radius = self.odom_radius or sprocket_radius
        beside = "given, as the other dimension of the odometry is"
        if assumed_gauge is None:
            raise InvalidValueError("odom_half_gauge", None, beside)
        if assumed_radius is None:
            raise InvalidValueError("odom_radius", None, beside)
        return Layout(
            self.columns, self.ticks_per_turn, RobotGeometry(assumed_gauge, assumed_radius)
        )


TableLayout = Annotated[LayoutOptions, tyro.conf.arg(name="")]
"""LayoutOptions without a prefix on the command line."""


class Size(Bound):
    """Sizes such as 8GB."""

    def check(self, name: str, value: str | None) -> None:
        """Raise InvalidValueError for a text that isn't a size; None is allowed."""
        size_in_bytes(name, value)


MaxMemory = Annotated[str | None, Size(), default_is("half of the machine's", "SIZE")]
"""Most memory for the content of a log, such as 8GB."""


def size_in_bytes(option: str, text: str | None) -> int | None:
    """The number of bytes in a size such as 8GB; None if none is given."""
    return None if text is None else parse_size(option, text)


def _names(option: str, text: str | None) -> tuple[str, ...] | None:
    names = None if text is None else tuple(name.strip() for name in text.split(","))
    if names is not None and not all(names):
        raise InvalidValueError(option, text, "names of joints, separated by commas")
    return names


def _plate(size: str) -> Plate:
    try:
        length, thickness = map(float, size.lower().split("x"))
        return Plate(length, thickness)
    except ValueError:
        allowed = "LENGTHxTHICKNESS in m, as in 0.5x0.02, longer than thick"
        raise InvalidValueError("plate", size, allowed) from None


def check_sensor(
    sensor: tuple[float, float, float] | None, middle: str = "middle of the tracks"
) -> None:
    """Raise InvalidValueError unless a sensor (ahead [m], left [m], yaw [rad]) is near the robot;
    None is valid.
    """
    if sensor is not None:
        for value, where in zip(sensor, ("ahead", "left"), strict=False):
            Within(-_MAX_LEVER, _MAX_LEVER, f"m, {where} of the {middle}").check("sensor", value)
        Within(-math.pi, math.pi, "rad, counter-clockwise").check("sensor", sensor[2])
