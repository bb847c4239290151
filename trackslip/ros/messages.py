"""Messages of ROS 2 made from arrays, a topic at a time."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackslip.kinematics import Array
from trackslip.localization.scan import Scan
from trackslip.ros.decode import require_rosbags

Stamps = NDArray[np.int64]
"""Times (M,) since 1970 [ns]."""
_ROW, _COLUMN = np.ix_((0, 1, 5), (0, 1, 5))  # x, y, yaw among x, y, z, roll, pitch, yaw


@dataclass(frozen=True)
class Topic:
    """Messages of one type."""

    name: str
    kind: str
    """Their type, as sensor_msgs/msg/LaserScan."""
    stamps: Stamps  # (M,) of their headers, ascending [ns]
    messages: Iterator[Any]
    """The M messages."""
    latched: bool = False
    """Whether subscribers that come later receive the last one, too."""


@functools.cache
def definitions() -> Any:
    """The store of message types; raises TrackslipError where rosbags is missing."""
    require_rosbags()
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


class Messages:
    """Messages of ROS 2 Jazzy; other releases since Foxy define them alike.

    All motion is in the plane: poses (M, 3) are x, y [m], yaw [rad]. Covariances (3, 3) or (M, 3, 3) of these become
    ROS's (6, 6) with zeros for the rest.
    """

    def __init__(self) -> None:
        """Load the definitions; raises TrackslipError where rosbags is missing."""
        self._types: Any = definitions().types

    def joint_states(self, name: str, stamps: Stamps, joints: Sequence[str], position: Array, velocity: Array) -> Topic:
        """sensor_msgs/JointState: angles (M, J) [rad] and speeds (M, J) [rad/s] of J joints."""
        kind, effort = "sensor_msgs/msg/JointState", np.empty(0)

        def messages() -> Iterator[Any]:
            for header, angle, speed in zip(self._headers(stamps, ""), position, velocity, strict=True):
                yield self._new(kind, header, list(joints), angle, speed, effort)

        return Topic(name, kind, stamps, messages())

    def odometry(
        self,
        name: str,
        stamps: Stamps,
        frames: tuple[str, str],
        pose: Array,
        pose_covariance: Array,
        twist: Array,
        twist_covariance: Array,
    ) -> Topic:
        """nav_msgs/Odometry of `frames` (fixed, moving).

        Twists (M, 3) are forward and lateral speed to the left [m/s] and yaw rate [rad/s].
        """
        kind, (fixed, moving) = "nav_msgs/msg/Odometry", frames
        covariances = _six(pose_covariance, len(stamps)), _six(twist_covariance, len(stamps))

        def messages() -> Iterator[Any]:
            headers, poses, twists = self._headers(stamps, fixed), self._poses(pose), self._twists(twist)
            for header, at, by, c_at, c_by in zip(headers, poses, twists, *covariances, strict=True):
                with_error = self._new("geometry_msgs/msg/PoseWithCovariance", at, c_at)
                moved = self._new("geometry_msgs/msg/TwistWithCovariance", by, c_by)
                yield self._new(kind, header, moving, with_error, moved)

        return Topic(name, kind, stamps, messages())

    def poses(self, name: str, stamps: Stamps, frame: str, pose: Array) -> Topic:
        """geometry_msgs/PoseStamped."""
        kind = "geometry_msgs/msg/PoseStamped"
        pairs = zip(self._headers(stamps, frame), self._poses(pose), strict=True)
        return Topic(name, kind, stamps, (self._new(kind, header, at) for header, at in pairs))

    def poses_with_covariance(self, name: str, stamps: Stamps, frame: str, pose: Array, covariance: Array) -> Topic:
        """geometry_msgs/PoseWithCovarianceStamped."""
        kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
        rows = zip(self._headers(stamps, frame), self._poses(pose), _six(covariance, len(stamps)), strict=True)
        return Topic(
            name,
            kind,
            stamps,
            (self._new(kind, head, self._new("geometry_msgs/msg/PoseWithCovariance", at, c)) for head, at, c in rows),
        )

    def fixes(self, name: str, stamps: Stamps, frame: str, geodetic: Array, covariance: Array) -> Topic:
        """sensor_msgs/NavSatFix: latitude [deg], longitude [deg] and height [m] (M, 3).

        The covariance is that of east, north and up, (3, 3) or (M, 3, 3) [m^2]; all zero says that it is not known.
        """
        kind = "sensor_msgs/msg/NavSatFix"
        status = self._new("sensor_msgs/msg/NavSatStatus", 2, 1)  # a fix with a ground station, by GPS
        known = 3 if np.any(covariance) else 0
        errors = np.broadcast_to(covariance, (len(stamps), 3, 3)).reshape(-1, 9)

        def messages() -> Iterator[Any]:
            for header, place, error in zip(self._headers(stamps, frame), geodetic.tolist(), errors, strict=True):
                yield self._new(kind, header, status, *place, error, known)

        return Topic(name, kind, stamps, messages())

    def twists(self, name: str, stamps: Stamps, frame: str, twist: Array) -> Topic:
        """geometry_msgs/TwistStamped; twists (M, 3) as for `odometry`."""
        kind = "geometry_msgs/msg/TwistStamped"
        pairs = zip(self._headers(stamps, frame), self._twists(twist), strict=True)
        return Topic(name, kind, stamps, (self._new(kind, header, by) for header, by in pairs))

    def transforms(
        self, name: str, stamps: Stamps, frames: tuple[str, str], pose: Array, latched: bool = False
    ) -> Topic:
        """tf2_msgs/TFMessage with one transform each: the pose of the second of `frames` in the first."""
        kind, (parent, child) = "tf2_msgs/msg/TFMessage", frames

        def messages() -> Iterator[Any]:
            for header, at in zip(self._headers(stamps, parent), self._poses(pose), strict=True):
                way = self._new("geometry_msgs/msg/Vector3", at.position.x, at.position.y, 0.0)
                moved = self._new("geometry_msgs/msg/Transform", way, at.orientation)
                yield self._new(kind, [self._new("geometry_msgs/msg/TransformStamped", header, child, moved)])

        return Topic(name, kind, stamps, messages(), latched)

    def scans(self, name: str, stamps: Stamps, frame: str, scan: Scan, duration: float, period: float) -> Topic:
        """sensor_msgs/LaserScan: scans with ranges (M, B), infinite where nothing came back (REP 117).

        The stamps are those of the first beams; `duration` is the time to the last one, `period` that between scans
        [s].
        """
        kind, bearings = "sensor_msgs/msg/LaserScan", scan.bearings
        about = (
            *(float(bearings[0]), float(bearings[-1]), scan.beam_step),
            *(duration / (len(bearings) - 1), period, 0.0, float(scan.max_range)),
        )
        ranges = np.where(np.isnan(scan.ranges), np.inf, scan.ranges).astype(np.float32)
        intensities = np.empty(0, np.float32)
        pairs = zip(self._headers(stamps, frame), ranges, strict=True)
        return Topic(name, kind, stamps, (self._new(kind, header, *about, one, intensities) for header, one in pairs))

    def _new(self, kind: str, *values: Any) -> Any:
        """A message of a type."""
        return self._types[kind](*values)

    def _headers(self, stamps: Stamps, frame: str) -> Iterator[Any]:
        for stamp in stamps.tolist():
            yield self._new(
                "std_msgs/msg/Header", self._new("builtin_interfaces/msg/Time", *divmod(stamp, 10**9)), frame
            )

    def _poses(self, pose: Array) -> Iterator[Any]:
        half = pose[:, 2] / 2
        rows = zip(pose[:, :2].tolist(), np.sin(half).tolist(), np.cos(half).tolist(), strict=True)
        for place, sin, cos in rows:
            point = self._new("geometry_msgs/msg/Point", *place, 0.0)
            yield self._new(
                "geometry_msgs/msg/Pose", point, self._new("geometry_msgs/msg/Quaternion", 0.0, 0.0, sin, cos)
            )

    def _twists(self, twist: Array) -> Iterator[Any]:
        for ahead, left, yaw_rate in twist.tolist():
            linear = self._new("geometry_msgs/msg/Vector3", ahead, left, 0.0)
            angular = self._new("geometry_msgs/msg/Vector3", 0.0, 0.0, yaw_rate)
            yield self._new("geometry_msgs/msg/Twist", linear, angular)


def _six(covariance: Array, count: int) -> Array:
    """Covariances (M, 36) of x, y, z, roll, pitch and yaw."""
    full = np.zeros((count, 6, 6))
    full[:, _ROW, _COLUMN] = covariance
    return full.reshape(count, 36)
