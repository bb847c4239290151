"""Sprocket speeds from the joint states, or the odometry from the wheels, in a bag."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from trackslip.bags.choice import SIDES, BagChoice
from trackslip.bags.open import Bag, listed
from trackslip.bags.poses import Poses
from trackslip.bags.stamps import Stamped, ascending, seconds, without_bursts
from trackslip.bags.topics import WHEELS, Sides, encoder_topics
from trackslip.errors import LogError
from trackslip.kinematics import Array, RobotGeometry, track_speeds
from trackslip.logs.runlog import RunLog

_MAX_ANGLE = 1e9  # larger ones aren't measured [rad]
_TOLERANCE = 0.01  # by which wrapped positions may leave their range, as they are rounded [rad]
_MOVES = 1e-3  # speed above which a joint that reports it should move [rad/s]
_STILL = 0.01  # way over that of the wheel that turns most, below which a wheel's encoder is dead [-]
_MIN_WAY = 1.0  # of the wheel that turns most, for a judgement [rad]


@dataclass(frozen=True)
class Encoders(Stamped):
    """Readings of the encoders."""

    joints: Sides
    omega: Array  # (T, 2) sprocket speeds, mean since the previous reading, the first as the second [rad/s]

    @property
    def turned(self) -> Array:
        """(T, 2) angles of the sprockets [rad], 0 at first."""
        steps = self.omega[1:] * np.diff(self.stamp)[:, None] / 1e9
        return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])

    @property
    def about(self) -> dict[str, Any]:
        """The topic and its joints, for the metadata of a run."""
        known = {"encoders": self.source, "left": list(self.joints[0]), "right": list(self.joints[1])}
        return {**known, "odometry": True} if self.joints == WHEELS else known

    @property
    def taken(self) -> str:
        """The topic and its joints, in words."""
        if self.joints == WHEELS:
            return f"encoders: odometry {self.source}"
        left, right = (", ".join(side) for side in self.joints)
        return f"encoders: {self.source}, left {left}, right {right}"


@dataclass(frozen=True)
class _Joint:
    """Readings of a joint, by ascending stamp."""

    stamp: np.ndarray  # (N,) int [ns]
    delay: Array  # (N,) from the stamp to the recording [s]
    position: Array  # (N,) [rad]; NaN where not measured
    velocity: Array  # (N,) [rad/s]; likewise

    @property
    def has_positions(self) -> bool:
        """True if positions are measured: mostly finite, and not at rest while velocities aren't."""
        known = self.position[np.isfinite(self.position)]
        if 2 * len(known) <= len(self.position):
            return False
        return bool(np.ptp(known) > 0 or not (np.abs(self.velocity) > _MOVES).any())

    def angles(self, by_position: bool) -> tuple[np.ndarray, Array]:
        """Stamps (n,) [ns] and angles (n,) [rad], none if hardly any are stated."""
        values = self.position if by_position else self.velocity
        rows = np.flatnonzero(np.isfinite(values))
        if 2 * len(rows) <= len(values):
            return self.stamp[:0], values[:0]
        rows = rows[without_bursts(self.stamp[rows])]
        stamp = self.stamp[rows]
        if by_position:
            return stamp, unwrapped(values[rows])
        return stamp, np.asarray(cumulative_trapezoid(values[rows], seconds(stamp, int(stamp[0])), initial=0.0))


def read_encoders(bag: Bag, choice: BagChoice, notes: list[str]) -> Encoders:
    """The encoders' readings.

    Positions are preferred to velocities; the speeds of several joints on a side are averaged. `notes` gets a line for
    what is left out. Raises LogError if there are no encoders, or no telling which they are.
    """
    topics, names = encoder_topics(bag, choice)
    topic = " and ".join(each.name for each in topics)
    joints = _joints(bag, topic, [each.name for each in topics], names, choice.wheels, notes)
    by_position = all(joint.has_positions for joint in joints.values())
    if not by_position and names != WHEELS:
        notes.append(f"topic {topic}: speeds are its velocities, because it states no positions")
    angles = {name: joint.angles(by_position) for name, joint in joints.items()}
    for name, (stamp, _) in angles.items():
        if not len(stamp):
            raise LogError(f"topic {topic}: joint {name} states neither positions nor velocities")
    stamp = _common([at for at, _ in angles.values()])
    if len(stamp) < 2:
        raise LogError(f"{bag.path}: topic {topic}: fewer than 2 messages with the joints chosen")
    first = int(stamp[0])
    time = seconds(stamp, first)
    turns = {name: np.diff(np.interp(time, seconds(at, first), angle)) for name, (at, angle) in angles.items()}
    signs = np.array([-1.0 if choice.reversed in (side, "both") else 1.0 for side in SIDES])
    turned = np.stack([side_turns(topic, side, turns, notes) for side in names], axis=-1)
    omega = turned / np.diff(time)[:, None] * signs
    delay = np.concatenate([joint.delay for joint in joints.values()])
    return Encoders(topic, stamp, delay, names, np.concatenate([omega[:1], omega]))


