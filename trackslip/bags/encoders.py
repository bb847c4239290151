"""Sprocket speeds from the joint states, the counters or the wheel odometry in a bag."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from scipy.integrate import cumulative_trapezoid

from trackslip.bags.choice import SIDES, BagChoice
from trackslip.bags.counters import numbers_in
from trackslip.bags.open import Bag, Topic, header_of, listed
from trackslip.bags.stamps import Readings, seconds, without_bursts
from trackslip.bags.topics import JOINT_STATE, WHEELS, Sides, encoder_topics
from trackslip.bags.wheel_odometry import odometry_angles_in
from trackslip.errors import LogError, require
from trackslip.kinematics import Array
from trackslip.logs.angles import COUNTERS, continuous, mean_speeds, unwrapped_angle
from trackslip.logs.layout import AS_DOCUMENTED, Layout, known_odometry, known_ticks
from trackslip.logs.repeats import angle_readings
from trackslip.logs.runlog import RunLog

_MAX_ANGLE: Final = 1e9  # angle above which a value isn't a measurement [rad]
_MOVES: Final = 1e-3  # reported speed above which a joint should move [rad/s]
# ratio to the largest turn of a wheel on the same side, below which an encoder counts as dead [-]
_STILL: Final = 0.01
_MIN_TURN: Final = 1.0  # largest turn of a wheel up to which no encoder counts as dead [rad]


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


def read_encoders(
    bag: Bag, choice: BagChoice, notes: list[str], layout: Layout = AS_DOCUMENTED
) -> Encoders:
    """Read the encoders in a bag.

    Positions are preferred to velocities; speeds are averaged over the joints on a side. Adds a
    line to `notes` for each part left out. Raises LogError if there are no encoders, or if their
    topics or joints are ambiguous; InvalidValueError if the `layout` lacks ticks per turn or the
    odometry's geometry.
    """
    topics, names = encoder_topics(bag, choice)
    is_odometry = names == WHEELS
    is_joints = topics[0].type == JOINT_STATE
    stated = f"topic {topics[0].name} states " + ("an odometry" if is_odometry else "angles")
    if is_odometry or is_joints:
        ticks = layout.ticks_per_turn
        require(ticks is None, "ticks_per_turn", ticks, f"left out: {stated}")
    if not is_odometry:
        odometry = layout.odometry
        require(odometry is None, "odometry", odometry, f"left out: {stated}, no odometry")
    if is_odometry:
        geometry = known_odometry(layout, f"the speeds of topic {topics[0].name}")
        by_side = odometry_angles_in(bag, topics[0].name, geometry, notes)
        angles = {
            name: replace(by_side, values=by_side.values[:, side])
            for side, (name,) in enumerate(names)
        }
    elif is_joints:
        angles = _joint_angles(bag, topics, names, notes)
    else:
        angles = _counter_angles(bag, topics, names, known_ticks(layout), notes)
    topic = next(iter(angles.values())).source

    # readings at the times of the joint that is read most often, where all joints are known
    most = max(angles.values(), key=lambda angle: len(angle.stamp))
    begin = max(angle.stamp[0] for angle in angles.values())
    end = min(angle.stamp[-1] for angle in angles.values())
    common = most.take((most.stamp >= begin) & (most.stamp <= end))
    if len(common.stamp) < 2:
        raise LogError(f"{bag.path}: topic {topic}: fewer than 2 messages with the joints chosen")
    first = int(common.stamp[0])
    time = seconds(common.stamp, first)
    turns = {
        name: np.diff(np.interp(time, seconds(angle.stamp, first), angle.values))
        for name, angle in angles.items()
    }

    signs = np.array([-1.0 if choice.reversed in (side, "both") else 1.0 for side in SIDES])
    turned = np.stack([side_turns(topic, side, turns, notes) for side in names], axis=-1)
    angle = np.concatenate([np.zeros((1, 2)), np.cumsum(turned * signs, axis=0)])
    # messages may come more often than the encoders are read
    once = angle_readings(time, angle)
    if once is not None:
        notes.append(
            f"topic {topic}: each encoder reading is repeated in {len(time) / len(once):.2g} "
            "messages: it counts once"
        )
        common = common.take(once)
        time = time[once]
        angle = angle[once]
    return Encoders(topic, common.stamp, common.arrival, mean_speeds(time, angle), names)


def _joint_angles(
    bag: Bag, topics: Sequence[Topic], names: Sides, notes: list[str]
) -> dict[str, Readings]:
    """Angles (n,) [rad] of each joint by name, from positions or else from velocities.

    Raises LogError for a joint that is not in any message.
    """

    def states(content: Any) -> Iterable[tuple[str, Any, tuple[float, float]]]:
        """The name, the header, the position and the velocity of each joint in a message."""
        count = len(content.name)
        unknown = np.full(count, np.nan)
        position = content.position if len(content.position) == count else unknown
        velocity = content.velocity if len(content.velocity) == count else unknown
        readings = zip(content.name, position, velocity, strict=True)
        return ((name, content.header, (p, v)) for name, p, v in readings)

    stated = bag.readings([topic.name for topic in topics], states)
    joints = _of_names(stated, topics, names, notes)
    by_position = all(_has_positions(*joint.values.T) for joint in joints.values())
    if not by_position:
        source = next(iter(joints.values())).source
        notes.append(f"topic {source}: speeds are its velocities, because it states no positions")
    return {name: _angles(name, joint, by_position) for name, joint in joints.items()}


def _of_names(
    stated: Mapping[str, Readings], topics: Sequence[Topic], names: Sides, notes: list[str]
) -> dict[str, Readings]:
    """The readings (N, k) of each name on a side, in order, NaN where not measured; LogError for a
    name that isn't `stated`.
    """
    found = {}
    for side, of_side in zip(SIDES, names, strict=True):
        for name in of_side:
            if name not in stated:
                of_topics = " and ".join(topic.name for topic in topics)
                raise LogError(
                    f"{side} = {name!r}: topic {of_topics} has no such joint; its joints are "
                    f"{listed([*stated])}"
                )
            joint = stated[name].ascending(notes)
            measured = np.abs(joint.values) <= _MAX_ANGLE
            found[name] = replace(joint, values=np.where(measured, joint.values, np.nan))
    return found


def _counter_angles(
    bag: Bag, topics: Sequence[Topic], names: Sides, per_turn: float, notes: list[str]
) -> dict[str, Readings]:
    """Angles (n,) [rad] by the name of the counter, from ticks; messages without a header are
    stamped when they are recorded.

    Raises LogError for a counter that isn't in the messages, or that restarts.
    """
    stated = dict[str, Readings]()
    for topic in topics:

        def counts(
            content: Any, topic: str = topic.name
        ) -> Iterable[tuple[str, Any, tuple[float]]]:
            header = header_of(content)
            return ((name, header, (value,)) for name, value in numbers_in(topic, content).items())

        stated |= bag.readings([topic.name], counts)
        if header_of(bag.first(topic.name, 1)[0].content) is None:
            notes.append(f"topic {topic.name}: its messages have no stamps: times of recording")

    angles = {}
    for name, counter in _of_names(stated, topics, names, notes).items():
        rows = np.flatnonzero(np.isfinite(counter.values[:, 0]))
        rows = rows[without_bursts(counter.stamp[rows])]
        counter = counter.take(rows)
        time = seconds(counter.stamp, int(counter.stamp[0]))
        ticks, restart = continuous(time, counter.values[:, 0], (per_turn, *COUNTERS))
        if restart is not None:
            before, after = counter.values[restart - 1 : restart + 1, 0]
            raise LogError(
                f"topic {counter.source}: {name} jumps from {before:.9g} to {after:.9g} after "
                f"{time[restart]:.6g} s, and by no number of ticks at which it wraps: did the "
                "counter restart? Cut the bag there"
            )
        angles[name] = replace(counter, values=2 * np.pi / per_turn * ticks)
    return angles


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
    known = values[rows]
    if by_position:
        return replace(joint.take(rows), values=unwrapped_angle(known))
    return replace(joint.take(rows), values=cumulative_trapezoid(known, time, initial=0.0))


def side_turns(
    topic: str, side: Sequence[str], turns: Mapping[str, Array], notes: list[str]
) -> Array:
    """Mean turns (n,) [rad] of the wheels on a side in each interval, from the `turns` of each
    joint.

    An encoder that stands still while other wheels turn is left out, with a line in `notes`. Raises
    LogError, with topic and joints, if wheels turn against each other.
    """
    sizes = {name: float(np.abs(turns[name]).sum()) for name in side}
    most = max(sizes, key=lambda name: sizes[name])
    if sizes[most] <= _MIN_TURN:
        return np.asarray(np.mean([turns[name] for name in side], axis=0))
    kept = []
    for name in side:
        if sizes[name] < _STILL * sizes[most]:
            notes.append(
                f"topic {topic}: joint {name} left out: it stands still while {most} turns"
            )
            continue
        against = -np.linalg.norm(turns[name]) * np.linalg.norm(turns[most])
        if 2 * turns[name] @ turns[most] < against:
            raise LogError(
                f"topic {topic}: joints {most} and {name} of one side turn against each other: "
                "choose with --left NAMES --right NAMES"
            )
        kept.append(name)
    return np.asarray(np.mean([turns[name] for name in kept], axis=0))


def joined(name: str, encoders: Encoders, poses: Readings) -> RunLog:
    """Join encoders and poses (N, 3) in a log, with a row for each encoder reading and for each
    pose between readings.

    A pose's row has the sprocket speeds of the next reading.
    """
    read = encoders.stamp
    start = int(read[0])
    measured = np.isfinite(poses.values).any(axis=1)
    within = measured & (poses.stamp >= read[0]) & (poses.stamp <= read[-1])

    # rows of encoders and poses in the order of time
    stamp = np.union1d(read, poses.stamp[within])
    valid = np.isin(stamp, poses.stamp[within])
    pose = np.full((len(stamp), 3), np.nan)
    pose[valid] = poses.values[within]
    headed = np.isfinite(pose[:, 2])
    pose[headed, 2] = np.unwrap(pose[headed, 2])

    # poses before the first and after the last reading, used to align clocks
    timed = np.column_stack([seconds(poses.stamp, start), poses.values])
    beyond = timed[measured & ~within]

    next_reading = np.searchsorted(read, stamp)
    return RunLog(
        run=name,
        time=seconds(stamp, start),
        omega=encoders.values[next_reading],
        pose=pose,
        valid=None if valid.all() else valid,
        read=None if len(stamp) == len(read) else np.isin(stamp, read),
        beyond=beyond if len(beyond) else None,
        metadata={"bag": {**encoders.about, "poses": poses.source, "start": start / 1e9}},
    )
