"""Poses of a frame in another over time, from the transforms (tf) in a bag."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.ros.bag import Bag, listed
from trackslip.ros.planar import unit_quaternions
from trackslip.ros.stamps import seconds, stretches

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_MAX_PLACE = 1e9  # places farther away mean nothing [m]
_MAX_GAP = 1.0  # longest time over which a transform is interpolated [s]
_USUAL_GAPS = 5.0  # the same in its usual intervals [-]

Pair = tuple[str, str]
"""A frame and one that is given in it."""


@dataclass(frozen=True)
class SpacePoses:
    """Poses of a frame in another, in space."""

    stamp: np.ndarray
    """(n,) int: ascending in a stretch of one clock [ns]."""
    arrival: np.ndarray
    """(n,) int: when they were recorded [ns]."""
    place: Array
    """(n, 3) [m]."""
    turn: Array
    """(n, 4) quaternions x, y, z, w; NaN where only places are measured."""
    covariance: Array | None = None
    """(n, 3, 3) of x, y and heading; None if not stated."""

    def take(self, rows: np.ndarray) -> SpacePoses:
        """Some of the poses."""
        known = None if self.covariance is None else self.covariance[rows]
        return SpacePoses(self.stamp[rows], self.arrival[rows], self.place[rows], self.turn[rows], known)

    @cached_property
    def changes(self) -> np.ndarray:
        """(n,) bool: whether a pose differs from the one before."""
        both = np.concatenate([self.place, self.turn], axis=1)
        return np.append(True, (both[1:] != both[:-1]).any(axis=1))

    @property
    def is_constant(self) -> bool:
        """True if it never changes."""
        return not self.changes[1:].any()


def frames_of(bag: Bag, most: int) -> list[Pair]:
    """The pairs of frames linked by the first `most` transform messages of each topic."""
    messages = (message for topic in bag.of_type(*TRANSFORMS) for message in bag.first(topic.name, most))
    return [*dict.fromkeys(_pair(one) for message in messages for one in message.content.transforms)]


def read_chain(bag: Bag, parent: str, child: str, notes: list[str]) -> list[SpacePoses]:
    """The poses of `child` in `parent`, for each stretch between restarts of the clock.

    They are sampled when the link changes that changes least often, as map to odom does with each match of a scan;
    the others are interpolated. Raises LogError if the frames are unknown or not connected, or no transform between
    them can be read.
    """
    parent, child = parent.strip("/"), child.strip("/")
    transforms = _read(bag, notes)
    if not transforms:
        raise LogError(f"{bag.path}: no transforms: no topic of {TRANSFORMS[0]}")
    try:
        way = _way(transforms, parent, child)
    except LogError as error:
        raise LogError(f"{bag.path}: {error}") from error
    links = {pair: _links(pair, transforms[pair], notes) for pair, _ in way}
    counts = {len(parts) for parts in links.values() if not all(part.is_constant for part in parts)}
    if not counts:
        names = " -> ".join([parent, *(pair[forwards] for pair, forwards in way)])
        raise LogError(f"{bag.path}: the transforms {names} never change")
    if len(counts) > 1:
        raise LogError(
            f"{bag.path}: time goes back in some transforms between {parent!r} and {child!r} and not in others"
        )
    return [_sampled([(links[pair][k % len(links[pair])], forwards) for pair, forwards in way]) for k in range(*counts)]


def fixed_in(bag: Bag, frame: str, notes: list[str], static: bool = False) -> tuple[str, Array, Rotation] | None:
    """The outermost frame that a frame is fixed in, and its place (3,) [m] and rotation there.

    None if there are no transforms of it. Raises LogError, naming the frames, if that frame moves in another one. With
    `static`, only topics of static transforms are read.
    """
    frame = frame.strip("/")
    transforms = _read(bag, notes, static)
    place, turn, outer, seen = np.zeros(3), Rotation.identity(), frame, {frame}
    while (pair := next((one for one in transforms if one[1] == outer), None)) is not None and pair[0] not in seen:
        links = _links(pair, transforms[pair], notes)
        if not all(link.is_constant for link in links):
            raise LogError(f"{bag.path}: frame {frame!r} moves in {pair[0]!r}")
        step = Rotation.from_quat(links[0].turn[0])
        place, turn = links[0].place[0] + step.apply(place), step * turn
        outer = pair[0]
        seen.add(outer)
    return None if outer == frame else (outer, place, turn)


def _pair(transform: Any) -> Pair:
    """The frames of a transform."""
    return transform.header.frame_id.strip("/"), transform.child_frame_id.strip("/")


def _read(bag: Bag, notes: list[str], static: bool = False) -> dict[Pair, list[tuple[bool, int, int, Any]]]:
    """Transforms by pair of frames: whether they are static, stamps and arrivals [ns], and their content.

    With `static`, those of static topics alone.
    """
    found: dict[Pair, list[tuple[bool, int, int, Any]]] = defaultdict(list)
    topics = [topic.name for topic in bag.of_type(*TRANSFORMS) if "static" in topic.name or not static]
    for message in bag.messages(*topics, notes=notes) if topics else ():
        for one in message.content.transforms:
            stamp = one.header.stamp.sec * 1_000_000_000 + one.header.stamp.nanosec
            found[_pair(one)].append(("static" in message.topic, stamp, message.arrival, one.transform))
    return dict(found)


def _links(pair: Pair, rows: list[tuple[bool, int, int, Any]], notes: list[str]) -> list[SpacePoses]:
    """The transforms between two frames, for each stretch between restarts of the clock."""
    name = f"tf {pair[0]} -> {pair[1]}"
    stamp, arrival = np.array([row[1:3] for row in rows], np.int64).T
    place, turn = place_and_turn((row[3].translation, row[3].rotation) for row in rows)
    good = unit_quaternions(turn, name, notes) & (np.abs(place) <= _MAX_PLACE).all(axis=1)
    if not good.any():
        raise LogError(f"{name}: no transform is finite")
    poses = SpacePoses(stamp, arrival, place, turn).take(np.flatnonzero(good))
    if rows[0][0] or good.sum() == 1:
        return [poses.take(np.array([-1]))]
    return [poses.take(part) for part in stretches(name, poses.stamp, poses.arrival, notes)]


def place_and_turn(poses: Iterable[tuple[Any, Any]]) -> tuple[Array, Array]:
    """Places (n, 3) and quaternions x, y, z, w (n, 4) of points and quaternions as messages state them."""
    values = np.array([(at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w) for at, turn in poses], float)
    values[np.isnan(values)] = np.nan  # those of damaged bytes may be signalling ones, which warn wherever they get
    return values[:, :3], values[:, 3:]


def _way(links: Iterable[Pair], parent: str, child: str) -> list[tuple[Pair, bool]]:
    """The links that lead from a frame to another, each with whether it is followed forwards.

    Raises LogError if there is no such frame, or the links don't connect them.
    """
    near: dict[str, list[tuple[str, Pair, bool]]] = defaultdict(list)
    for pair in links:
        near[pair[0]].append((pair[1], pair, True))
        near[pair[1]].append((pair[0], pair, False))
    for frame in (parent, child):
        if frame not in near:
            raise LogError(f"frame {frame!r} is not in the transforms; they have {listed(sorted(near))}")
    ways: dict[str, list[tuple[Pair, bool]]] = {parent: []}
    waiting = [parent]
    for frame in waiting:
        for other, pair, forwards in near[frame]:
            if other not in ways:
                ways[other] = [*ways[frame], (pair, forwards)]
                waiting.append(other)
    if child not in ways:
        others = listed(sorted(ways.keys() - {parent}))
        raise LogError(f"frames {parent!r} and {child!r} are not connected by transforms; {parent!r} is with {others}")
    return ways[child]


def _sampled(way: list[tuple[SpacePoses, bool]]) -> SpacePoses:
    """The poses at the end of a chain of links, see `read_chain`."""
    moving = [link for link, _ in way if not link.is_constant]
    slowest = min(moving, key=lambda link: int(link.changes.sum()))
    rows = np.flatnonzero(slowest.changes)
    rows = rows[np.all([_covers(link, slowest.stamp[rows]) for link in moving], axis=0)]
    if not len(rows):
        return slowest.take(rows)
    stamp = slowest.stamp[rows]
    place, turn = np.zeros((len(rows), 3)), Rotation.identity(len(rows))
    for link, forwards in way:
        there, turned = _at(link, stamp)
        if not forwards:
            turned = turned.inv()
            there = -turned.apply(there)
        place = place + turn.apply(there)
        turn = turn * turned
    return SpacePoses(stamp, slowest.arrival[rows], place, turn.as_quat())


def _covers(link: SpacePoses, stamp: np.ndarray) -> np.ndarray:
    """(n,) bool: whether the stamps (n,) lie between transforms of a link that aren't far apart."""
    after = np.clip(np.searchsorted(link.stamp, stamp), 1, len(link.stamp) - 1)
    before, next_ = link.stamp[after - 1], link.stamp[after]
    longest = max(_MAX_GAP, _USUAL_GAPS * float(np.median(np.diff(link.stamp))) / 1e9)
    exact = (next_ == stamp) | (before == stamp)
    within = (stamp >= link.stamp[0]) & (stamp <= link.stamp[-1])
    return np.asarray(within & (exact | ((next_ - before) / 1e9 <= longest)))


def _at(link: SpacePoses, stamp: np.ndarray) -> tuple[Array, Rotation]:
    """Places (n, 3) and rotations (n) of a link at stamps (n,) within its own; only one if it never changes."""
    if link.is_constant:
        return link.place[0], Rotation.from_quat(link.turn[0])
    origin = int(link.stamp[0])
    time, at = seconds(link.stamp, origin), seconds(stamp, origin)
    place = np.stack([np.interp(at, time, column) for column in link.place.T], axis=-1)
    return place, Slerp(time, Rotation.from_quat(link.turn))(at)
