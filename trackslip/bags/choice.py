"""The choice of encoders, poses and scans in a bag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from trackslip.arguments import checks_arguments
from trackslip.errors import InvalidValueError, require
from trackslip.localization.scan import Plate

SIDES: Final = ("left", "right")
_TF: Final = "tf:FRAME:FRAME, as in tf:map:base_link"


@checks_arguments
@dataclass(frozen=True)
class BagChoice:
    """Topics and joints to read from a bag; None to choose automatically, if the bag is
    unambiguous.
    """

    encoders: str | None = None
    """Topic of `sensor_msgs/JointState` with wheels or sprockets, of `nav_msgs/Odometry` computed
    from encoders, or of any messages with counters, such as `std_msgs/Int32`.

    Several topics that have some joints or counters each are separated by commas.
    """
    left: tuple[str, ...] | None = None
    """Names of the joints, or counters, on the left; the mean of their speeds is used."""
    right: tuple[str, ...] | None = None
    """Names of the joints, or counters, on the right; the mean of their speeds is used."""
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


AUTOMATIC: Final = BagChoice()  # everything is chosen automatically
