"""Sprocket speeds from the joint states or the wheel odometry in a bag."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from trackslip.bags.choice import SIDES, BagChoice
from trackslip.bags.open import Bag, listed
from trackslip.bags.stamps import Readings, seconds, without_bursts
from trackslip.bags.topics import WHEELS, Sides, encoder_topics
from trackslip.errors import LogError
from trackslip.kinematics import Array, RobotGeometry, track_speeds
from trackslip.logs.runlog import RunLog

_MAX_ANGLE = 1e9  # angle above which a value isn't a measurement [rad]
# margin by which wrapped positions may leave their range because of rounding [rad]
_TOLERANCE = 0.01
_MOVES = 1e-3  # reported speed above which a joint should move [rad/s]
# ratio to the largest turn of a wheel on the same side, below which an encoder counts as dead [-]
_STILL = 0.01
_MIN_WAY = 1.0  # largest turn of a wheel up to which no encoder counts as dead [rad]


@dataclass(frozen=True)
class Encoders(Readings):
    """Sprocket speeds (T, 2), means since the previous reading [rad/s]; the first reading equals
    the second.
    """

    joints: Sides

    @property
    def turned(self) -> Array:
        """Angles (T, 2) of the sprockets, starting at 0 [rad]."""
        steps = self.values[1:] * np.diff(self.stamp)[:, None] / 1e9
        return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])

    @property
    def about(self) -> dict[str, Any]:
        """The topic and its joints, for a run's metadata."""
        known = {
            "encoders": self.source,
            "left": list(self.joints[0]),
            "right": list(self.joints[1]),
        }
        return {**known, "odometry": True} if self.joints == WHEELS else known

    @property
    def taken(self) -> str:
        """The topic and its joints, in words."""
        if self.joints == WHEELS:
            return f"encoders: odometry {self.source}"
        left, right = (", ".join(side) for side in self.joints)
        return f"encoders: {self.source}, left {left}, right {right}"


def read_encoders(bag: Bag, choice: BagChoice, notes: list[str]) -> Encoders:
    """Read the encoders in a bag.

    Positions are preferred to velocities; speeds are averaged over the joints on a side. Adds a
    line to `notes` for each part left out. Raises LogError if there are no encoders, or if their
    topics or joints are ambiguous.
    """
    topics, names = encoder_topics(bag, choice)
    joints = _joints(bag, [topic.name for topic in topics], names, choice.wheels, notes)
    topic = next(iter(joints.values())).source
    by_position = all(_has_positions(*joint.values.T) for joint in joints.values())
    if not by_position and names != WHEELS:
        notes.append(f"topic {topic}: speeds are its velocities, because it states no positions")
    angles = {name: _angles(name, joint, by_position) for name, joint in joints.items()}
    most = max(angles.values(), key=lambda angle: len(angle.stamp))
    begin, end = (
        max(angle.stamp[0] for angle in angles.values()),
        min(angle.stamp[-1] for angle in angles.values()),
    )
    common = most.take((most.stamp >= begin) & (most.stamp <= end))
    if len(common.stamp) < 2:
        raise LogError(f"{bag.path}: topic {topic}: fewer than 2 messages with the joints chosen")
    first = int(common.stamp[0])
    time = seconds(common.stamp, first)
    turns = {
        name: np.diff(np.interp(time, seconds(a.stamp, first), a.values))
        for name, a in angles.items()
    }
    signs = np.array([-1.0 if choice.reversed in (side, "both") else 1.0 for side in SIDES])
    turned = np.stack([side_turns(topic, side, turns, notes) for side in names], axis=-1)
    omega = turned / np.diff(time)[:, None] * signs
    return Encoders(topic, common.stamp, common.arrival, np.concatenate([omega[:1], omega]), names)


def _joints(
    bag: Bag, topics: Sequence[str], names: Sides, wheels: RobotGeometry | None, notes: list[str]
) -> dict[str, Readings]:
    """Read positions [rad] and velocities [rad/s] (N, 2) of each joint by name; NaN where not
    measured.

    Raises LogError for a joint that is not in any message.
    """

    def states(content: Any) -> Iterable[tuple[str, Any, tuple[float, float]]]:
        if names == WHEELS and wheels is not None:
            twist = content.twist.twist
            speeds = (
                track_speeds((twist.linear.x, twist.angular.z), wheels.half_gauge)
                / wheels.sprocket_radius
            )
            return (
                (name, content.header, (np.nan, speed))
                for (name,), speed in zip(names, speeds, strict=True)
            )
        none = np.full(len(content.name), np.nan)
        position, velocity = (
            x if len(x) == len(none) else none for x in (content.position, content.velocity)
        )
        return (
            (name, content.header, (p, v))
            for name, p, v in zip(content.name, position, velocity, strict=True)
        )

    stated, joints = bag.readings(topics, states), {}
    for side, of_side in zip(SIDES, names, strict=True):
        for name in of_side:
            if name not in stated:
                have = (
                    f"topic {' and '.join(topics)} has no such joint; its joints are "
                    f"{listed([*stated])}"
                )
                raise LogError(f"{side} = {name!r}: {have}")
            joint = stated[name].ascending(notes)
            measured = np.abs(joint.values) <= _MAX_ANGLE
            joints[name] = replace(joint, values=np.where(measured, joint.values, np.nan))
    return joints


