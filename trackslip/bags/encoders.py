"""Sprocket speeds from the joint states, or the odometry from the wheels, in a bag."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from scipy.integrate import cumulative_trapezoid

from trackslip.bags.choice import AUTOMATIC, SIDES, BagChoice
from trackslip.bags.open import Bag, listed
from trackslip.bags.poses import Poses
from trackslip.bags.scans import Scans
from trackslip.bags.stamps import ascending, clock_parts, clocks_apart, require_overlap, seconds, without_bursts
from trackslip.bags.topics import WHEELS, Sides, encoder_topics
from trackslip.errors import LogError, counted
from trackslip.kinematics import Array, RobotGeometry, track_speeds

Seen = TypeVar("Seen", Poses, Scans)
_MAX_ANGLE = 1e9  # larger ones aren't measured [rad]
_TOLERANCE = 0.01  # by which wrapped positions may leave their range, as they are rounded [rad]
_MOVES = 1e-3  # speed above which a joint that reports it should move [rad/s]
_LEAP = 5.0  # speed of a leap by the usual largest speed
_STILL = 0.01  # way over that of the wheel that turns most, below which a wheel's encoder is dead [-]
_MIN_WAY = 1.0  # of the wheel that turns most, for a judgement [rad]


@dataclass(frozen=True)
class Encoders:
    """Readings of the encoders, all by one clock."""

    topic: str
    joints: Sides
    stamp: np.ndarray  # (T,) int: stamps in the headers, ascending [ns]
    delay: Array  # (N,) times from the messages' stamps to their recording [s]
    omega: Array  # (T, 2) sprocket speeds, mean since the previous reading, the first as the second [rad/s]

    @property
    def about(self) -> dict[str, Any]:
        """The topic and its joints, for the metadata of a run."""
        known = {"encoders": self.topic, "left": list(self.joints[0]), "right": list(self.joints[1])}
        return {**known, "odometry": True} if self.joints == WHEELS else known

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
        require_overlap(topic, turned.stamp, other, seen.stamp, clocks_apart(turned.delay, seen.delay))
        yield f"{name}, part {k}" if len(encoders) > 1 else name, turned, seen


def read_encoders(bag: Bag, choice: BagChoice = AUTOMATIC, notes: list[str] | None = None) -> list[Encoders]:
    """The encoders' readings, one for each stretch between restarts of their clock: nearly always one.

    Positions are preferred to velocities; the speeds of several joints on a side are averaged. `notes` gets a line for
    what is left out. Raises LogError if there are no encoders, or no telling which they are.
    """
    notes = [] if notes is None else notes
    topics, joints = encoder_topics(bag, choice)
    topic = " and ".join(each.name for each in topics)
    stamp, arrival, readings = _readings(bag, [each.name for each in topics], joints, choice.wheels)
    signs = np.array([-1.0 if choice.reversed in (side, "both") else 1.0 for side in SIDES])
    names = [name for side in joints for name in side]
    found = []
    for rows in clock_parts(topic, stamp, arrival, notes):
        angles = _angles(topic, names, stamp[rows], readings[rows], notes)
        common = _common([at for at, _ in angles.values()])
        if len(common) > 1:
            first = int(common[0])
            time = seconds(common, first)
            turns = {name: np.diff(np.interp(time, seconds(at, first), angle)) for name, (at, angle) in angles.items()}
            sides = [side_turns(topic, side, turns, notes) for side in joints]
            omega = np.stack(sides, axis=-1) / np.diff(time)[:, None] * signs
            delay = (arrival[rows] - stamp[rows]) / 1e9
            found.append(Encoders(topic, joints, common, delay, np.concatenate([omega[:1], omega])))
    if not found:
        raise LogError(f"{bag.path}: topic {topic}: fewer than 2 messages with the joints chosen")
    return found


def _readings(
    bag: Bag, topics: list[str], joints: Sides, wheels: RobotGeometry | None
) -> tuple[np.ndarray, np.ndarray, Array]:
    """Stamps and arrivals (N,) [ns] of the messages that name any of J joints, and their content (N, J, 3).

    The last axis is 1 if the joint is named, its position [rad] and its velocity [rad/s], NaN where not stated. Raises
    LogError for a joint that no message names.
    """
    chosen = [name for side in joints for name in side]
    known: dict[str, None] = {}

    def numbers(content: Any) -> list[float] | None:
        names, *fields = _joint_states(content, joints, wheels)
        known.update(dict.fromkeys(names))
        positions, velocities = (field if len(field) == len(names) else [np.nan] * len(names) for field in fields)
        of_name = {name: (1.0, *both) for name, *both in zip(names, positions, velocities, strict=True)}
        if of_name.keys().isdisjoint(chosen):
            return None
        return [value for name in chosen for value in of_name.get(name, (0.0, np.nan, np.nan))]

    stamp, arrival, table = bag.table(topics, numbers)
    for side, of_side in zip(SIDES, joints, strict=True):
        for name in of_side:
            if name not in known:
                source = f"topic {' and '.join(topics)}"
                raise LogError(f"{side} = {name!r}: {source} has no such joint; its joints are {listed([*known])}")
    readings = table.reshape(-1, len(chosen), 3)
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
        rows = rows[without_bursts(stamp[rows])]
        of_joint[name] = stamp[rows], values[rows, 1], values[rows, 2]
    if min(len(at) for at, *_ in of_joint.values()) < 2:
        return {}
    by_position = all(_has_places(position, velocity) for _, position, velocity in of_joint.values())
    angles = {}
    for name, (at, position, velocity) in of_joint.items():
        joint = f"topic {topic}: joint {name}"
        what, values = ("position", position) if by_position else ("velocity", velocity)
        known = np.isfinite(values)
        if not by_position and known.mean() <= 0.5:
            raise LogError(f"{joint} states neither positions nor velocities")
        if not known.all():
            notes.append(f"{joint}: {counted((~known).sum(), 'message')} without a {what} left out")
        time = seconds(at[known], int(stamp.min()))
        if by_position:
            angle = from_positions(joint, time, position[known], notes)
        else:
            angle = np.asarray(cumulative_trapezoid(velocity[known], time, initial=0.0))
        angles[name] = at[known], angle
    if not by_position and names != [name for side in WHEELS for name in side]:
        notes.append(f"topic {topic}: speeds are its velocities, because it states no positions")
    return angles


def _common(stamps: Sequence[np.ndarray]) -> np.ndarray:
    """Stamps (T,) [ns] of the joint with most readings, in the time that all joints cover."""
    if not stamps:
        return np.empty(0, np.int64)
    most = max(stamps, key=len)
    return most[(most >= max(at[0] for at in stamps)) & (most <= min(at[-1] for at in stamps))]


def _has_places(position: Array, velocity: Array) -> bool:
    """True if positions (T,) are measured: mostly finite, and not at rest while velocities (T,) aren't."""
    known = np.isfinite(position)
    if known.mean() <= 0.5:
        return False
    at_rest = bool(np.ptp(position[known]) == 0.0)
    return not (at_rest and np.abs(velocity[np.isfinite(velocity)]).max(initial=0.0) > _MOVES)


def from_positions(joint: str, time: Array, position: Array, notes: list[str]) -> Array:
    """Continuous angles (T,) [rad], 0 at first.

    Positions (T,) [rad] that stay within -π and π or 0 and 2π are unwrapped. A leap, as when an encoder is reset, is
    bridged at the speed around it; `notes` gets a line for that.
    """
    low, high = position.min(), position.max()
    if any(start - _TOLERANCE <= low and high <= start + 2 * np.pi + _TOLERANCE for start in (-np.pi, 0.0)):
        return np.unwrap(position) - position[0]
    step, interval = np.diff(position), np.diff(time)
    speed = step / interval
    usual = np.sort(np.abs(speed))[-max(4, len(speed) // 200) :][0]
    leap = (np.abs(speed) > _LEAP * usual) & (np.abs(step) > 2 * np.pi)
    if leap.any() and not leap.all():
        notes.append(f"{joint}: its position leaps {counted(leap.sum(), 'time')}: bridged")
        step[leap] = np.interp(np.flatnonzero(leap), np.flatnonzero(~leap), speed[~leap]) * interval[leap]
    return np.append(0.0, np.cumsum(step))


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
