"""Poses of a frame in another frame over time, from the transforms (tf) in a bag."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any, Final

import numpy as np
from scipy.interpolate import interp1d
from scipy.spatial.transform import Rotation, Slerp

from trackslip.bags.open import Bag, listed
from trackslip.bags.stamps import Readings, seconds
from trackslip.errors import LogError
from trackslip.kinematics import Array

TRANSFORMS: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
MAX_PLACE: Final = 1e9  # coordinate above which a place is invalid [m]
MAX_TILT: Final = np.radians(20.0)
"""Tilt from the vertical above which the heading and the planar path of a robot or a scanner are
doubtful [rad].
"""
# largest deviation of a quaternion's norm from 1: single precision and rounded text stay below
_TOLERANCE: Final = 0.02
_MAX_GAP: Final = 1.0  # longest time over which a transform is interpolated [s]
_MOST_LINKS: Final = 500_000  # number of links in which frames are searched, from the start
# longest time in usual intervals of the transform; the longer of both limits applies [-]
_USUAL_GAPS: Final = 5.0

Pair = tuple[str, str]  # a parent frame, and the child frame with its pose in the parent
Link = tuple[Readings, bool]
"""Transforms (n, 7) between two frames (n = 1 if constant), and whether they lead from parent to
child in a chain.
"""


def frames_of(bag: Bag, most: int) -> list[Pair]:
    """Pairs of frames that the first `most` transform messages of each topic link."""
    messages = (
        message
        for topic in bag.of_type(*TRANSFORMS)
        for message in islice(bag.messages(topic.name), most)
    )
    pairs = (_pair(link) for message in messages for link in message.content.transforms)
    return [*dict.fromkeys(islice(pairs, _MOST_LINKS))]


def parents_of(pairs: Iterable[Pair]) -> dict[str, str]:
    """Map each child frame to its parent frame, in which its pose is given."""
    return {child: parent for parent, child in pairs}


def path_up(frame: str, parents: Mapping[str, str]) -> list[str]:
    """A frame, its parent, the parent's parent, and so on."""
    path = [frame]
    while (parent := parents.get(path[-1])) is not None and parent not in path:
        path.append(parent)
    return path


def read_chain(bag: Bag, parent: str, child: str, notes: list[str]) -> Readings:
    """Read the poses of `child` in `parent`: places [m] and quaternions x, y, z, w (n, 7).

    A pose is computed at each change of the link that changes least often (for example, map to odom
    changes when a scan is matched); all other links are interpolated. Raises LogError if the frames
    are unknown or not connected, or no transform between them can be read.
    """
    transforms = read_transforms(bag)
    if not transforms:
        raise LogError(f"{bag.path}: no transforms: no topic of {TRANSFORMS[0]}")
    links = _links(bag, transforms, parent.strip("/"), child.strip("/"), notes)
    if all(len(link.stamp) == 1 for link, _ in links):
        raise LogError(f"{bag.path}: the transforms from {parent!r} to {child!r} never change")
    return _sampled(links)


def read_fixed(bag: Bag, frame: str, notes: list[str]) -> tuple[str, Array, Rotation] | None:
    """The outermost frame above a fixed frame, and the fixed frame's place (3,) [m] and rotation in
    it.

    None if the frame has no parent. Raises LogError if the frame moves in the outermost frame.
    """
    frame = frame.strip("/")
    transforms = read_transforms(bag)
    outer = path_up(frame, parents_of(transforms))[-1]
    if outer == frame:
        return None
    links = _links(bag, transforms, outer, frame, notes)
    if any(len(link.stamp) > 1 for link, _ in links):
        raise LogError(f"{bag.path}: frame {frame!r} moves in {outer!r}")
    place, turn = _composed(links, np.zeros(1, np.int64))
    return outer, place[0], turn[0]


def _pair(transform: Any) -> Pair:
    return transform.header.frame_id.strip("/"), transform.child_frame_id.strip("/")


def read_transforms(bag: Bag) -> dict[Pair, Readings]:
    """Read the transforms (n, 7) for each pair of frames: places [m] and quaternions x, y, z, w."""

    def numbers(content: Any) -> Iterator[tuple[Pair, Any, tuple[float, ...]]]:
        for link in content.transforms:
            yield (
                _pair(link),
                link.header,
                pose_numbers(link.transform.translation, link.transform.rotation),
            )

    return bag.readings([topic.name for topic in bag.of_type(*TRANSFORMS)], numbers)


def pose_numbers(place: Any, turn: Any) -> tuple[float, ...]:
    """Coordinates x, y, z and quaternion x, y, z, w from the two parts of a message's pose."""
    return place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w


