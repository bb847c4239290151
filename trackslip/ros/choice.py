"""Choice of the encoders, poses and scans to take from a bag."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from trackslip.errors import InvalidValueError, require, require_at_most, require_positive
from trackslip.kinematics import RobotGeometry
from trackslip.localization.scan import Plate

SIDES = ("left", "right")
_TOPIC = re.compile(r"(?:~?/)?[A-Za-z_]\w*(?:/[A-Za-z_]\w*)*", re.ASCII)
_TF = "tf:FRAME:FRAME, as in tf:map:base_link"


def require_topic(name: str, field: str = "topic") -> None:
    """Raise InvalidValueError unless a topic may have this name: https://design.ros2.org/articles/topic_and_service_names.html."""
    require(_TOPIC.fullmatch(name), field, name, "names of letters, digits and _, joined by /, as in /cmd_vel")


@dataclass(frozen=True)
class BagChoice:
    """Topics and joints of a bag; None where the bag leaves no doubt."""

    encoders: str | None = None
    """Topic of `sensor_msgs/JointState` with the wheels or sprockets, or of `nav_msgs/Odometry` computed from them.

    Several of `sensor_msgs/JointState`, separated by commas, where each has some of the joints.
    """
    left: tuple[str, ...] | None = None
    """Names of the joints on the left; the mean of their speeds is used."""
    right: tuple[str, ...] | None = None
    """Names of the joints on the right; likewise."""
    reversed: str | None = None
    """Side whose encoders count backwards: left, right, both or none; None to find out."""
    poses: str | None = None
    """Topic of poses, or tf:PARENT:CHILD for the pose of a frame in another."""
    imu: str | None = None
    """Topic of `sensor_msgs/Imu` whose gyro to take; none for no gyro."""
    scan: str | None = None
    """Topic of `sensor_msgs/LaserScan` of a stationary scanner, in which to find the plate."""
    plate: Plate | None = None
    """The plate on the robot. With it, poses are the plate's in the scans, and `poses` locate the scanner."""
    mount: tuple[float, float, float] | None = None
    """Pose of the scanner in the frame of the poses [m, m, rad]."""
    noise: float | None = None
    """Standard deviation of a range [m]; None to estimate it from the ranges to the background."""

    max_expanded: float | None = None
    """Largest size of a file's content once decompressed [MB]; None for 268 MB and 100 times the file's size."""
    wheels: RobotGeometry | None = None
    """The geometry by which odometry was computed from the wheels, to compute their speeds from it."""
    dead_reckoned: bool | None = None
    """True to take poses that repeat the dead reckoning of the wheels, too: to look at them, not to identify slip."""

    def __post_init__(self) -> None:
        for name in SIDES:
            joints = getattr(self, name)
            require(joints is None or (joints and all(joints)), name, joints, "names of joints")
        if (self.left is None) != (self.right is None):
            missing = SIDES[self.left is not None]
            raise InvalidValueError(missing, None, f"given where {SIDES[self.left is None]} is")
        if self.left is not None and self.right is not None and (both := set(self.left) & set(self.right)):
            raise InvalidValueError("right", min(both), "the name of a joint that is not on the left, too")
        require(self.reversed in (None, *SIDES, "both", "none"), "reversed", self.reversed, "left, right, both or none")
        if self.plate is None:
            for name in ("scan", "mount", "noise"):
                require(getattr(self, name) is None, name, getattr(self, name), "left out without plate")
        for name in ("noise", "max_expanded"):
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
        if self.noise is not None:
            require_at_most("noise", self.noise, 10.0, "m")
        if self.mount is not None:
            fits = len(self.mount) == 3 and all(map(math.isfinite, self.mount))
            require(fits, "mount", self.mount, "three finite numbers: x, y [m] and yaw [rad]")
            require(self.poses is None, "mount", self.mount, "left out where poses tell where the scanner stands")
        if self.poses is not None and self.poses.startswith("tf:"):
            parts = self.poses.split(":")
            require(len(parts) == 3 and all(parts) and parts[1] != parts[2], "poses", self.poses, _TF)


AUTOMATIC = BagChoice()
"""The topics and joints that leave no doubt."""
