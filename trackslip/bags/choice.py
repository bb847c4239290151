"""The choice of encoders, poses and scans in a bag."""

from __future__ import annotations

from dataclasses import dataclass

from trackslip.errors import InvalidValueError, require
from trackslip.kinematics import RobotGeometry
from trackslip.localization.scan import Plate

SIDES = ("left", "right")
_TF = "tf:FRAME:FRAME, as in tf:map:base_link"


@dataclass(frozen=True)
class BagChoice:
    """Topics and joints to read from a bag; None to choose automatically, if the bag is
    unambiguous.
    """

    encoders: str | None = None
    """Topic of `sensor_msgs/JointState` with wheels or sprockets, or of `nav_msgs/Odometry`
    computed from encoders.

    If several topics of `sensor_msgs/JointState` have some joints each, they are separated by
    commas.
    """
    left: tuple[str, ...] | None = None
    """Names of the joints on the left; the mean of their speeds is used."""
    right: tuple[str, ...] | None = None
    """Names of the joints on the right; the mean of their speeds is used."""
    reversed: str | None = None
    """Side whose encoders count backwards: left, right or both."""
    poses: str | None = None
    """Topic of poses, or tf:PARENT:CHILD for the pose of frame CHILD in frame PARENT."""
    imu: str | None = None
    """Topic of `sensor_msgs/Imu` with the gyro to use; "none" for no gyro."""
    scan: str | None = None
    """Topic of `sensor_msgs/LaserScan` from a stationary scanner that sees the plate."""
    plate: Plate | None = None
    """Plate on the robot. If given, poses are the plate's poses in the scans."""
    wheels: RobotGeometry | None = None
    """Geometry with which the odometry was computed; needed to compute wheel speeds from
    odometry.
    """
    dead_reckoned: bool | None = None
    """True to accept poses that repeat the wheels' dead reckoning: for viewing, not for
    identification.
    """

    def __post_init__(self) -> None:
        for name in SIDES:
            joints = getattr(self, name)
            require(joints is None or (joints and all(joints)), name, joints, "names of joints")
        if (self.left is None) != (self.right is None):
            missing = SIDES[self.left is not None]
            raise InvalidValueError(missing, None, f"given where {SIDES[self.left is None]} is")
        if (
            self.left is not None
            and self.right is not None
            and (both := set(self.left) & set(self.right))
        ):
            raise InvalidValueError(
                "right", min(both), "the name of a joint that is not on the left, too"
            )
        require(
            self.reversed in (None, *SIDES, "both"),
            "reversed",
            self.reversed,
            "left, right or both",
        )
        require(
            self.scan is None or self.plate is not None, "scan", self.scan, "left out without plate"
        )
        require(
            self.poses is None or self.plate is None,
            "poses",
            self.poses,
            "left out with plate, which gives poses",
        )
        if self.poses is not None and self.poses.startswith("tf:"):
            parts = self.poses.split(":")
            require(
                len(parts) == 3 and all(parts) and parts[1] != parts[2], "poses", self.poses, _TF
            )


AUTOMATIC = BagChoice()  # everything is chosen automatically