def _has_positions(position: Array, velocity: Array) -> bool:
    """True if a joint's positions (N,) are measured: mostly finite, and not constant while
    velocities (N,) aren't 0.
    """
    known = position[np.isfinite(position)]
    if 2 * len(known) <= len(position):
        return False
    return bool(np.ptp(known) > 0 or not (np.abs(velocity) > _MOVES).any())


def _angles(name: str, joint: Readings, by_position: bool) -> Readings:
    """Angles (n,) of a joint [rad]; raises LogError if most messages have neither positions nor
    velocities.
    """
    values = joint.values[:, 0 if by_position else 1]
    rows = np.flatnonzero(np.isfinite(values))
    if 2 * len(rows) <= len(values):
        raise LogError(
            f"topic {joint.source}: joint {name} states neither positions nor velocities"
        )
    rows = rows[without_bursts(joint.stamp[rows])]
    time = seconds(joint.stamp[rows], int(joint.stamp[rows[0]]))
    angle = (
        unwrapped(values[rows])
        if by_position
        else cumulative_trapezoid(values[rows], time, initial=0.0)
    )
    return replace(joint.take(rows), values=angle)


def unwrapped(position: Array) -> Array:
    """Continuous angles (T,) from positions (T,) [rad]: positions within -π to π or 0 to 2π are
    unwrapped.
    """
    low, high = position.min(), position.max()
    wraps = any(
        start - _TOLERANCE <= low and high <= start + 2 * np.pi + _TOLERANCE
        for start in (-np.pi, 0.0)
    )
    return np.unwrap(position) if wraps else position


def side_turns(
    topic: str, side: Sequence[str], turns: Mapping[str, Array], notes: list[str]
) -> Array:
    """Mean turns (n,) [rad] of the wheels on a side in each interval, from the `turns` of each
    joint.

    An encoder that stands still while other wheels turn is left out, with a line in `notes`. Raises
    LogError, with topic and joints, if wheels turn against each other.
    """
    ways = {name: float(np.abs(turns[name]).sum()) for name in side}
    most = max(ways, key=lambda name: ways[name])
    kept = list(side)
    if ways[most] > _MIN_WAY:
        kept = [name for name in side if ways[name] >= _STILL * ways[most]]
        for name in side:
            if name not in kept:
                notes.append(
                    f"topic {topic}: joint {name} left out: it stands still while {most} turns"
                )
            elif 2 * turns[name] @ turns[most] < -np.linalg.norm(turns[name]) * np.linalg.norm(
                turns[most]
            ):
                raise LogError(
                    f"topic {topic}: joints {most} and {name} of one side turn against each other: "
                    "choose with --left NAMES --right NAMES"
                )
    return np.asarray(np.mean([turns[name] for name in kept], axis=0))


def joined(name: str, encoders: Encoders, poses: Readings) -> RunLog:
    """Join encoders and poses (N, 3) in a log, with a row for each encoder reading and for each
    pose between readings.

    A pose's row has the sprocket speeds of the next reading.
    """
    read, start = encoders.stamp, int(encoders.stamp[0])
    measured = np.isfinite(poses.values).any(axis=1)
    within = measured & (poses.stamp >= read[0]) & (poses.stamp <= read[-1])
    stamp = np.union1d(read, poses.stamp[within])
    valid = np.isin(stamp, poses.stamp[within])
    pose = np.full((len(stamp), 3), np.nan)
    pose[valid] = poses.values[within]
    headed = np.isfinite(pose[:, 2])
    pose[headed, 2] = np.unwrap(pose[headed, 2])
    others = np.column_stack([seconds(poses.stamp, start), poses.values])[measured & ~within]
    return RunLog(
        run=name,
        time=seconds(stamp, start),
        omega=encoders.values[np.searchsorted(read, stamp)],
        pose=pose,
        valid=None if valid.all() else valid,
        read=None if len(stamp) == len(read) else np.isin(stamp, read),
        beyond=others if len(others) else None,
        metadata={"bag": {**encoders.about, "poses": poses.source, "start": start / 1e9}},
    )
