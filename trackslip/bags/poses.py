"""Measured poses from the messages in a bag, seen from above."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trackslip.bags.open import Bag, Topic
from trackslip.bags.stamps import stretches
from trackslip.bags.topics import FIX, IMU, POSE_TYPES
from trackslip.bags.transforms import (
    MAX_PLACE,
    SpacePoses,
    are_unit,
    pose_numbers,
    read_chain,
    unit_quaternions,
)
from trackslip.errors import LogError
from trackslip.kinematics import Array

_NO_FIX = 0  # status below which a fix is none: sensor_msgs/NavSatStatus
_MAX_ALTITUDE = 1e5  # heights above mean nothing [m]
_MIN_WAY = 0.1  # way over which a constant heading is doubtful [m]
_MAX_TILT = np.radians(20.0)  # of a robot, above which its heading and way in the plane are doubtful [rad]
_PLANE = [0, 1, 5]  # x, y and yaw out of x, y, z, roll, pitch, yaw
_MIN_VARIANCE = 1e-30  # smaller ones mean nothing
_ROUNDING = 1e-6  # of correlations that were stored in single precision
_MAX_VARIANCE = np.array([1e3, 1e3, 10.0])  # of x, y [m^2] and heading [rad^2]: larger ones stand for "unknown"


@dataclass(frozen=True)
class Poses:
    """Measured poses in the plane, all by one clock."""

    source: str
    """The topic, or tf:PARENT:CHILD."""
    stamp: np.ndarray  # (N,) int: stamps in the headers, ascending [ns]
    pose: Array  # (N, 3) [m, m, rad]: NaN where not measured, headings not unwrapped
    covariance: Array | None  # (N, 3, 3) of the poses, NaN where not stated; None if none is
    delay: Array  # (N,) times from the stamps to the recording [s]


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
        poses = _read(bag, topic, notes)
        parts = [poses.take(rows) for rows in stretches(source, poses.stamp, poses.arrival, notes)]
    found = [_in_plane(source, name, part, notes) for part in parts if len(part.stamp)]
    if not found:
        raise LogError(f"{bag.path}: {source}: no pose can be read")
    return found


def _read(bag: Bag, topic: Topic, notes: list[str]) -> SpacePoses:
    """The poses of a topic, without meaningless ones."""
    if topic.type == FIX:
        return _fixes(bag, topic, notes)
    if topic.type == IMU:
        return _orientations(bag, topic)
    if topic.type in POSE_TYPES:
        return _points(bag, topic, notes)
    types = ", ".join((*POSE_TYPES, IMU))
    raise LogError(f"{bag.path}: topic {topic.name} has messages of {topic.type}; poses are read from {types}")


def _points(bag: Bag, topic: Topic, notes: list[str]) -> SpacePoses:
    """The poses of messages in metres."""
    stamp, arrival, table = bag.table([topic.name], _numbers)
    place, turn, covariance = np.split(table, [3, 7], axis=1)
    known = planar_covariances(covariance) if covariance.size else None
    good = np.asarray((np.abs(place[:, :2]) <= MAX_PLACE).all(axis=1))
    if not good.any():
        raise LogError(f"topic {topic.name}: no position is finite")
    if not good.all():
        notes.append(f"topic {topic.name}: {(~good).sum()} of {len(good)} poses left out: x or y is not finite")
    if turn[good].any():
        good[good] = unit_quaternions(turn[good], f"topic {topic.name}", notes)
    return SpacePoses(stamp, arrival, place, turn, known).take(np.flatnonzero(good))


def _numbers(content: Any) -> tuple[float, ...]:
    """Position, quaternion and covariance, if it is stated, of a message with a pose in metres."""
    if hasattr(content, "transform"):
        return pose_numbers(content.transform.translation, content.transform.rotation)
    pose = content.pose
    if hasattr(pose, "covariance"):
        return (*pose_numbers(pose.pose.position, pose.pose.orientation), *pose.covariance)
    return pose_numbers(pose.position, pose.orientation)


def _fixes(bag: Bag, topic: Topic, notes: list[str]) -> SpacePoses:
    """The positions of fixes, east and north of the first one."""
    from pymap3d import geodetic2enu

    def numbers(fix: Any) -> tuple[float, ...]:
        place = fix.latitude, fix.longitude, fix.altitude
        return (*place, fix.status.status, fix.position_covariance_type, *fix.position_covariance)

    stamp, arrival, table = bag.table([topic.name], numbers)
    there = (np.abs(table[:, :2]) <= [90, 360]).all(axis=1) & table[:, :2].any(axis=1)  # receivers start with zeros
    fixed = np.asarray((table[:, 3] >= _NO_FIX) & there)
    if not fixed.any():
        raise LogError(f"{bag.path}: topic {topic.name}: none of its {len(fixed)} messages has a fix")
    if not fixed.all():
        notes.append(f"topic {topic.name}: {(~fixed).sum()} of {len(fixed)} messages left out: they have no fix")
    table = table[fixed]
    latitude, longitude = table[:, :2].T
    altitude = np.where(np.abs(table[:, 2]) <= _MAX_ALTITUDE, table[:, 2], 0.0)
    enu = geodetic2enu(latitude, longitude, altitude, latitude[0], longitude[0], altitude[0])
    known = np.zeros((len(table), 3, 3))
    horizontal = table[:, 5:].reshape(-1, 3, 3)[:, :2, :2]
    known[:, :2, :2] = np.where(table[:, 4, None, None] > 0, horizontal, 0.0)
    return SpacePoses(stamp[fixed], arrival[fixed], np.column_stack(enu), np.full((len(table), 4), np.nan), known)


def _orientations(bag: Bag, topic: Topic) -> SpacePoses:
    """The orientations of an IMU, without places."""

    def numbers(imu: Any) -> tuple[float, ...]:
        turn, measured = imu.orientation, imu.orientation_covariance[0] != -1  # which stands for "not measured"
        return (turn.x, turn.y, turn.z, turn.w) if measured else (np.nan,) * 4

    stamp, arrival, turn = bag.table([topic.name], numbers)
    turn[~are_unit(turn)] = np.nan
    return SpacePoses(stamp, arrival, np.full((len(turn), 3), np.nan), turn)


def _in_plane(source: str, name: str, poses: SpacePoses, notes: list[str]) -> Poses:
    """Poses seen from above; `name` is the source's name in messages."""
    heading = _headings(name, poses, notes)
    known = poses.covariance
    if known is not None:
        known = meaningful_covariances(known, bool(np.isfinite(heading).any()))
    delay = (poses.arrival - poses.stamp) / 1e9
    return Poses(source, poses.stamp, np.column_stack([poses.place[:, :2], heading]), known, delay)


