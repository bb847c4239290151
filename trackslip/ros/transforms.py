"""Poses of a frame in another, from the transforms (tf) in a bag."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.ros import rotation
from trackslip.ros.bag import Bag, Topic, listed
from trackslip.ros.stamps import seconds, stretches

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_MAX_GAP = 1.0  # time over which a transform is interpolated at most [s]
_MAX_PLACE = 1e9  # farther ones aren't measured [m]
_USUAL_GAPS = 5.0  # and in its usual intervals

Pair = tuple[str, str]
"""A frame and one that is given in it."""


@dataclass(frozen=True)
class Link:
    """Transforms from a frame to another over time."""

    stamp: np.ndarray
    """(n,) int: ascending [ns]; of a constant one, a single stamp."""
    arrival: np.ndarray
    """(n,) int: when they were recorded [ns]."""
    place: Array
    """(n, 3) of the second frame in the first [m]."""
    turn: Array
    """(n, 4) quaternions x, y, z, w."""

    @property
    def changes(self) -> np.ndarray:
        """(n,) bool: whether a transform differs from the one before."""
        both = np.concatenate([self.place, self.turn], axis=1)
        return np.append(True, (both[1:] != both[:-1]).any(axis=1))

    @property
    def is_constant(self) -> bool:
        """Whether it never changes."""
        return not self.changes[1:].any()


@dataclass(frozen=True)
class _Raw:
    """Transforms of a pair of frames as recorded: rows of stamp, arrival and the seven numbers."""

    stamp: list[int]
    arrival: list[int]
    values: list[tuple[float, ...]]
    static: bool


def transform_topics(bag: Bag) -> list[Topic]:
    """The topics with transforms."""
    return bag.of_type(*TRANSFORMS)


def frames_of(bag: Bag, most: int) -> dict[Pair, None]:
    """The pairs of frames that transforms link, in those of the first `most` messages of each topic."""
    found: dict[Pair, None] = {}
    for topic in transform_topics(bag):
        for message in bag.first(topic.name, most):
            found |= {_pair(one): None for one in message.content.transforms}
    return found


def chain(links: Sequence[Pair] | Mapping[Pair, object], parent: str, child: str) -> list[tuple[Pair, bool]]:
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
    came: dict[str, tuple[str, Pair, bool]] = {}
    waiting = deque([parent])
    while waiting:
        frame = waiting.popleft()
        for other, pair, forwards in near[frame]:
            if other not in came and other != parent:
                came[other] = frame, pair, forwards
                waiting.append(other)
    if child not in came:
        raise LogError(
            f"frames {parent!r} and {child!r} are not connected by transforms; "
            f"{parent!r} is with {listed(sorted(came))}"
        )
    way: list[tuple[Pair, bool]] = []
    while child != parent:
        child, pair, forwards = came[child]
        way.append((pair, forwards))
    return way[::-1]


def read_chain(
    bag: Bag, parent: str, child: str, notes: list[str]
) -> list[tuple[np.ndarray, np.ndarray, Array, Array]]:
    """Poses of the frame `child` in `parent`, for each stretch between restarts of the clock.

    They are sampled when the link changes that changes least often, as map to odom does with each match of a scan;
    the others are interpolated.

    Returns:
        Stamps (n,) [ns], arrivals (n,) [ns], places (n, 3) [m] and quaternions (n, 4) of each stretch.

    Raises:
        LogError: if the frames are unknown or not connected, or no transform between them can be read.
    """
    parent, child = parent.strip("/"), child.strip("/")
    if not transform_topics(bag):
        raise LogError(f"{bag.path}: no transforms: no topic of {TRANSFORMS[0]}")
    raw = _read(bag, notes)
    try:
        way = chain(raw, parent, child)
    except LogError as error:
        raise LogError(f"{bag.path}: {error}") from error
    parts = {pair: _parts(pair, raw[pair], notes) for pair, _ in way}
    moving = {pair: len(links) for pair, links in parts.items() if not all(link.is_constant for link in links)}
    if not moving:
        names = " -> ".join([parent, *(pair[forwards] for pair, forwards in way)])
        raise LogError(f"{bag.path}: the transforms {names} never change")
    count = max(moving.values())
    if min(moving.values()) != count:
        raise LogError(
            f"{bag.path}: time goes back in some transforms between {parent!r} and {child!r} and not in others"
        )
    return [_sampled([(parts[pair][k % len(parts[pair])], forwards) for pair, forwards in way]) for k in range(count)]


def fixed_in(bag: Bag, frame: str, notes: list[str]) -> tuple[str, Array, Array] | None:
    """The outermost frame that a frame is fixed in, and its place (3,) [m] and quaternion (4,) there.

    None if there are no transforms of it. Raises LogError, naming the frames, if that frame moves in another one.
    """
    frame = frame.strip("/")
    raw = _read(bag, notes) if transform_topics(bag) else {}
    place, turn, outer, seen = np.zeros(3), Rotation.identity(), frame, {frame}
    while (pair := next((one for one in raw if one[1] == outer), None)) is not None and pair[0] not in seen:
        links = _parts(pair, raw[pair], notes)
        if not all(link.is_constant for link in links):
            raise LogError(f"{bag.path}: frame {frame!r} moves in {pair[0]!r}")
        step = Rotation.from_quat(links[0].turn[0])
        place, turn = links[0].place[0] + step.apply(place), step * turn
        outer = pair[0]
        seen.add(outer)
    return None if outer == frame else (outer, place, turn.as_quat())


def _read(bag: Bag, notes: list[str]) -> dict[Pair, _Raw]:
    """All transforms by pair of frames."""
    found: dict[Pair, _Raw] = {}
    for message in bag.messages(*(topic.name for topic in transform_topics(bag)), notes=notes):
        static = "static" in message.topic
        for one in message.content.transforms:
            raw = found.get(pair := _pair(one))
            if raw is None:
                raw = found[pair] = _Raw([], [], [], static)
            place, turn, stamp = one.transform.translation, one.transform.rotation, one.header.stamp
            raw.stamp.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
            raw.arrival.append(message.arrival)
            raw.values.append((place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w))
    return found


def _pair(transform: object) -> Pair:
    """The frames of a transform."""
    return transform.header.frame_id.strip("/"), transform.child_frame_id.strip("/")  # type: ignore[attr-defined]


def _parts(pair: Pair, raw: _Raw, notes: list[str]) -> list[Link]:
    """The transforms of a link, for each stretch between restarts of the clock."""
    name = f"tf {pair[0]} -> {pair[1]}"
    values = np.array(raw.values)
    stamp, arrival = np.array(raw.stamp, np.int64), np.array(raw.arrival, np.int64)
    good = np.flatnonzero(rotation.usable(values[:, 3:], name, notes) & (np.abs(values) <= _MAX_PLACE).all(axis=1))
    if not good.size:
        raise LogError(f"{name}: no transform is finite")
    if raw.static or len(good) == 1:
        rows = [good[-1:]]
    else:
        rows = [good[part] for part in stretches(name, stamp[good], arrival[good], notes)]
    return [Link(stamp[part], arrival[part], values[part, :3], values[part, 3:]) for part in rows]


def _sampled(way: list[tuple[Link, bool]]) -> tuple[np.ndarray, np.ndarray, Array, Array]:
    """The pose at the end of a chain of links, see `read_chain`."""
    moving = [link for link, _ in way if not link.is_constant]
    slowest = min(moving, key=lambda link: int(link.changes.sum()))
    rows = np.flatnonzero(slowest.changes)
    within = np.ones(len(rows), bool)
    for link in moving:
        within &= _covers(link, slowest.stamp[rows])
    rows = rows[within]
    stamp = slowest.stamp[rows]
    place, turn = np.zeros((len(rows), 3)), Rotation.identity(len(rows))
    for link, forwards in way:
        there, turned = _at(link, stamp)
        if not forwards:
            turned = turned.inv()
            there = -turned.apply(there)
        place = place + turn.apply(there)
        turn = turn * turned
    return stamp, slowest.arrival[rows], place, turn.as_quat().reshape(-1, 4)


def _covers(link: Link, stamp: np.ndarray) -> np.ndarray:
    """(n,) bool: whether the stamps (n,) lie between transforms of a link that aren't far apart."""
    after = np.clip(np.searchsorted(link.stamp, stamp), 1, len(link.stamp) - 1)
    usual = float(np.median(np.diff(link.stamp))) / 1e9
    apart = (link.stamp[after] - link.stamp[after - 1]) / 1e9
    within = (stamp >= link.stamp[0]) & (stamp <= link.stamp[-1])
    exact = (link.stamp[after] == stamp) | (link.stamp[after - 1] == stamp)
    return np.asarray(within & (exact | (apart <= max(_MAX_GAP, _USUAL_GAPS * usual))))


def _at(link: Link, stamp: np.ndarray) -> tuple[Array, Rotation]:
    """Places (n, 3) and rotations (n) of a link at stamps (n,) within its own."""
    if link.is_constant or not len(stamp):
        turn = np.tile(link.turn[0], (len(stamp), 1)).reshape(-1, 4)
        return np.tile(link.place[0], (len(stamp), 1)), Rotation.from_quat(turn) if len(stamp) else Rotation.identity(0)
    origin = int(link.stamp[0])
    time, at = seconds(link.stamp, origin), seconds(stamp, origin)
    place = np.stack([np.interp(at, time, column) for column in link.place.T], axis=-1)
    return place, Slerp(time, Rotation.from_quat(link.turn))(at)
