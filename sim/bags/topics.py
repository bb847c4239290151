"""The topics that a robot, its localization and a stationary scanner publish during a run, as ROS 2
messages.

Messages are built from columns of numbers, one topic at a time. They describe motion in the plane:
poses (M, 3) are x, y [m] and yaw [rad]; twists (M, 3) are forward speed, lateral speed to the left
[m/s] and yaw rate [rad/s].
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import repeat
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trackslip import se2
from trackslip.errors import require
from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.localization.scan import Scan
from trackslip.logs.runlog import RunLog

Stamps = NDArray[np.int64]
"""Times (M,) since 1970 [ns]."""
Fields = Mapping[str, Any]
"""Values of fields by name: an array with a row per message, a value for all messages, or nested
fields.

Omitted fields are zero or empty; a field that is an array of messages gets one message, with the
given fields.
"""
_PLANAR: Final = np.ix_((0, 1, 5), (0, 1, 5))  # x, y, yaw among x, y, z, roll, pitch, yaw
JOINTS: Final = ["left_sprocket", "right_sprocket"]
"""Names of the sprocket joints in /joint_states."""
FIELD: Final = (52.0, 10.0, 0.0)
"""Latitude [deg], longitude [deg] and height [m] of the origin of satellite positions, an arbitrary
field.
"""
START: Final = 1_767_225_600
"""Stamp for t = 0, 2026-01-01; a stamp of zero would mean that there is no stamp [s]."""
_SINCE_1970: Final = 1e9  # a log that begins later than this has times since 1970 [s]
_LAST: Final = 2**31 - 1  # largest number of seconds that a stamp can hold
# covariance of x, y [m^2] and yaw [rad^2], and of their rates, common in configurations of
# diff_drive_controller
_WHEEL_COVARIANCE: Final = np.diag([0.001, 0.001, 0.01])
_EXACT: Final = np.zeros((3, 3))
# of sensor_msgs/NavSatFix
_AUGMENTED_FIX: Final = {"status": 2, "service": 1}  # a GPS fix with ground-based augmentation
_COVARIANCE_UNKNOWN: Final = 0
_COVARIANCE_KNOWN: Final = 3


@functools.cache
def definitions() -> Any:
    """Message types of ROS 2 Jazzy; all releases since Foxy define the types written here
    identically.
    """
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@dataclass(frozen=True)
class Publication:
    """A topic to write, with messages of a single type."""

    name: str
    kind: str  # type of the messages, such as `sensor_msgs/msg/LaserScan`
    stamps: Stamps  # (M,) stamps in the messages' headers, ascending [ns]
    fields: Fields
    latched: bool = False  # whether late subscribers receive the last message


def messages(kind: str, fields: Fields) -> Iterator[Any]:
    """Messages of the type `kind` with these fields."""
    known = definitions()
    columns = []
    for name, (node, detail) in known.fielddefs[kind][1]:
        columns.append(_column(node, detail, fields.get(name)))
    return map(known.types[kind], *columns)


def _column(node: int, detail: Any, value: Any) -> Iterator[Any]:
    """The values of a field for each message in turn."""
    from rosbags.interfaces import Nodetype

    if node == Nodetype.NAME:
        return messages(detail, value or {})
    if isinstance(value, np.ndarray):
        return iter(value.tolist() if value.ndim == 1 else value)
    if node == Nodetype.BASE:
        zero = "" if detail[0] == "string" else 0
        return repeat(zero if value is None else value)
    (inner, element), length = detail
    if inner == Nodetype.NAME:
        return ([message] for message in messages(element, value))
    return repeat(np.zeros(length, element[0]) if value is None else value)


def header(stamps: Stamps, frame: str = "") -> Fields:
    """Fields of a std_msgs/Header, with stamps (M,) and a frame."""
    seconds, rest = np.divmod(stamps, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def pose(of: Array, covariance: Array | None = None) -> Fields:
    """Fields of a geometry_msgs/Pose, or of a PoseWithCovariance with a covariance (3, 3) or (M, 3,
    3).
    """
    position = {"x": of[:, 0], "y": of[:, 1]}
    fields = {"position": position, "orientation": _quaternion(of[:, 2])}
    if covariance is None:
        return fields
    return {"pose": fields, "covariance": _in_space(covariance, len(of))}


def twist(of: Array, covariance: Array | None = None) -> Fields:
    """Fields of a geometry_msgs/Twist, or of a TwistWithCovariance with a covariance (3, 3) or (M,
    3, 3).
    """
    fields = {"linear": {"x": of[:, 0], "y": of[:, 1]}, "angular": {"z": of[:, 2]}}
    if covariance is None:
        return fields
    return {"twist": fields, "covariance": _in_space(covariance, len(of))}


def transforms(
    name: str, stamps: Stamps, frames: tuple[str, str], of: Array, latched: bool = False
) -> Publication:
    """A topic of tf2_msgs/TFMessage with one transform per message, the pose of `frames[1]` in
    `frames[0]`.
    """
    translation = {"x": of[:, 0], "y": of[:, 1]}
    transform = {
        "header": header(stamps, frames[0]),
        "child_frame_id": frames[1],
        "transform": {"translation": translation, "rotation": _quaternion(of[:, 2])},
    }
    return Publication(name, "tf2_msgs/msg/TFMessage", stamps, {"transforms": transform}, latched)


def _quaternion(heading: Array) -> Fields:
    return {"z": np.sin(heading / 2), "w": np.cos(heading / 2)}


def _in_space(covariance: Array, count: int) -> Array:
    """Covariances (M, 36) of x, y, z, roll, pitch and yaw, with zeros for z, roll and pitch."""
    full = np.zeros((count, 6, 6))
    rows, columns = _PLANAR
    full[:, rows, columns] = covariance
    return full.reshape(count, 36)


class RunTopics:
    """Topics for a log, in groups; a group is empty if the log doesn't have its data."""

    def __init__(
        self, log: RunLog, geometry: RobotGeometry | None, readings: np.ndarray | None
    ) -> None:
        """Prepare the topics; `readings` (T,) is the mask of rows with encoder readings, None for
        all rows.
        """
        self._log = log
        self._geometry = geometry
        self._start = 0 if log.time[0] > _SINCE_1970 else START
        if readings is None:
            self._read = np.ones(len(log.time), bool)
        else:
            self._read = np.asarray(readings, bool)
        self._odom: Array | None = None  # poses (T, 3) from dead reckoning without slip
        if geometry is not None:
            driven = body_twist(log.omega[1:], 0.0, geometry)
            steps = se2.advance(np.zeros(3), driven, np.diff(log.time))
            self._odom = se2.chain(np.zeros(3), steps)

    def encoders(self) -> Iterator[Publication]:
        """Topics on the motion of the sprockets."""
        log = self._log
        read = self._read
        stamps = self._stamps(log.time[read])
        turned = log.omega[1:] * np.diff(log.time)[:, None]
        angle = np.concatenate([np.zeros((1, 2)), np.cumsum(turned, axis=0)])
        joints = {
            "header": header(stamps),
            "name": JOINTS,
            "position": angle[read],
            "velocity": log.omega[read],
        }
        yield Publication("/joint_states", "sensor_msgs/msg/JointState", stamps, joints)
        if self._geometry is not None and self._odom is not None:
            driven = _planar(body_twist(log.omega[read], 0.0, self._geometry))
            odom = self._odom[read]
            frames = ("odom", "base_link")
            yield _odometry(
                "/odom", stamps, frames, odom, _WHEEL_COVARIANCE, driven, _WHEEL_COVARIANCE
            )
            yield transforms("/tf", stamps, frames, odom)

    def commands(self) -> Iterator[Publication]:
        """Topic of the body twists from a controller, or from the commanded sprocket speeds without
        slip.
        """
        log = self._log
        commanded = log.twist_command
        if commanded is None and log.command is not None and self._geometry is not None:
            commanded = body_twist(log.command, 0.0, self._geometry)
        if commanded is not None:
            given = self._read & np.isfinite(commanded).all(axis=1)
            yield command_topic("/cmd_vel", self._stamps(log.time[given]), commanded[given])

    def poses(self, covariance: Array | None) -> Iterator[Publication]:
        """Topics of the measured poses, and of the transforms that localization publishes with
        them.
        """
        log = self._log
        covariances = self._covariances(_EXACT if covariance is None else covariance)
        headed = log.has_heading
        if headed.any():
            stamps = self._stamps(log.time[headed])
            seen = log.pose[headed]
            fields = {"header": header(stamps, "map"), "pose": pose(seen, covariances[headed])}
            kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
            yield Publication("/pose", kind, stamps, fields)
            if self._odom is not None:
                corrected = se2.compose(seen, se2.inverse(self._odom[headed]))
                yield transforms("/tf", stamps, ("map", "odom"), corrected)
        rest = log.has_place & ~headed
        if rest.any():
            stamps = self._stamps(log.time[rest])
            yield _fixes("/fix", stamps, log.pose[rest, :2], covariances[rest])

    def _covariances(self, otherwise: Array) -> Array:
        """Covariances (T, 3, 3) of the poses; `otherwise` (3, 3) where the log has none."""
        log = self._log
        if log.covariance is None:
            return np.broadcast_to(otherwise, (len(log.time), 3, 3))
        is_known = np.isfinite(log.covariance).all(axis=(1, 2), keepdims=True)
        return np.where(is_known, log.covariance, otherwise)

    def truth(self) -> Iterator[Publication]:
        """Topic of the true motion."""
        truth = self._log.truth
        if truth is not None:
            read = self._read
            stamps = self._stamps(self._log.time[read])
            yield _odometry(
                "/ground_truth",
                stamps,
                ("map", "base_link"),
                truth.pose[read],
                _EXACT,
                truth.twist[read],
                _EXACT,
            )

    def scans(self, scans: tuple[Array, Scan] | None) -> Iterator[Publication]:
        """Topics of scans and the scanner's pose; by default the scans in the log, if it has all of
        their ranges.
        """
        log = self._log
        if scans is None and log.scans is not None and log.scans.full is not None:
            scans = log.time, replace(log.scans.scan, ranges=log.scans.full)
        if scans is None or not len(scans[0]):
            return
        time, scan = scans
        stamps = self._stamps(time)
        yield Publication(
            "/scan", "sensor_msgs/msg/LaserScan", stamps, _scan_fields(stamps, time, scan)
        )
        begin = self._stamps(np.minimum(time[:1], log.time[0]))
        mount = np.asarray(scan.mount, float)[None]
        yield transforms("/tf_static", begin, ("map", "laser"), mount, latched=True)

    def _stamps(self, time: Array) -> Stamps:
        """Stamps (M,) [ns] for times (M,) [s]."""
        whole = np.floor(time)
        seconds = whole + self._start
        is_stamp = (seconds >= 0) & (seconds < _LAST)
        allowed = f"stamps from 0 to {_LAST} s"
        require(is_stamp.all(), "times of the run", time.tolist()[:1], allowed)
        nanoseconds = np.rint((time - whole) * 1e9).astype(np.int64)
        return (whole.astype(np.int64) + self._start) * 10**9 + nanoseconds


