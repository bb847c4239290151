"""Sprocket speeds from the joint states in a bag."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.ros import angles
from trackslip.ros.bag import Bag, Topic
from trackslip.ros.choice import AUTOMATIC, BagChoice
from trackslip.ros.joints import known_joints, listed, sides
from trackslip.ros.stamps import ascending, clock_parts, seconds
from trackslip.ros.wheels import side_turns

JOINT_STATE = "sensor_msgs/msg/JointState"
_COMMANDS = re.compile(r"command|cmd|desired|target|setpoint|reference|goal", re.IGNORECASE)
_MAX_ANGLE = 1e9  # larger ones aren't measured [rad]
_LOOKED_AT = 100  # messages whose joints are looked at to choose a topic


@dataclass(frozen=True)
class Encoders:
    """Readings of the encoders, all by one clock."""

    topic: str
    joints: tuple[tuple[str, ...], tuple[str, ...]]
    """Names of the joints on the left and on the right."""
    stamp: np.ndarray
    """(T,) int: stamps in the headers, ascending [ns]."""
    delay: float
    """Median time from the stamps to the recording [s]."""
    omega: Array
    """(T, 2): sprocket speeds, mean since the previous reading, the first as the second [rad/s]."""


@dataclass(frozen=True)
class _Joint:
    """What messages say of a joint."""

    row: np.ndarray  # (n,) of the messages that name it
    position: Array  # (n,) [rad]; NaN if not stated
    velocity: Array  # (n,) [rad/s]; NaN if not stated


def encoder_topic(bag: Bag, choice: BagChoice = AUTOMATIC) -> tuple[Topic, tuple[tuple[str, ...], tuple[str, ...]]]:
    """The topic with the encoders, and the joints on the left and on the right.

    Raises LogError if the choice doesn't fit the bag, or leaves a doubt: the message lists what there is.
    """
    if choice.encoders is not None:
        topic = bag.topic(choice.encoders)
        if topic.type != JOINT_STATE:
            raise LogError(f"{bag.path}: topic {topic.name} has messages of {topic.type}, needs {JOINT_STATE}")
        return topic, _joints(bag, topic, choice)
    topics = bag.of_type(JOINT_STATE)
    if not topics:
        raise LogError(f"{bag.path}: no encoders: no topic of {JOINT_STATE}; its topics are {bag.listed(bag.topics)}")
    fitting, reasons = [], []
    for topic in topics:
        try:
            fitting.append((topic, _joints(bag, topic, choice)))
        except LogError as error:
            reasons.append(str(error))
    if not fitting:
        raise LogError(reasons[0])
    measured = [one for one in fitting if not _COMMANDS.search(one[0].name)] or fitting
    usual = [one for one in measured if one[0].name.rpartition("/")[2] == "joint_states"] or measured
    usual = [one for one in usual if one[0].name.strip("/") == "joint_states"] or usual
    if len(usual) > 1:
        names = ", ".join(topic.name for topic, _ in usual)
        raise LogError(f"{bag.path}: encoders may be {names}: choose with --encoders TOPIC")
    return usual[0]


def read_encoders(bag: Bag, choice: BagChoice = AUTOMATIC, notes: list[str] | None = None) -> list[Encoders]:
    """The encoders' readings, one for each stretch between restarts of their clock: nearly always one.

    Positions are preferred to velocities; the speeds of several joints on a side are averaged. `notes` gets a line for
    what is left out. Raises LogError if there are no encoders, or no telling which they are.
    """
    notes = [] if notes is None else notes
    topic, joints = encoder_topic(bag, choice)
    stamp, arrival, told = _messages(bag, topic, notes)
    for side, names in zip(("left", "right"), joints, strict=True):
        known_joints(names, list(told), side, topic.name)
    signs = np.array([-1.0 if choice.reversed in (side, "both") else 1.0 for side in ("left", "right")])
    found = []
    used = np.unique(np.concatenate([told[name].row for side in joints for name in side]))
    for part in clock_parts(topic.name, stamp[used], arrival[used], notes):
        rows = used[part]
        one = _speeds(topic.name, stamp, rows, joints, told, notes)
        if one is not None:
            delay = float(np.median(arrival[rows] - stamp[rows])) / 1e9
            found.append(Encoders(topic.name, joints, one[0], delay, one[1] * signs))
    if not found:
        raise LogError(f"{bag.path}: topic {topic.name}: fewer than 2 messages with the joints chosen")
    return found


def _joints(bag: Bag, topic: Topic, choice: BagChoice) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The joints chosen, or those whose names tell; LogError if there are none."""
    names: dict[str, None] = {}
    for message in bag.first(topic.name, _LOOKED_AT):
        names |= dict.fromkeys(message.content.name)
    if choice.left is not None and choice.right is not None:
        return choice.left, choice.right
    found = sides(list(names))
    if found is None:
        raise LogError(
            f"{bag.path}: topic {topic.name}: which of its joints are left and right? It has {listed(list(names))}: "
            "choose with --left NAMES --right NAMES"
        )
    return found


