"""What a bag file contains, whatever its format: messages on channels, as bytes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol


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


class Wanted(Protocol):
    """Selects the topics whose messages are read; those of others are skipped, and cost next to no time."""

    def __call__(self, topic: str) -> bool:
        """Whether messages of the topic are read."""
        ...


class Storage(Protocol):
    """A reader of one format of bag files."""

    def __call__(self, path: str, wanted: Wanted, notes: list[str]) -> Iterator[Record]:
        """All that can be read of a file, in its order; `notes` gets a line for each damage.

        Raises LogError if the file has another format.
        """
        ...


def ros2_type(name: str) -> str:
    """`package/msg/Type` for a ROS 1 or ROS 2 name of a message type."""
    package, _, last = name.partition("/")
    return f"{package}/msg/{last}" if last and "/" not in last else name
