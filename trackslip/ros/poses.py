"""Measured poses from the messages in a bag."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.ros import covariance as covariances
from trackslip.ros import rotation
from trackslip.ros.bag import Bag, Topic
from trackslip.ros.geodesy import to_plane
from trackslip.ros.stamps import stretches
from trackslip.ros.transforms import read_chain

FIX = "sensor_msgs/msg/NavSatFix"
ODOMETRY = "nav_msgs/msg/Odometry"
_POINTS: dict[str, Callable[[Any], tuple[Any, Any, Any]]] = {  # position, orientation, covariance of a message
    ODOMETRY: lambda content: (content.pose.pose.position, content.pose.pose.orientation, content.pose.covariance),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda content: (
        content.pose.pose.position,
        content.pose.pose.orientation,
        content.pose.covariance,
    ),
    "geometry_msgs/msg/PoseStamped": lambda content: (content.pose.position, content.pose.orientation, None),
    "geometry_msgs/msg/TransformStamped": lambda content: (
        content.transform.translation,
        content.transform.rotation,
        None,
    ),
}
POSE_TYPES = (*_POINTS, FIX)
"""Types of messages that poses are read from, besides transforms."""
_NO_FIX = 0  # status below which a fix is none
_MAX_PLACE = 1e9  # farther ones aren't measured [m]
_MAX_ALTITUDE = 1e5  # higher ones neither [m]
_MIN_WAY = 0.1  # way that a heading which never changes makes doubtful [m]


@dataclass(frozen=True)
class Poses:
    """Measured poses, all by one clock."""

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


@dataclass(frozen=True)
class _Raw:
    """What the messages state, a row for each."""

    stamp: np.ndarray  # (N,) [ns]
    arrival: np.ndarray  # (N,) [ns]
    place: Array  # (N, 3)
    turn: Array | None  # (N, 4) quaternions; None if the messages have none
    covariance: Array | None  # (N, 3, 3)


def read_poses(bag: Bag, source: str, notes: list[str]) -> list[Poses]:
    """The poses of a topic or of tf:PARENT:CHILD, one for each stretch between restarts of their clock.

    `notes` gets a line for what is left out, and for what is doubtful. Raises LogError if there are none.
    """
    if source.startswith("tf:"):
        _, parent, child = source.split(":")
        parts = [
            _of_rows(source, _Raw(stamp, arrival, place, turn, None), notes)
            for stamp, arrival, place, turn in read_chain(bag, parent, child, notes)
        ]
    else:
        topic = bag.topic(source)
        raw = _fixes(bag, topic, notes) if topic.type == FIX else _points(bag, topic, notes)
        raw = _taken(raw, _usable(raw, topic.name, notes))
        rows = stretches(topic.name, raw.stamp, raw.arrival, notes)
        parts = [_of_rows(topic.name, _taken(raw, part), notes) for part in rows]
    found = [part for part in parts if len(part.stamp)]
    if not found:
        raise LogError(f"{bag.path}: {source}: no pose can be read")
    return found


def _points(bag: Bag, topic: Topic, notes: list[str]) -> _Raw:
    """The poses that messages state in metres."""
    if topic.type not in _POINTS:
        raise LogError(
            f"{bag.path}: topic {topic.name} has messages of {topic.type}; poses are read from {', '.join(POSE_TYPES)}"
        )
    parts = _POINTS[topic.type]
    stamps, values, stated = [], [], []
    for message in bag.messages(topic.name, notes=notes):
        place, turn, covariance = parts(message.content)
        stamps.append((message.stamp, message.arrival))
        values.append((place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w))
        if covariance is not None:
            stated.append(covariance)
    table, at = np.array(values, float), np.array(stamps, np.int64)
    known = covariances.planar(np.array(stated, float)) if stated else None
    return _Raw(at[:, 0], at[:, 1], table[:, :3], table[:, 3:], known)


def _fixes(bag: Bag, topic: Topic, notes: list[str]) -> _Raw:
    """The positions of fixes, east and north of the first one."""
    stamps, values, stated = [], [], []
    for message in bag.messages(topic.name, notes=notes):
        fix = message.content
        stamps.append((message.stamp, message.arrival))
        values.append((fix.latitude, fix.longitude, fix.altitude, fix.status.status, fix.position_covariance_type))
        stated.append(fix.position_covariance)
    table, at = np.array(values, float), np.array(stamps, np.int64)
    there = (np.abs(table[:, :2]) <= [90, 360]).all(axis=1) & table[:, :2].any(axis=1)  # receivers start with zeros
    fixed = np.asarray((table[:, 3] >= _NO_FIX) & there)
    if not fixed.any():
        raise LogError(f"{bag.path}: topic {topic.name}: none of its {len(fixed)} messages has a fix")
    if not fixed.all():
        notes.append(f"topic {topic.name}: {int((~fixed).sum())} of {len(fixed)} messages left out: they have no fix")
    table, at = table[fixed], at[fixed]
    plane = np.array(stated, float)[fixed].reshape(-1, 3, 3)
    known = np.zeros((len(table), 3, 3))
    known[:, :2, :2] = np.where(table[:, 4, None, None] > 0, plane[:, :2, :2], 0.0)
    altitude = np.where(np.abs(table[:, 2]) <= _MAX_ALTITUDE, table[:, 2], 0.0)
    geodetic = np.column_stack([table[:, :2], altitude])
    east_north = to_plane(geodetic, geodetic[0])
    return _Raw(at[:, 0], at[:, 1], np.column_stack([east_north, altitude]), None, known)


def _usable(raw: _Raw, topic: str, notes: list[str]) -> np.ndarray:
    """The rows whose position and orientation mean something."""
    good = np.asarray((np.abs(raw.place[:, :2]) <= _MAX_PLACE).all(axis=1))
    if not good.all():
        if not good.any():
            raise LogError(f"topic {topic}: no position is finite")
        notes.append(f"topic {topic}: {int((~good).sum())} of {len(good)} poses left out: x or y is not finite")
    if raw.turn is not None and raw.turn[good].any():
        good[good] = rotation.usable(raw.turn[good], f"topic {topic}", notes)
    return np.flatnonzero(good)


def _taken(raw: _Raw, rows: np.ndarray) -> _Raw:
    """Some rows."""
    turn = None if raw.turn is None else raw.turn[rows]
    covariance = None if raw.covariance is None else raw.covariance[rows]
    return _Raw(raw.stamp[rows], raw.arrival[rows], raw.place[rows], turn, covariance)


def _of_rows(source: str, raw: _Raw, notes: list[str]) -> Poses:
    """The poses of a stretch of messages in order."""
    name = source if source.startswith("tf:") else f"topic {source}"
    heading = _headings(name, raw, notes)
    known = None if raw.covariance is None else covariances.meaningful(raw.covariance, bool(np.isfinite(heading).any()))
    pose = np.column_stack([raw.place[:, :2], heading])
    delay = float(np.median(raw.arrival - raw.stamp)) / 1e9 if len(raw.stamp) else 0.0
    return Poses(source, raw.stamp, pose, known, delay)


def _headings(name: str, raw: _Raw, notes: list[str]) -> Array:
    """Headings (N,), NaN if they were not measured."""
    none = np.full(len(raw.stamp), np.nan)
    if raw.turn is None or not len(raw.stamp):
        return none
    if not raw.turn.any():
        notes.append(f"{name}: it states no orientation (all quaternions are 0): read without headings")
        return none
    if raw.covariance is not None and not covariances.knows_heading(raw.covariance).any():
        notes.append(f"{name}: its covariances call the heading unknown: read without headings")
        return none
    heading = rotation.headings(raw.turn, name, notes)
    if (heading == heading[0]).all() and np.ptp(raw.place[:, :2], axis=0).max() > _MIN_WAY:
        notes.append(f"{name}: its heading never changes although it moves: read without headings")
        return none
    return heading
