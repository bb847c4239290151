"""Commands to a robot as a ROS 2 bag that can be played to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackslip.kinematics import Array
from trackslip.ros.messages import Messages
from trackslip.ros.writer import START, write_topics


def write_commands(path: str | Path, time: Array, twist: Array, topic: str = "/cmd_vel") -> None:
    """Write twists (T, 2) [m/s, rad/s], given at `time` (T,) [s], as TwistStamped to a bag in the format MCAP.

    The path is that of the bag's folder, or of a file if it ends in .mcap; it must not exist.

    Raises:
        OutputError: if the path exists, or can't be written.
        TrackslipError: where rosbags is missing.
    """
    stamps = START * 1_000_000_000 + np.round(1e9 * time).astype(np.int64)
    planar = np.column_stack([twist[:, 0], np.zeros(len(twist)), twist[:, 1]])
    write_topics(Path(path), [Messages().twists(topic, stamps, "base_link", planar)], {})
