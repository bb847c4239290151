"""Poses of a frame in another over time, from the transforms (tf) in a bag."""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import interp1d
from scipy.spatial.transform import Rotation, Slerp

from trackslip.bags.open import Bag, listed, stamp_of
from trackslip.bags.stamps import seconds, stretches
from trackslip.errors import LogError
from trackslip.kinematics import Array

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
MAX_PLACE = 1e9
"""Places farther away mean nothing [m]."""
_TOLERANCE = 0.02  # by which a quaternion's norm may differ from 1: single precision and rounded text stay below
_MAX_GAP = 1.0  # longest time over which a transform is interpolated [s]
_USUAL_GAPS = 5.0  # the same in its usual intervals [-]

Pair = tuple[str, str]
"""A frame and one that is given in it."""


@dataclass(frozen=True)
class SpacePoses:
    """Poses of a frame in another, in space."""

    stamp: np.ndarray  # (n,) int: ascending in a stretch of one clock [ns]
    arrival: np.ndarray  # (n,) int: when they were recorded [ns]
    place: Array  # (n, 3) [m]; NaN where only turns are measured
    turn: Array  # (n, 4) quaternions x, y, z, w; NaN where only places are measured
    covariance: Array | None = None  # (n, 3, 3) of x, y and heading; None if not stated

    def take(self, rows: np.ndarray) -> SpacePoses:
        """Some of the poses."""
        known = None if self.covariance is None else self.covariance[rows]
        return SpacePoses(self.stamp[rows], self.arrival[rows], self.place[rows], self.turn[rows], known)

    @cached_property
    def changes(self) -> np.ndarray:
        """Rows (n,) whose pose differs from the one before, and the first one."""
        both = np.concatenate([self.place, self.turn], axis=1)
        return np.flatnonzero(np.append(True, (both[1:] != both[:-1]).any(axis=1)))

    @property
    def is_constant(self) -> bool:
        """True if it never changes."""
        return len(self.changes) == 1


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
    transforms = read_transforms(bag)
    if not transforms:
        raise LogError(f"{bag.path}: no transforms: no topic of {TRANSFORMS[0]}")
    way = _way(bag, transforms, parent, child)
    links = {pair: links_of(pair, transforms[pair], notes) for pair, _ in way}
    counts = {len(parts) for parts in links.values() if not all(part.is_constant for part in parts)}
    if not counts:
        names = " -> ".join([parent, *(pair[forwards] for pair, forwards in way)])
        raise LogError(f"{bag.path}: the transforms {names} never change")
    if len(counts) > 1:
        raise LogError(f"{bag.path}: time goes back in some transforms from {parent!r} to {child!r}, not in others")
    return [_sampled([(links[pair][k % len(links[pair])], forwards) for pair, forwards in way]) for k in range(*counts)]


def _pair(transform: Any) -> Pair:
    """The frames of a transform."""
    return transform.header.frame_id.strip("/"), transform.child_frame_id.strip("/")


def read_transforms(bag: Bag) -> dict[Pair, tuple[array[int], array[float]]]:
    """Transforms by pair of frames: whether they are static, stamp and arrival [ns]; place [m] and quaternion."""
    found: dict[Pair, tuple[array[int], array[float]]] = defaultdict(lambda: (array("q"), array("d")))
    topics = [topic.name for topic in bag.of_type(*TRANSFORMS)]
    for message in bag.messages(*topics) if topics else ():
        for transform in message.content.transforms:
            times, numbers = found[_pair(transform)]
            times.extend(("static" in message.topic, stamp_of(transform.header), message.arrival))
            numbers.extend(pose_numbers(transform.transform.translation, transform.transform.rotation))
    return dict(found)


def pose_numbers(place: Any, turn: Any) -> tuple[float, ...]:
    """Coordinates and quaternion x, y, z, w of a point or vector and a quaternion in messages."""
    return place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w


def links_of(pair: Pair, stated: tuple[array[int], array[float]], notes: list[str]) -> list[SpacePoses]:
    """The transforms between two frames, for each stretch between restarts of the clock."""
    name = f"tf {pair[0]} -> {pair[1]}"
    static, stamp, arrival = np.array(stated[0], np.int64).reshape(-1, 3).T
    numbers = np.array(stated[1]).reshape(-1, 7)
    place, turn = np.split(np.where(np.isnan(numbers), np.nan, numbers), [3], axis=1)
    good = unit_quaternions(turn, name, notes) & (np.abs(place) <= MAX_PLACE).all(axis=1)
    if not good.any():
        raise LogError(f"{name}: no transform is finite")
    poses = SpacePoses(stamp, arrival, place, turn).take(np.flatnonzero(good))
    if static[0] or good.sum() == 1:
        return [poses.take(np.array([-1]))]
    return [poses.take(part) for part in stretches(name, poses.stamp, poses.arrival, notes)]


def unit_quaternions(quaternion: Array, source: str, notes: list[str]) -> np.ndarray:
    """(n,) bool: which quaternions x, y, z, w (n, 4) are of unit length; raises LogError if most are not."""
    good = are_unit(quaternion)
    bad = int((~good).sum())
    if bad:
        shown = np.array2string(quaternion[np.argmin(good)], precision=4)
        line = f"the quaternion {shown} is not of unit length"
        if 2 * bad > len(good):
            raise LogError(f"{source}: {line}; so are {bad} of its {len(good)} quaternions")
        notes.append(f"{source}: {bad} of {len(good)} poses left out: {line}")
    return good


def are_unit(quaternion: Array) -> np.ndarray:
    """(n,) bool: which quaternions (n, 4) are of unit length."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) <= _TOLERANCE)


def _way(bag: Bag, links: Iterable[Pair], parent: str, child: str) -> list[tuple[Pair, bool]]:
    """The links that lead from a frame to another, each with whether it is followed forwards.

    Raises LogError if there is no such frame, or the links don't connect them.
    """
    near: dict[str, list[tuple[str, Pair, bool]]] = defaultdict(list)
    for pair in links:
        near[pair[0]].append((pair[1], pair, True))
        near[pair[1]].append((pair[0], pair, False))
    for frame in (parent, child):
        if frame not in near:
            raise LogError(f"{bag.path}: frame {frame!r} is not in the transforms; they have {listed(sorted(near))}")
    ways: dict[str, list[tuple[Pair, bool]]] = {parent: []}
    waiting = [parent]
    for frame in waiting:
        for other, pair, forwards in near[frame]:
            if other not in ways:
                ways[other] = [*ways[frame], (pair, forwards)]
                waiting.append(other)
    if child not in ways:
        others = f"{parent!r} is with {listed(sorted(ways.keys() - {parent}))}"
        raise LogError(f"{bag.path}: frames {parent!r} and {child!r} are not connected by transforms; {others}")
    return ways[child]


def _sampled(way: list[tuple[SpacePoses, bool]]) -> SpacePoses:
    """The poses at the end of a chain of links, see `read_chain`."""
    moving = [link for link, _ in way if not link.is_constant]
    slowest = min(moving, key=lambda link: len(link.changes))
    rows = slowest.changes
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
    time, at = (seconds(stamps, int(link.stamp[0])) for stamps in (link.stamp, stamp))
    return interp1d(time, link.place, axis=0)(at), Slerp(time, Rotation.from_quat(link.turn))(at)