def _headings(name: str, poses: SpacePoses, notes: list[str]) -> Array:
    """Headings (N,), NaN if they were not measured."""
    none = np.full(len(poses.stamp), np.nan)
    if np.isnan(poses.turn).all():
        return none
    if not poses.turn.any():
        notes.append(f"{name}: it states no orientation (all quaternions are 0): read without headings")
        return none
    if poses.covariance is not None and (poses.covariance[:, 2, 2] > _MAX_VARIANCE[2]).all():
        notes.append(f"{name}: its covariances call the heading unknown: read without headings")
        return none
    heading = headings(poses.turn, name, notes)
    if (heading == heading[0]).all() and np.ptp(poses.place[:, :2], axis=0).max() > _MIN_WAY:
        notes.append(f"{name}: its heading never changes although it moves: read without headings")
        return none
    return heading


def headings(quaternion: Array, source: str, notes: list[str]) -> Array:
    """Headings (n,) of the x axes of rotations (n, 4), counter-clockwise from above [rad].

    NaN if most of them are tilted so much that the x axis shows no heading. `notes` gets a line for tilts above 20°.
    """
    x, y, z, w = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    heading = np.arctan2(2 * (x * y + z * w), 1 - 2 * (y * y + z * z))
    tilt = np.arccos(np.clip(1 - 2 * (x * x + y * y), -1.0, 1.0))
    steep = tilt > _MAX_TILT
    if not steep.any():
        return np.asarray(heading)
    most = f"{np.degrees(np.nanmax(tilt)):.0f}°"
    tilted = f"tilted by more than 20° in {int(steep.sum())} of {len(tilt)} poses, by up to {most}"
    if steep.mean() <= 0.5:
        notes.append(f"{source}: {tilted}: slip is identified in the plane")
        return np.asarray(heading)
    notes.append(f"{source}: its frame is {tilted}: headings left out; is it a camera's frame, or has it z downwards?")
    return np.full(len(heading), np.nan)


def planar_covariances(stated: Array) -> Array:
    """Covariances (n, 3, 3) of x, y and heading out of those (n, 36) of poses in space."""
    return np.asarray(stated.reshape(-1, 6, 6)[:, _PLANE][:, :, _PLANE])


def meaningful_covariances(covariance: Array, heading: bool) -> Array | None:
    """The covariances (n, 3, 3), NaN where zero or absurd; None if none means anything.

    Absurd are those that aren't finite, symmetric and positive, and those that stand for "unknown". Without `heading`,
    its entries are NaN and don't count.
    """
    size = 3 if heading else 2
    part = covariance[:, :size, :size]
    variance = np.einsum("nii->ni", part)
    with np.errstate(invalid="ignore", over="ignore"):
        good = ((variance >= _MIN_VARIANCE) & (variance <= _MAX_VARIANCE[:size])).all(axis=1)
        scale = np.sqrt(np.where(good[:, None], variance, 1.0))
        correlation = np.where(good[:, None, None], part, np.eye(size)) / (scale[:, :, None] * scale[:, None, :])
        good &= (np.abs(correlation) <= 1.0 + _ROUNDING).all(axis=(1, 2))
    correlation[~good] = np.eye(size)
    good &= np.abs(correlation - correlation.swapaxes(1, 2)).max(axis=(1, 2)) <= _ROUNDING
    good &= np.linalg.eigvalsh(correlation)[:, 0] > -_ROUNDING
    if not good.any():
        return None
    kept = np.full_like(covariance, np.nan)
    kept[good, :size, :size] = part[good]
    return kept
