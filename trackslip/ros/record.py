"""What a bag file contains, whatever its format: messages on channels, as bytes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

Wanted = Callable[[str], bool]
"""Whether messages of a topic are read; those of others are skipped, and cost next to no time."""


class Channel(NamedTuple):
    """Where messages of one type come from."""

    topic: str
    type: str
    """Name of the message type, as in `sensor_msgs/msg/JointState`."""
    encoding: str
    """How its messages are serialised: cdr (ROS 2), ros1, or what else the file states."""


class Record(NamedTuple):
    """A message as stored."""

    channel: Channel
    arrival: int
    """When it was recorded [ns]."""
    data: bytes
    """The serialised message; empty if its topic wasn't asked for."""


def short_type(name: str) -> str:
    """The name of a message type as people write it, `package/Type`."""
    return name.replace("/msg/", "/")


def ros2_type(name: str) -> str:
    """`package/msg/Type` for a ROS 1 or ROS 2 name of a message type."""
    package, _, last = name.partition("/")
    return f"{package}/msg/{last}" if last and "/" not in last else name
