"""Angles of the sprockets from an odometry of the wheels: from the differences of its poses, with
its twists as a check.

Robots state the pose more reliably than the twist, which some publish in the world's frame, per
message or not at all.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from trackslip.bags.open import Bag
from trackslip.bags.stamps import Readings, seconds, without_bursts
from trackslip.bags.transforms import MAX_PLACE, are_unit, heading_and_tilt, pose_numbers
from trackslip.errors import LogError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.angles import odometry_angles, odometry_jump, odometry_speeds

_WINDOW: Final = 1.0  # duration of the motions in which pose and twist are compared [s]
_CONTRADICTS: Final = 0.1  # relative difference of motions above which pose and twist differ [-]
# a twist is per message if its motion is that of the pose times the interval of messages, within
# this relative error
_LIKE_INTERVAL: Final = 0.2
_MIN_DISTANCE: Final = 0.1  # rms distance per window below which distances aren't compared [m]
_MIN_TURN: Final = 0.1  # rms turn per window below which turns aren't compared [rad]


def odometry_angles_in(bag: Bag, topic: str, geometry: RobotGeometry, notes: list[str]) -> Readings:
    """Angles (n, 2) of the sprockets [rad] from which the odometry of a topic was computed with
    `geometry`.

    Adds a line to `notes` if the twist contradicts the pose, or is used because the pose never
    changes. Raises LogError if neither can be read, or the pose jumps.
    """
    read = bag.table(topic, _pose_and_twist).ascending(notes)
    read = read.take(without_bursts(read.stamp))
    place = read.values[:, :2]
    has_twist = np.isfinite(read.values[:, 7:]).all(axis=1)
    has_pose = are_unit(read.values[:, 3:7]) & (np.abs(place) <= MAX_PLACE).all(axis=1)
    posed = read.take(has_pose)
    twisted = read.take(has_twist)
    moves = twisted.values[:, [7, 9]].any()

    if has_pose.mean() <= 0.5 or not _changes(posed.values[:, :7]):
        if not moves or len(twisted.stamp) < 2:
            raise LogError(f"topic {topic}: neither its pose nor its twist ever changes")
        notes.append(
            f"topic {topic}: its pose never changes: speeds of the sprockets are from its twist"
        )
        time = seconds(twisted.stamp, int(twisted.stamp[0]))
        speeds = odometry_speeds(twisted.values[:, [7, 9]], geometry)
        return replace(twisted, values=cumulative_trapezoid(speeds, time, axis=0, initial=0.0))

    heading, _ = heading_and_tilt(Rotation.from_quat(posed.values[:, 3:7]))
    pose = np.column_stack([posed.values[:, :2], np.unwrap(heading)])
    time = seconds(posed.stamp, int(posed.stamp[0]))
    jump = odometry_jump(time, pose)
    if jump is not None:
        row, distance = jump
        raise LogError(
            f"topic {topic}: its pose jumps by {distance:.3g} m after {time[row]:.6g} s: was the "
            "odometry reset? Cut the bag there"
        )
    if has_twist[has_pose].all():
        contradiction = _contradiction(time, pose, posed.values[:, 7:])
        if contradiction:
            notes.append(
                f"topic {topic}: its twist contradicts its pose ({contradiction}): speeds of the "
                "sprockets are from its pose"
            )
    return replace(posed, values=odometry_angles(pose, geometry))


def _pose_and_twist(content: Any) -> tuple[float, ...]:
    """Position [m] and quaternion of an odometry, and its twist: forwards and to the left [m/s],
    and the yaw rate [rad/s].
    """
    pose = content.pose.pose
    twist = content.twist.twist
    numbers = pose_numbers(pose.position, pose.orientation)
    return (*numbers, twist.linear.x, twist.linear.y, twist.angular.z)


def _changes(rows: Array) -> bool:
    """True if numbers (n, k) aren't the same in all rows."""
    return bool(len(rows) and np.ptp(rows, axis=0).any())


def _contradiction(time: Array, pose: Array, twist: Array) -> str:
    """How twists (n, 3) differ from the motion of poses (n, 3), with the probable cause; empty if
    they agree.
    """
    if not twist[:, [0, 2]].any():
        return "it is 0"
    ends = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], _WINDOW)))
    if len(ends) < 3:
        return ""
    step = np.diff(pose[:, :2], axis=0)
    midway = (pose[:-1, 2] + pose[1:, 2]) / 2
    ahead = step[:, 0] * np.cos(midway) + step[:, 1] * np.sin(midway)
    distance = np.diff(np.append(0.0, np.cumsum(ahead))[ends])
    turn = np.diff(pose[ends, 2])

    by_twist = np.diff(cumulative_trapezoid(twist, time, axis=0, initial=0.0)[ends], axis=0)
    drives = np.sqrt(np.mean(distance**2)) > _MIN_DISTANCE
    turns = np.sqrt(np.mean(turn**2)) > _MIN_TURN
    differs = drives and _differ(by_twist[:, 0], distance)
    turns_differ = turns and _differ(by_twist[:, 2], turn)
    if not (differs or turns_differ):
        return ""

    interval = float(np.median(np.diff(time)))
    ratio = by_twist[:, 0] @ distance / (distance @ distance) if drives else np.nan
    turn_ratio = by_twist[:, 2] @ turn / (turn @ turn) if turns else np.nan
    ratios = np.array([each for each in (ratio, turn_ratio) if np.isfinite(each)])
    if (np.abs(ratios / interval - 1) < _LIKE_INTERVAL).all():
        return "it is per message, not per second"
    if not _differ(by_twist[:, 0], np.diff(pose[ends, 0])):
        return "it is in the world's frame, not the robot's"
    shown = [f"{ratio:.3g} times the distance"] if drives else []
    shown += [f"{turn_ratio:.3g} times the turn"] if turns else []
    return " and ".join(shown)


def _differ(motion: Array, other: Array) -> bool:
    """True if motions (n,) differ from other motions (n,) by more than chance."""
    return bool(np.linalg.norm(motion - other) > _CONTRADICTS * np.linalg.norm(other))
