"""Messages for ROS 2, built from columns of numbers, a topic at a time.

They describe motion in the plane: poses (M, 3) are x, y [m] and yaw [rad], twists (M, 3) forward speed,
lateral speed to the left [m/s] and yaw rate [rad/s].
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackslip.kinematics import Array

Stamps = NDArray[np.int64]
"""Times (M,) since 1970 [ns]."""
Fields = Mapping[str, Any]
"""Values of fields by name: an array with a row for each message, the value that all messages share, or more fields.

Fields without a value are zero or empty; an array of messages has one, whose fields are given.
"""
_ROW, _COLUMN = np.ix_((0, 1, 5), (0, 1, 5))  # x, y, yaw among x, y, z, roll, pitch, yaw


@functools.cache
def definitions() -> Any:
    """The message types of ROS 2 Jazzy; other releases since Foxy define those written here alike."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


@dataclass(frozen=True)
class Publication:
    """A topic to write: its messages, all of one type."""

    name: str
    kind: str  # their type, as in `sensor_msgs/msg/LaserScan`
    stamps: Stamps  # (M,) of their headers, ascending [ns]
    fields: Fields
    latched: bool = False  # late subscribers receive the last message, too

    def messages(self) -> Iterator[Any]:
        """The M messages."""
        return _messages(self.kind, self.fields)


def _messages(kind: str, fields: Fields) -> Iterator[Any]:
    """Messages of a type, as many as its shortest array has rows."""
    known = definitions()
    columns = (_column(node, detail, fields.get(name)) for name, (node, detail) in known.fielddefs[kind][1])
    return map(known.types[kind], *columns)


def _column(node: int, detail: Any, value: Any) -> Iterator[Any]:
    """The values of a field, message by message."""
    from rosbags.interfaces import Nodetype

    if node == Nodetype.NAME:
        return _messages(detail, value or {})
    if isinstance(value, np.ndarray):
        return iter(value.tolist() if value.ndim == 1 else value)
    if node == Nodetype.BASE:
        return repeat(value if value is not None else "" if detail[0] == "string" else 0)
    (inner, element), length = detail
    if inner == Nodetype.NAME:
        return ([message] for message in _messages(element, value))
    return repeat(np.zeros(length, element[0]) if value is None else value)


def header(stamps: Stamps, frame: str = "") -> Fields:
    """Fields of a std_msgs/Header."""
    seconds, rest = np.divmod(stamps, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def pose(of: Array, covariance: Array | None = None) -> Fields:
    """Fields of a geometry_msgs/Pose, or with covariances (3, 3) or (M, 3, 3) of a PoseWithCovariance."""
    fields = {"position": {"x": of[:, 0], "y": of[:, 1]}, "orientation": _quaternion(of[:, 2])}
    return fields if covariance is None else {"pose": fields, "covariance": _in_space(covariance, len(of))}


def twist(of: Array, covariance: Array | None = None) -> Fields:
    """Fields of a geometry_msgs/Twist, or with covariances (3, 3) or (M, 3, 3) of a TwistWithCovariance."""
    fields = {"linear": {"x": of[:, 0], "y": of[:, 1]}, "angular": {"z": of[:, 2]}}
    return fields if covariance is None else {"twist": fields, "covariance": _in_space(covariance, len(of))}


def transforms(name: str, stamps: Stamps, frames: tuple[str, str], of: Array, latched: bool = False) -> Publication:
    """A topic of tf2_msgs/TFMessage with one transform each: the pose of the second of `frames` in the first."""
    moved = {"translation": {"x": of[:, 0], "y": of[:, 1]}, "rotation": _quaternion(of[:, 2])}
    moved_frame = {"header": header(stamps, frames[0]), "child_frame_id": frames[1], "transform": moved}
    return Publication(name, "tf2_msgs/msg/TFMessage", stamps, {"transforms": moved_frame}, latched)


def _quaternion(heading: Array) -> Fields:
    return {"z": np.sin(heading / 2), "w": np.cos(heading / 2)}


def _in_space(covariance: Array, count: int) -> Array:
    """Covariances (M, 36) of x, y, z, roll, pitch and yaw, with zeros for what isn't in the plane."""
    full = np.zeros((count, 6, 6))
    full[:, _ROW, _COLUMN] = covariance
    return full.reshape(count, 36)