def _joints(
    bag: Bag, source: str, topics: Sequence[str], names: Sides, wheels: RobotGeometry | None, notes: list[str]
) -> dict[str, _Joint]:
    """The readings of the joints; raises LogError for a joint that no message names."""
    rows: dict[str, list[tuple[float, ...]]] = {}
    for message in bag.messages(*topics):
        times = message.stamp, message.arrival
        for name, position, velocity in _joint_states(message.content, names, wheels):
            rows.setdefault(name, []).append((*times, position, velocity))
    joints = {}
    for side, of_side in zip(SIDES, names, strict=True):
        for name in of_side:
            if name not in rows:
                have = f"topic {source} has no such joint; its joints are {listed([*rows])}"
                raise LogError(f"{side} = {name!r}: {have}")
            stamp, arrival = np.array([row[:2] for row in rows[name]], np.int64).T
            values = np.array([row[2:] for row in rows[name]], float).T
            values = np.where(np.abs(values) <= _MAX_ANGLE, values, np.nan)
            kept = ascending(source, stamp, arrival, notes)
            joints[name] = _Joint(stamp[kept], (arrival - stamp)[kept] / 1e9, *values[:, kept])
    return joints


def _joint_states(content: Any, names: Sides, wheels: RobotGeometry | None) -> Iterable[tuple[str, float, float]]:
    """Name, position [rad] and velocity [rad/s] of each joint in a message; NaN where not stated."""
    if names == WHEELS and wheels is not None:
        twist = content.twist.twist
        speeds = track_speeds((twist.linear.x, twist.angular.z), wheels.half_gauge) / wheels.sprocket_radius
        return zip((*names[0], *names[1]), (np.nan, np.nan), speeds, strict=True)
    none = np.full(len(content.name), np.nan)
    fields = (field if len(field) == len(none) else none for field in (content.position, content.velocity))
    return zip(content.name, *fields, strict=True)


def _common(stamps: Sequence[np.ndarray]) -> np.ndarray:
    """Stamps (T,) [ns] of the joint with most readings, in the time that all joints cover."""
    most = max(stamps, key=len)
    return most[(most >= max(at[0] for at in stamps)) & (most <= min(at[-1] for at in stamps))]


def unwrapped(position: Array) -> Array:
    """Continuous angles (T,) from positions (T,) [rad], which are unwrapped if they stay in -π to π or 0 to 2π."""
    low, high = position.min(), position.max()
    wraps = any(start - _TOLERANCE <= low and high <= start + 2 * np.pi + _TOLERANCE for start in (-np.pi, 0.0))
    return np.unwrap(position) if wraps else position


def side_turns(topic: str, side: Sequence[str], turns: Mapping[str, Array], notes: list[str]) -> Array:
    """Mean turns (n,) [rad] in each interval of the wheels of a side, of those `turns` that are measured.

    An encoder that stands still while others turn is left out, with a note. Raises LogError, with the topic and the
    names, if wheels turn against each other.
    """
    ways = {name: float(np.abs(turns[name]).sum()) for name in side}
    most = max(ways, key=lambda name: ways[name])
    kept = list(side)
    if ways[most] > _MIN_WAY:
        kept = [name for name in side if ways[name] >= _STILL * ways[most]]
        for name in side:
            if name not in kept:
                notes.append(f"topic {topic}: joint {name} left out: it stands still while {most} turns")
            elif 2 * turns[name] @ turns[most] < -np.linalg.norm(turns[name]) * np.linalg.norm(turns[most]):
                raise LogError(
                    f"topic {topic}: joints {most} and {name} of one side turn against each other: "
                    "choose with --left NAMES --right NAMES"
                )
    return np.asarray(np.mean([turns[name] for name in kept], axis=0))


def joined(name: str, encoders: Encoders, poses: Poses) -> RunLog:
    """A row for each reading of the encoders and for each pose between the first and the last of these.

    Poses take the speeds of the next reading.
    """
    read, start = encoders.stamp, int(encoders.stamp[0])
    measured = np.isfinite(poses.pose).any(axis=1)
    within = measured & (poses.stamp >= read[0]) & (poses.stamp <= read[-1])
    stamp = np.union1d(read, poses.stamp[within])
    valid = np.isin(stamp, poses.stamp[within])
    pose = np.full((len(stamp), 3), np.nan)
    pose[valid] = poses.pose[within]
    headed = np.isfinite(pose[:, 2])
    pose[headed, 2] = np.unwrap(pose[headed, 2])
    others = np.column_stack([seconds(poses.stamp, start), poses.pose])[measured & ~within]
    return RunLog(
        run=name,
        time=seconds(stamp, start),
        omega=encoders.omega[np.searchsorted(read, stamp)],
        pose=pose,
        valid=None if valid.all() else valid,
        beyond=others if len(others) else None,
        metadata={"bag": {**encoders.about, "poses": poses.source, "start": start / 1e9}},
    )
