"""Sprocket speeds from the joint states in a bag."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any, TypeVar

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.kinematics import Array, RobotGeometry, track_speeds
from trackslip.ros import joint_angles
from trackslip.ros.bag import Bag, listed
from trackslip.ros.choice import AUTOMATIC, SIDES, BagChoice
from trackslip.ros.joints import WHEELS, Sides, encoder_topics
from trackslip.ros.poses import Poses
from trackslip.ros.scans import Scans
from trackslip.ros.stamps import ascending, clock_parts, require_overlap, seconds

Seen = TypeVar("Seen", Poses, Scans)
_MAX_ANGLE = 1e9  # larger ones aren't measured [rad]


@dataclass(frozen=True)
class Encoders:
    """Readings of the encoders, all by one clock."""

    topic: str
    joints: Sides
    stamp: np.ndarray
    """(T,) int: stamps in the headers, ascending [ns]."""
    delay: float
    """Median time from the stamps to the recording [s]."""
    omega: Array
    """(T, 2): sprocket speeds, mean since the previous reading, the first as the second [rad/s]."""

    @property
    def about(self) -> dict[str, Any]:
        """The topic and its joints, for the metadata of a run."""
        return {"encoders": self.topic, "left": list(self.joints[0]), "right": list(self.joints[1])}

    @property
    def taken(self) -> str:
        """The topic and its joints, in words."""
        if self.joints == WHEELS:
            return f"encoders: odometry {self.topic}"
        left, right = (", ".join(side) for side in self.joints)
        return f"encoders: {self.topic}, left {left}, right {right}"


def by_drive(
    bag: Bag, name: str, encoders: Sequence[Encoders], others: Sequence[Seen]
) -> Iterator[tuple[str, Encoders, Seen]]:
    """Encoders and poses or scans of each drive in a bag called `name`, one unless its clock restarts.

    Raises LogError if they don't belong together.
    """
    topic, other = encoders[0].topic, others[0].source
    if len(encoders) != len(others):
        raise LogError(
            f"{bag.path}: time goes back {counted(len(encoders) - 1, 'time')} in topic {topic} "
            f"and {counted(len(others) - 1, 'time')} in {other}"
        )
    for k, (turned, seen) in enumerate(zip(encoders, others, strict=True), start=1):
        require_overlap(topic, turned.stamp, other, seen.stamp)
        yield f"{name}, part {k}" if len(encoders) > 1 else name, turned, seen


def read_encoders(bag: Bag, choice: BagChoice = AUTOMATIC, notes: list[str] | None = None) -> list[Encoders]:
    """The encoders' readings, one for each stretch between restarts of their clock: nearly always one.

    Positions are preferred to velocities; the speeds of several joints on a side are averaged. `notes` gets a line for
    what is left out. Raises LogError if there are no encoders, or no telling which they are.
    """
    notes = [] if notes is None else notes
    topics, joints = encoder_topics(bag, choice)
    topic = " and ".join(each.name for each in topics)
    stamp, arrival, readings = _readings(bag, [each.name for each in topics], joints, choice.wheels, notes)
    signs = np.array([-1.0 if choice.reversed in (side, "both") else 1.0 for side in SIDES])
    found = []
    for rows in clock_parts(topic, stamp, arrival, notes):
        names = [name for side in joints for name in side]
        angles = _angles(topic, names, stamp[rows], readings[rows], notes)
        common = _common(angles)
        if len(common) > 1:
            first = int(common[0])
            time = seconds(common, first)
            turns = {name: np.diff(np.interp(time, seconds(at, first), angle)) for name, (at, angle) in angles.items()}
            sides = [joint_angles.side_turns(topic, side, turns, notes) for side in joints]
            omega = np.stack(sides, axis=-1) / np.diff(time)[:, None] * signs
            delay = float(np.median(arrival[rows] - stamp[rows])) / 1e9
            found.append(Encoders(topic, joints, common, delay, np.concatenate([omega[:1], omega])))
    if not found:
        raise LogError(f"{bag.path}: topic {topic}: fewer than 2 messages with the joints chosen")
    return found


def _readings(
    bag: Bag, topics: list[str], joints: Sides, wheels: RobotGeometry | None, notes: list[str]
) -> tuple[np.ndarray, np.ndarray, Array]:
    """Stamps and arrivals (N,) [ns] of the messages that name any of J joints, and their content (N, J, 3).

    The last axis is 1 if the joint is named, its position [rad] and its velocity [rad/s], NaN where not stated. Raises
    LogError for a joint that no message names.
    """
    chosen = [name for side in joints for name in side]
    known: dict[str, None] = {}
    times, rows = [], []
    for message in bag.messages(*topics, notes=notes):
        names, *fields = _joint_states(message.content, joints, wheels)
        known |= dict.fromkeys(names)
        stated = [field.tolist() if len(field) == len(names) else [np.nan] * len(names) for field in fields]
        of_name = dict(zip(names, zip(repeat(1.0), *stated), strict=False))
        if not of_name.keys().isdisjoint(chosen):
            times.append((message.stamp, message.arrival))
            rows.append([of_name.get(name, (0.0, np.nan, np.nan)) for name in chosen])
    for side, of_side in zip(SIDES, joints, strict=True):
        for name in of_side:
            if name not in known:
                source = f"topic {' and '.join(topics)}"
                raise LogError(f"{side} = {name!r}: {source} has no such joint; its joints are {listed([*known])}")
    stamp, arrival = np.array(times, np.int64).T
    readings = np.array(rows, float)
    return stamp, arrival, np.where(np.abs(readings) <= _MAX_ANGLE, readings, np.nan)


def _joint_states(content: Any, joints: Sides, wheels: RobotGeometry | None) -> tuple[Sequence[str], Array, Array]:
    """Names (J,), positions (J,) [rad] and velocities (J,) [rad/s] in a message; empty where not stated."""
    if joints != WHEELS or wheels is None:
        return content.name, content.position, content.velocity
    twist = content.twist.twist
    speeds = track_speeds((twist.linear.x, twist.angular.z), wheels.half_gauge)
    return [*joints[0], *joints[1]], np.empty(0), speeds / wheels.sprocket_radius


def _angles(
    topic: str, names: list[str], stamp: np.ndarray, readings: Array, notes: list[str]
) -> dict[str, tuple[np.ndarray, Array]]:
    """Stamps (n,) [ns] and angles (n,) [rad] of each joint by name; empty if one has fewer than two readings."""
    of_joint = {}
    for name, values in zip(names, readings.swapaxes(0, 1), strict=True):
        named = np.flatnonzero(values[:, 0])
        rows = named[ascending(topic, stamp[named], notes)]
        of_joint[name] = stamp[rows], values[rows, 1], values[rows, 2]
    if min(len(at) for at, *_ in of_joint.values()) < 2:
        return {}
    by_position = all(joint_angles.has_positions(position, velocity) for _, position, velocity in of_joint.values())
    angles = {}
    for name, (at, position, velocity) in of_joint.items():
        joint = f"topic {topic}: joint {name}"
        values = position if by_position else velocity
        known = np.isfinite(values)
        if not by_position and known.mean() <= 0.5:
            raise LogError(f"{joint} states neither positions nor velocities")
        if not known.all():
            what = "position" if by_position else "velocity"
            notes.append(f"{joint}: {counted((~known).sum(), 'message')} without a {what} left out")
        time = seconds(at[known], int(stamp.min()))
        if by_position:
            angle = joint_angles.from_positions(joint, time, position[known], velocity[known], notes)
        else:
            angle = joint_angles.from_velocities(time, velocity[known])
        angles[name] = at[known], angle
    if not by_position and names != [name for side in WHEELS for name in side]:
        notes.append(f"topic {topic}: speeds are its velocities, because it states no positions")
    return angles


def _common(angles: dict[str, tuple[np.ndarray, Array]]) -> np.ndarray:
    """Stamps (T,) [ns] of the joint with most readings, in the time that all joints cover."""
    stamps = [at for at, _ in angles.values()]
    if not stamps:
        return np.empty(0, np.int64)
    most = max(stamps, key=len)
    return most[(most >= max(at[0] for at in stamps)) & (most <= min(at[-1] for at in stamps))]
