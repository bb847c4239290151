"""Measured poses from the messages in a bag, seen from above."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from trackslip.bags.open import Bag, Topic
from trackslip.bags.stamps import Readings
from trackslip.bags.topics import FIX, IMU, POSE_TYPES
from trackslip.bags.transforms import MAX_PLACE, MAX_TILT, are_unit, heading_and_tilt, pose_numbers, read_chain
from trackslip.errors import LogError
from trackslip.kinematics import Array

_NO_FIX = 0  # status below which a fix is none: sensor_msgs/NavSatStatus
_MAX_ALTITUDE = 1e5  # heights above mean nothing [m]
_MIN_WAY = 0.1  # way over which a constant heading is doubtful [m]


def read_poses(bag: Bag, source: str, notes: list[str]) -> Readings:
    """The poses (N, 3) of a topic or of tf:PARENT:CHILD in the plane [m, m, rad]: NaN where not measured.

    Headings are not unwrapped. `notes` gets a line for what is left out, and for what is doubtful. Raises LogError if
    there are none.
    """
    if source.startswith("tf:"):
        name = source
        _, parent, child = source.split(":")
        poses = read_chain(bag, parent, child, notes)
    else:
        topic = bag.topic(source)
        source, name = topic.name, f"topic {topic.name}"
        poses = _read(bag, topic, notes).ascending(notes)
    if not len(poses.stamp):
        raise LogError(f"{bag.path}: {source}: no pose can be read")
    heading = _headings(name, poses.values, notes)
    return replace(poses, source=source, values=np.column_stack([poses.values[:, :2], heading]))


def _read(bag: Bag, topic: Topic, notes: list[str]) -> Readings:
    """Positions and quaternions (N, 7) of a topic's poses, NaN where not measured, without meaningless ones."""
    if topic.type == FIX:
        return _fixes(bag, topic, notes)
    if topic.type == IMU:
        return bag.table(topic.name, _orientation)
    if topic.type not in POSE_TYPES:
        types = ", ".join((*POSE_TYPES, IMU))
        raise LogError(f"{bag.path}: topic {topic.name} has messages of {topic.type}; poses are read from {types}")
    poses = bag.table(topic.name, _place_and_turn)
    good = np.asarray((np.abs(poses.values[:, :2]) <= MAX_PLACE).all(axis=1))
    if not good.any():
        raise LogError(f"topic {topic.name}: no position is finite")
    if not good.all():
        notes.append(f"topic {topic.name}: {(~good).sum()} of {len(good)} poses left out: x or y is not finite")
    return poses.take(good)


def _orientation(imu: Any) -> tuple[float, ...]:
    """The quaternion of an IMU without position; NaN if its covariance says, by -1, that it is not measured."""
    turn, unknown = imu.orientation, (np.nan,) * 3
    measured = imu.orientation_covariance[0] != -1
    return (*unknown, turn.x, turn.y, turn.z, turn.w) if measured else (np.nan,) * 7


def _place_and_turn(content: Any) -> tuple[float, ...]:
    """Position and quaternion of a message with a pose in metres."""
    if hasattr(content, "transform"):
        return pose_numbers(content.transform.translation, content.transform.rotation)
    pose = content.pose.pose if hasattr(content.pose, "covariance") else content.pose
    return pose_numbers(pose.position, pose.orientation)


def _fixes(bag: Bag, topic: Topic, notes: list[str]) -> Readings:
    """The positions of fixes, east and north of the first one, without quaternions."""
    from pymap3d import geodetic2enu

    def numbers(fix: Any) -> tuple[float, ...]:
        return fix.latitude, fix.longitude, fix.altitude, fix.status.status

    fixes = bag.table(topic.name, numbers)
    table = fixes.values
    there = (np.abs(table[:, :2]) <= [90, 360]).all(axis=1) & table[:, :2].any(axis=1)  # receivers start with zeros
    fixed = np.asarray((table[:, 3] >= _NO_FIX) & there)
    if not fixed.any():
        raise LogError(f"{bag.path}: topic {topic.name}: none of its {len(fixed)} messages has a fix")
    if not fixed.all():
        notes.append(f"topic {topic.name}: {(~fixed).sum()} of {len(fixed)} messages left out: they have no fix")
    latitude, longitude, altitude, _ = table[fixed].T
    altitude = np.where(np.abs(altitude) <= _MAX_ALTITUDE, altitude, 0.0)
    enu = geodetic2enu(latitude, longitude, altitude, latitude[0], longitude[0], altitude[0])
    return replace(fixes.take(fixed), values=np.column_stack([*enu, np.full((len(latitude), 4), np.nan)]))


def _headings(name: str, poses: Array, notes: list[str]) -> Array:
    """Headings (N,) of poses (N, 7), NaN where not measured, or where they mean nothing, with a note."""
    place, turn = poses[:, :2], poses[:, 3:]
    heading = np.full(len(poses), np.nan)
    if np.isnan(turn).all():
        return heading
    good = are_unit(turn)
    if good.mean() <= 0.5:
        notes.append(f"{name}: most of its quaternions are not of unit length: read without headings")
        return heading
    heading[good] = headings(turn[good], name, notes)
    known = heading[np.isfinite(heading)]
    placed = np.isfinite(place[:, 0])
    moves = not placed.any() or np.ptp(place[placed], axis=0).max() > _MIN_WAY
    if len(known) and np.ptp(known) == 0 and moves:
        notes.append(f"{name}: its heading never changes: read without headings")
        heading[:] = np.nan
    return heading


def headings(quaternion: Array, source: str, notes: list[str]) -> Array:
    """Headings (n,) of the x axes of rotations (n, 4), counter-clockwise from above [rad].

    NaN if most of them are tilted so much that the x axis shows no heading. `notes` gets a line for tilts above 20°.
    """
    heading, tilt = heading_and_tilt(Rotation.from_quat(quaternion))
    steep = tilt > MAX_TILT
    if not steep.any():
        return heading
    most = f"{np.degrees(tilt.max()):.0f}°"
    tilted = f"tilted by more than 20° in {int(steep.sum())} of {len(tilt)} poses, by up to {most}"
    if steep.mean() <= 0.5:
        notes.append(f"{source}: {tilted}: slip is identified in the plane")
        return heading
    notes.append(f"{source}: its frame is {tilted}: headings left out; is it a camera's frame, or has it z downwards?")
    return np.full(len(heading), np.nan)
