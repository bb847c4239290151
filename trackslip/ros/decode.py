"""Decoding of standard messages by rosbags, whatever else a bag defines."""

from __future__ import annotations

from functools import cache
from typing import Any

from trackslip.errors import LogError, TrackslipError, first_line
from trackslip.ros.compression import ZSTD_MAGIC, decompressed
from trackslip.ros.readers import Channel

_SAME = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}  # old names of types
_TRANSFORMS = "geometry_msgs/TransformStamped[] transforms"


def has_rosbags() -> bool:
    """Whether rosbags is installed."""
    try:
        import rosbags.typesys  # noqa: F401
    except ImportError:
        return False
    return True


def require_rosbags() -> None:
    """Raise TrackslipError unless rosbags is installed."""
    if not has_rosbags():
        raise TrackslipError("bags need the package rosbags: pip install 'trackslip[ros]'")


class Decoder:
    """Turns stored messages into objects.

    Types are those of the ROS distributions, which have never changed the layout of the messages read here. So a bag
    needs no definitions, and other topics may have any.
    """

    def decode(self, channel: Channel, data: bytes) -> Any:
        """The message; raises LogError if it is damaged, or of a type or encoding that isn't known."""
        kind = _SAME.get(channel.type, channel.type)
        ros1 = channel.encoding == "ros1"
        if not ros1 and channel.encoding != "cdr":
            raise LogError(f"encoding {channel.encoding!r} is neither cdr nor ros1")
        types = _types(ros1)
        if kind not in types.fielddefs:
            raise LogError(f"type {channel.type} is no standard type of ROS")
        try:
            if data.startswith(ZSTD_MAGIC) and not ros1:
                data = decompressed(data, "zstd", [])
            return types.deserialize_ros1(data, kind) if ros1 else types.deserialize_cdr(data, kind)
        except Exception as error:  # damaged bytes raise whatever the decoder meets first
            raise LogError(f"damaged ({first_line(error)})") from error


@cache
def _types(ros1: bool) -> Any:
    """The standard types."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if ros1:
        types.register(get_types_from_msg(_TRANSFORMS, "tf2_msgs/msg/TFMessage"))
    return types
