"""Writing of runs, and of commands for a robot, to ROS 2 bags."""

from __future__ import annotations

import heapq
import os
import re
import tempfile
from collections.abc import Mapping, Sequence
from itertools import repeat
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np

from sim.bags.topics import START, Publication, RunTopics, command_topic, definitions, messages
from trackslip.arguments import checks_arguments
from trackslip.bags.open import require_rosbags
from trackslip.errors import OutputError, require
from trackslip.kinematics import Array, RobotGeometry
from trackslip.localization.scan import Scan
from trackslip.logs.runlog import RunLog, stored_geometry

MCAP: Final = ".mcap"
"""Suffix of the data file in a bag."""
_TOPIC: Final = re.compile(r"(?:~?/)?[A-Za-z_]\w*(?:/[A-Za-z_]\w*)*", re.ASCII)


def require_topic(name: str, field: str = "topic") -> None:
    """Raise InvalidValueError unless a topic may have this name:
    https://design.ros2.org/articles/topic_and_service_names.html.
    """
    allowed = "names of letters, digits and _, joined by /, as in /cmd_vel"
    require(_TOPIC.fullmatch(name), field, name, allowed)


@checks_arguments
def write_bag(
    log: RunLog,
    path: str | Path,
    geometry: RobotGeometry | None = None,
    *,
    covariance: Array | None = None,
    readings: np.ndarray | None = None,
    scans: tuple[Array, Scan] | None = None,
) -> None:
    """Write a run as a ROS 2 bag in the format MCAP, complete or not at all.

    The bag has these topics if the log has their data: /joint_states, with sprocket angles since
    the first row; /odom (dead reckoning without slip); /cmd_vel (TwistStamped); /pose
    (PoseWithCovarianceStamped) or, for poses without headings, /fix (NavSatFix); /scan;
    /ground_truth; /tf with odom -> base_link and, with headings, map -> odom; /tf_static with map
    -> laser.

    Args:
        log: the run; its times become stamps, counted from 2026 unless they are already times since
            1970.
        path: folder of the bag, for `metadata.yaml` and the .mcap file; or only that file if the
            path ends in .mcap. The path must not exist.
        geometry: the robot's geometry, for /odom and /cmd_vel; by default that in the log's
            metadata. Without geometry, these topics are omitted.
        covariance: covariance (3, 3) for poses without covariances in the log [m, m, rad].
        readings: mask (T,) of the rows with encoder readings; by default all.
        scans: times (S,) [s] and scans with ranges (S, B), unless they are those in the log's rows.

    Raises:
        OutputError: if the path exists or can't be written.
        InvalidValueError: for times that no stamp can represent.
        TrackslipError: if rosbags is missing.
    """
    require_rosbags()
    geometry = geometry or stored_geometry(log)
    contents = RunTopics(log, geometry, readings)
    topics = [
        *contents.encoders(),
        *contents.commands(),
        *contents.poses(covariance),
        *contents.truth(),
        *contents.scans(scans),
    ]
    about = {"run": log.run}
    if geometry is not None:
        about |= {name: repr(value) for name, value in vars(geometry).items()}
    _write(Path(path), topics, about)


def write_commands(path: str | Path, time: Array, twist: Array, topic: str = "/cmd_vel") -> None:
    """Write twists (T, 2) [m/s, rad/s] at times (T,) [s] as TwistStamped to a bag that can be
    played to a robot.

    The stamps in the headers are 0, which the diff_drive_controller of ros2_control replaces with
    the time of arrival; it ignores commands with stamps older than its `cmd_vel_timeout`. `path` is
    that of `write_bag`. Raises InvalidValueError if `topic` isn't a valid name in ROS, and
    OutputError and TrackslipError like `write_bag`.
    """
    require_topic(topic)
    stamps = START * 1_000_000_000 + np.round(1e9 * time).astype(np.int64)
    _write(Path(path), [command_topic(topic, stamps, twist, stamped=False)], {})


def _write(path: Path, topics: Sequence[Publication], about: Mapping[str, str]) -> None:
    """Write the bag completely or not at all."""
    if path.exists():
        raise OutputError(f"{path}: exists already")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=path.parent) as staging:
            # the folder's name is also the file's
            draft = Path(staging) / path.name.removesuffix(MCAP)
            _fill(draft, topics, about)
            is_file = path.suffix == MCAP
            os.replace(draft / f"{draft.name}{MCAP}" if is_file else draft, path)
    except OSError as error:
        raise OutputError(f"{path}: can't be written ({error.strerror or error})") from error


def _fill(folder: Path, topics: Sequence[Publication], about: Mapping[str, str]) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    store = definitions()
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    for key, value in about.items():
        writer.set_custom_data(key, value)
    with writer:
        opened: dict[str, Any] = {}
        for topic in topics:
            if topic.name not in opened:
                profiles = [_latched()] if topic.latched else []
                opened[topic.name] = writer.add_connection(
                    topic.name, topic.kind, typestore=store, offered_qos_profiles=profiles
                )
        # the messages of all topics in the order of their stamps
        rows = [
            zip(topic.stamps.tolist(), repeat(topic), messages(topic.kind, topic.fields))
            for topic in topics
        ]
        for stamp, topic, message in heapq.merge(*rows, key=itemgetter(0)):
            writer.write(opened[topic.name], stamp, store.serialize_cdr(message, topic.kind))


def _latched() -> Any:
    """The quality of service that sends a topic's last message to late subscribers."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never = QosTime(0, 0)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL,
        deadline=never,
        lifespan=never,
        liveliness=QosLiveliness.SYSTEM_DEFAULT,
        liveliness_lease_duration=never,
        avoid_ros_namespace_conventions=False,
    )
