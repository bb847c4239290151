"""Measured poses from the messages in a bag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.ros import planar
from trackslip.ros.bag import Bag, Topic
from trackslip.ros.geodesy import to_plane
from trackslip.ros.joints import ODOMETRY
from trackslip.ros.stamps import stretches
from trackslip.ros.transforms import SpacePoses, place_and_turn, read_chain

FIX = "sensor_msgs/msg/NavSatFix"
POSE_TYPES = (
    ODOMETRY,
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
    FIX,
)
"""Types of messages that poses are read from, besides transforms."""
_NO_FIX = 0  # status below which a fix is none
_MAX_PLACE = 1e9  # places farther away mean nothing [m]
_MAX_ALTITUDE = 1e5  # heights above mean nothing [m]
_MIN_WAY = 0.1  # way over which a constant heading is doubtful [m]


@dataclass(frozen=True)
class Poses:
    """Measured poses in the plane, all by one clock."""

    source: str
    """The topic, or tf:PARENT:CHILD."""
    stamp: np.ndarray
    """(N,) int: stamps in the headers, ascending [ns]."""
    pose: Array
    """(N, 3) [m, m, rad]: headings are NaN where not measured, not unwrapped."""
    covariance: Array | None
    """(N, 3, 3) of the poses, NaN where not stated; None if none is."""
    delay: float
    """Median time from the stamps to the recording [s]."""


def read_poses(bag: Bag, source: str, notes: list[str]) -> list[Poses]:
    """The poses of a topic or of tf:PARENT:CHILD, one for each stretch between restarts of their clock.

    `notes` gets a line for what is left out, and for what is doubtful. Raises LogError if there are none.
    """
    if source.startswith("tf:"):
        name = source
        _, parent, child = source.split(":")
        parts = read_chain(bag, parent, child, notes)
    else:
        topic = bag.topic(source)
        source, name = topic.name, f"topic {topic.name}"
        poses = _fixes(bag, topic, notes) if topic.type == FIX else _points(bag, topic, notes)
        parts = [poses.take(rows) for rows in stretches(source, poses.stamp, poses.arrival, notes)]
    found = [_in_plane(source, name, part, notes) for part in parts if len(part.stamp)]
    if not found:
        raise LogError(f"{bag.path}: {source}: no pose can be read")
    return found


def _points(bag: Bag, topic: Topic, notes: list[str]) -> SpacePoses:
    """The poses of messages in metres, without meaningless ones."""
    if topic.type not in POSE_TYPES:
        raise LogError(
            f"{bag.path}: topic {topic.name} has messages of {topic.type}; poses are read from {', '.join(POSE_TYPES)}"
        )
    stamps, stated, variances = [], [], []
    for message in bag.messages(topic.name, notes=notes):
        place, turn, covariance = _parts(message.content)
        stamps.append((message.stamp, message.arrival))
        stated.append((place, turn))
        variances += [] if covariance is None else [covariance]
    stamp, arrival = np.array(stamps, np.int64).T
    place, turn = place_and_turn(stated)
    known = planar.planar_covariances(np.array(variances, float)) if variances else None
    good = np.asarray((np.abs(place[:, :2]) <= _MAX_PLACE).all(axis=1))
    if not good.any():
        raise LogError(f"topic {topic.name}: no position is finite")
    if not good.all():
        notes.append(f"topic {topic.name}: {(~good).sum()} of {len(good)} poses left out: x or y is not finite")
    if turn[good].any():
        good[good] = planar.unit_quaternions(turn[good], f"topic {topic.name}", notes)
    return SpacePoses(stamp, arrival, place, turn, known).take(np.flatnonzero(good))


def _parts(content: Any) -> tuple[Any, Any, Any]:
    """Position, orientation and covariance, if it is stated, of a message that is none of a fix."""
    if hasattr(content, "transform"):
        return content.transform.translation, content.transform.rotation, None
    pose = content.pose
    if hasattr(pose, "covariance"):
        return pose.pose.position, pose.pose.orientation, pose.covariance
    return pose.position, pose.orientation, None


def _fixes(bag: Bag, topic: Topic, notes: list[str]) -> SpacePoses:
    """The positions of fixes, east and north of the first one."""
    stamps, values, stated = [], [], []
    for message in bag.messages(topic.name, notes=notes):
        fix = message.content
        stamps.append((message.stamp, message.arrival))
        values.append((fix.latitude, fix.longitude, fix.altitude, fix.status.status, fix.position_covariance_type))
        stated.append(fix.position_covariance)
    table = np.array(values, float)
    there = (np.abs(table[:, :2]) <= [90, 360]).all(axis=1) & table[:, :2].any(axis=1)  # receivers start with zeros
    fixed = np.asarray((table[:, 3] >= _NO_FIX) & there)
    if not fixed.any():
        raise LogError(f"{bag.path}: topic {topic.name}: none of its {len(fixed)} messages has a fix")
    if not fixed.all():
        notes.append(f"topic {topic.name}: {(~fixed).sum()} of {len(fixed)} messages left out: they have no fix")
    table, (stamp, arrival) = table[fixed], np.array(stamps, np.int64)[fixed].T
    altitude = np.where(np.abs(table[:, 2]) <= _MAX_ALTITUDE, table[:, 2], 0.0)
    geodetic = np.column_stack([table[:, :2], altitude])
    place = np.column_stack([to_plane(geodetic, geodetic[0]), altitude])
    known = np.zeros((len(table), 3, 3))
    horizontal = np.array(stated, float)[fixed].reshape(-1, 3, 3)[:, :2, :2]
    known[:, :2, :2] = np.where(table[:, 4, None, None] > 0, horizontal, 0.0)
    return SpacePoses(stamp, arrival, place, np.full((len(table), 4), np.nan), known)


def _in_plane(source: str, name: str, poses: SpacePoses, notes: list[str]) -> Poses:
    """Poses seen from above; `name` is the source's name in messages."""
    heading = _headings(name, poses, notes)
    known = poses.covariance
    if known is not None:
        known = planar.meaningful_covariances(known, bool(np.isfinite(heading).any()))
    delay = float(np.median(poses.arrival - poses.stamp)) / 1e9
    return Poses(source, poses.stamp, np.column_stack([poses.place[:, :2], heading]), known, delay)


def _headings(name: str, poses: SpacePoses, notes: list[str]) -> Array:
    """Headings (N,), NaN if they were not measured."""
    none = np.full(len(poses.stamp), np.nan)
    if np.isnan(poses.turn).all():
        return none
    if not poses.turn.any():
        notes.append(f"{name}: it states no orientation (all quaternions are 0): read without headings")
        return none
    if poses.covariance is not None and not planar.knows_heading(poses.covariance):
        notes.append(f"{name}: its covariances call the heading unknown: read without headings")
        return none
    heading = planar.headings(poses.turn, name, notes)
    if (heading == heading[0]).all() and np.ptp(poses.place[:, :2], axis=0).max() > _MIN_WAY:
        notes.append(f"{name}: its heading never changes although it moves: read without headings")
        return none
    return heading