def _links(
    bag: Bag, transforms: Mapping[Pair, Readings], parent: str, child: str, notes: list[str]
) -> list[Link]:
    """The links that lead from frame `parent` to frame `child`.

    Raises LogError if either frame doesn't exist or no links connect the frames.
    """
    frames = {frame for pair in transforms for frame in pair}
    for frame in (parent, child):
        if frame not in frames:
            raise LogError(
                f"{bag.path}: frame {frame!r} is not in the transforms; they have "
                f"{listed(sorted(frames))}"
            )
    parents = parents_of(transforms)
    up, down = path_up(parent, parents), path_up(child, parents)
    common = next((frame for frame in up if frame in down), None)
    if common is None:
        raise LogError(
            f"{bag.path}: frames {parent!r} and {child!r} are not connected by transforms: "
            f"{parent!r} is in "
            f"{up[-1]!r}, {child!r} in {down[-1]!r}"
        )
    pairs = [((parents[frame], frame), False) for frame in up[: up.index(common)]]
    pairs += [((parents[frame], frame), True) for frame in reversed(down[: down.index(common)])]
    return [(_link(pair, transforms[pair], notes), forwards) for pair, forwards in pairs]


def _link(pair: Pair, transforms: Readings, notes: list[str]) -> Readings:
    """The valid transforms between two frames; only the last if they never change. LogError if none
    is valid.
    """
    name = f"tf {pair[0]} -> {pair[1]}"
    good = are_unit(transforms.values[:, 3:]) & (np.abs(transforms.values[:, :3]) <= MAX_PLACE).all(
        axis=1
    )
    if not good.any():
        raise LogError(f"{name}: no transform is finite")
    link = replace(transforms.take(good), source=name)
    return link.take(np.array([-1])) if len(link.changes) == 1 else link.ascending(notes)


def heading_and_tilt(turn: Rotation) -> tuple[Array, Array]:
    """Headings (n,) of the x axes of rotations (n), counter-clockwise seen from above, and tilts
    (n,) of the z axes.
    """
    axes = turn.as_matrix()
    return np.arctan2(axes[..., 1, 0], axes[..., 0, 0]), np.arccos(
        np.clip(axes[..., 2, 2], -1.0, 1.0)
    )


def are_unit(quaternion: Array) -> np.ndarray:
    """(n,) bool: true for quaternions (n, 4) of unit length."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) <= _TOLERANCE)


def _sampled(links: Sequence[Link]) -> Readings:
    """The poses at the end of a chain of links, sampled as `read_chain` describes."""
    moving = [link for link, _ in links if len(link.stamp) > 1]
    slowest = min(moving, key=lambda link: len(link.changes))
    rows = slowest.changes
    for link in moving:
        if link is not slowest:
            rows = rows[_covers(link, slowest.stamp[rows])]
    if not len(rows):
        return slowest.take(rows)
    place, turn = _composed(links, slowest.stamp[rows])
    return replace(slowest.take(rows), values=np.column_stack([place, turn.as_quat()]))


def _composed(links: Sequence[Link], stamp: np.ndarray) -> tuple[Array, Rotation]:
    """Places (n, 3) and rotations (n) at the end of a chain of links at stamps (n,)."""
    place, turn = np.zeros((len(stamp), 3)), Rotation.identity(len(stamp))
    for link, forwards in links:
        there, turned = _at(link, stamp)
        if not forwards:
            turned = turned.inv()
            there = -turned.apply(there)
        place = place + turn.apply(there)
        turn = turn * turned
    return place, turn


def _covers(link: Readings, stamp: np.ndarray) -> np.ndarray:
    """(n,) bool: true for stamps (n,) between two transforms of a link that are close enough for
    interpolation.
    """
    after = np.clip(np.searchsorted(link.stamp, stamp), 1, len(link.stamp) - 1)
    interval = (link.stamp[after] - link.stamp[after - 1]) / 1e9
    usual = float(np.median(np.diff(link.stamp))) / 1e9
    longest = max(_MAX_GAP, _USUAL_GAPS * usual)
    within = (stamp >= link.stamp[0]) & (stamp <= link.stamp[-1])
    return np.asarray(within & (interval <= longest))


def _at(link: Readings, stamp: np.ndarray) -> tuple[Array, Rotation]:
    """Places (n, 3) and rotations (n) of a link at stamps (n,) in its range; a single place and
    rotation if fixed.
    """
    place = link.values[:, :3]
    turn = Rotation.from_quat(link.values[:, 3:])
    if len(link.stamp) == 1:
        return place[0], turn[0]
    first = int(link.stamp[0])
    time = seconds(link.stamp, first)
    at = seconds(stamp, first)
    return interp1d(time, place, axis=0)(at), Slerp(time, turn)(at)