def command_topic(name: str, stamps: Stamps, commanded: Array, stamped: bool = True) -> Publication:
    """A topic of geometry_msgs/TwistStamped with body twists (M, 2) [m/s, rad/s]; stamps are 0
    unless `stamped`.
    """
    in_header = stamps if stamped else np.zeros_like(stamps)
    fields = {"header": header(in_header, "base_link"), "twist": twist(_planar(commanded))}
    return Publication(name, "geometry_msgs/msg/TwistStamped", stamps, fields)


def _scan_fields(stamps: Stamps, time: Array, scan: Scan) -> Fields:
    """Fields of a sensor_msgs/LaserScan."""
    echoes = np.where(np.isnan(scan.ranges), np.inf, scan.ranges)  # as in REP 117
    return {
        "header": header(stamps, "laser"),
        "angle_min": float(scan.bearings[0]),
        "angle_max": float(scan.bearings[-1]),
        "angle_increment": scan.beam_step,
        "scan_time": float(np.median(np.diff(time))) if len(time) > 1 else 0.0,
        "range_max": float(scan.max_range),
        "ranges": echoes.astype(np.float32),
    }


def _odometry(
    name: str,
    stamps: Stamps,
    frames: tuple[str, str],
    at: Array,
    pose_covariance: Array,
    moving: Array,
    twist_covariance: Array,
) -> Publication:
    fields = {
        "header": header(stamps, frames[0]),
        "child_frame_id": frames[1],
        "pose": pose(at, pose_covariance),
        "twist": twist(moving, twist_covariance),
    }
    return Publication(name, "nav_msgs/msg/Odometry", stamps, fields)


def _fixes(name: str, stamps: Stamps, place: Array, covariance: Array) -> Publication:
    """A topic of sensor_msgs/NavSatFix with positions (M, 2), x to the east and y to the north of
    `FIELD` [m].
    """
    from pymap3d import enu2geodetic

    latitude, longitude, altitude = enu2geodetic(*place.T, 0.0, *FIELD)
    # of x, y and, in place of the yaw, the altitude, which is exact
    of_place = covariance * np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0])
    is_known = bool(of_place.any())
    fields = {
        "header": header(stamps, "gnss"),
        "status": _AUGMENTED_FIX,
        "latitude": latitude,
        "longitude": longitude,
        "altitude": altitude,
        "position_covariance": of_place.reshape(-1, 9),
        "position_covariance_type": _COVARIANCE_KNOWN if is_known else _COVARIANCE_UNKNOWN,
    }
    return Publication(name, "sensor_msgs/msg/NavSatFix", stamps, fields)


def _planar(of: Array) -> Array:
    return np.insert(of, 1, 0.0, axis=1)