def _messages(bag: Bag, topic: Topic, notes: list[str]) -> tuple[np.ndarray, np.ndarray, dict[str, _Joint]]:
    """Stamps and arrivals (N,) [ns] of the messages, and what they say of each joint."""
    stamps, arrivals = [], []
    layouts: dict[tuple[str, ...], list[tuple[int, Array, Array]]] = defaultdict(list)
    for k, message in enumerate(bag.messages(topic.name, notes=notes)):
        content = message.content
        stamps.append(message.stamp)
        arrivals.append(message.arrival)
        layouts[tuple(content.name)].append((k, content.position, content.velocity))
    joints: dict[str, list[tuple[np.ndarray, Array, Array]]] = defaultdict(list)
    for names, told in layouts.items():
        rows = np.array([row for row, *_ in told])
        position = _block([one[1] for one in told], len(names))
        velocity = _block([one[2] for one in told], len(names))
        for place, name in enumerate(names):
            joints[name].append((rows, position[:, place], velocity[:, place]))
    merged = {}
    for name, parts in joints.items():
        rows, position, velocity = (np.concatenate(part) for part in zip(*parts, strict=True))
        merged[name] = _Joint(rows, position, velocity)
    return np.array(stamps, np.int64), np.array(arrivals, np.int64), merged


def _block(values: list[Array], width: int) -> Array:
    """Values (n, width); NaN where absurd, and in rows of another width, which state nothing."""
    block = np.array([row if len(row) == width else np.full(width, np.nan) for row in values]).reshape(-1, width)
    return np.where(np.abs(block) <= _MAX_ANGLE, block, np.nan)


def _speeds(
    topic: str,
    stamp: np.ndarray,
    rows: np.ndarray,
    joints: tuple[tuple[str, ...], tuple[str, ...]],
    told: dict[str, _Joint],
    notes: list[str],
) -> tuple[np.ndarray, Array] | None:
    """Stamps (T,) [ns] and mean speeds (T, 2) of both sides; None if there are fewer than two readings."""
    chosen = {}
    for name in (name for side in joints for name in side):
        there = _within(told[name], rows, len(stamp))
        kept = ascending(topic, stamp[there.row], notes)
        chosen[name] = _Joint(there.row[kept], there.position[kept], there.velocity[kept])
    if min(len(joint.row) for joint in chosen.values()) < 2:
        return None
    by_position = all(angles.has_positions(joint.position, joint.velocity) for joint in chosen.values())
    origin = int(stamp[rows].min())
    turned: dict[str, tuple[np.ndarray, Array]] = {}
    for name, joint in chosen.items():
        values = joint.position if by_position else joint.velocity
        if not by_position and not angles.has_velocities(values):
            raise LogError(f"topic {topic}: joint {name} states neither positions nor velocities")
        known = np.isfinite(values)
        if not known.all():
            what = "position" if by_position else "velocity"
            notes.append(f"topic {topic}: joint {name}: {(~known).sum()} messages without a {what} left out")
        at = stamp[joint.row[known]]
        time = seconds(at, origin)
        if by_position:
            angle, leaps = angles.from_positions(time, values[known], joint.velocity[known])
            if leaps:
                notes.append(f"topic {topic}: joint {name}: its position leaps {leaps} time(s): bridged")
            ratio = angles.speed_ratio(time, angle, joint.velocity[known])
            if np.isfinite(ratio) and not angles.LIKE[0] < ratio < angles.LIKE[1]:
                line = f"its positions turn {ratio:.3g} times as fast as its velocities say: positions are taken"
                notes.append(f"topic {topic}: joint {name}: {line}")
        else:
            angle = angles.from_velocities(time, values[known])
        turned[name] = at, angle
    if not by_position:
        notes.append(f"topic {topic}: speeds are its velocities, because it states no positions")
    return _sides(topic, turned, joints, notes)


def _within(joint: _Joint, rows: np.ndarray, count: int) -> _Joint:
    """What is said of a joint in `rows` alone, in their order; `count` is the number of all messages."""
    place = np.full(count, -1)
    place[joint.row] = np.arange(len(joint.row))
    kept = place[rows]
    kept = kept[kept >= 0]
    return _Joint(joint.row[kept], joint.position[kept], joint.velocity[kept])


def _sides(
    topic: str,
    turned: dict[str, tuple[np.ndarray, Array]],
    joints: tuple[tuple[str, ...], tuple[str, ...]],
    notes: list[str],
) -> tuple[np.ndarray, Array] | None:
    """Mean speeds (T, 2) between the readings of the joint that has most, where all joints have some."""
    at = max((stamps for stamps, _ in turned.values()), key=len)
    first = max(int(stamps[0]) for stamps, _ in turned.values())
    last = min(int(stamps[-1]) for stamps, _ in turned.values())
    at = at[(at >= first) & (at <= last)]
    if len(at) < 2:
        return None
    time = seconds(at, first)
    turns = {name: np.diff(np.interp(time, seconds(stamps, first), angle)) for name, (stamps, angle) in turned.items()}
    mean = np.stack([side_turns(topic, side, turns, notes) for side in joints], axis=-1)
    omega = mean / np.diff(time)[:, None]
    return at, np.concatenate([omega[:1], omega])
