"""Which of a bag's topics and transforms state the pose, and which of them is the best to take."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntEnum

from trackslip.errors import LogError
from trackslip.ros.bag import Bag, Topic
from trackslip.ros.poses import FIX, ODOMETRY, POSE_TYPES
from trackslip.ros.transforms import Pair, frames_of

_LOOKED_AT = 5000  # messages with transforms that are looked at for frames
_WANTED = re.compile(r"goal|initial_?pose|target|setpoint|cmd|command|desired|reference|waypoint|plan\b", re.IGNORECASE)
_MOCAP = re.compile(r"vicon|optitrack|mocap|motion_capture|qualisys|vrpn|natnet|total_?station|leica", re.IGNORECASE)
_TRUTH = re.compile(r"ground_?truth|\btruth|gazebo|p3d|perfect", re.IGNORECASE)
_MATCHED = re.compile(
    r"slam|amcl|locali[sz]|lio|loam|icp|ndt|kiss|hdl|cartographer|rtabmap|vins|vio\b|visual|lidar|laser|\bzed|scan|t265",
    re.IGNORECASE,
)
_FUSED = re.compile(r"filtered|fused|ekf|ukf|kalman|imu", re.IGNORECASE)
_FIXED_FRAMES = ("map", "world", "earth", "mocap", "vicon", "utm", "ned", "enu", "field")
_BODIES = ("base_link", "base_footprint", "base", "chassis", "robot")


class Rank(IntEnum):
    """How independent of the wheels a source of poses is, the best first."""

    CHOSEN = -1
    MOCAP = 0
    MATCHED = 1
    TRANSFORMS = 2
    FIX = 3
    TRUTH = 4
    FUSED = 5
    WHEELS = 6


_MARKS = {Rank.MOCAP: _MOCAP, Rank.TRUTH: _TRUTH, Rank.FUSED: _FUSED, Rank.MATCHED: _MATCHED}
RANKS = {
    Rank.CHOSEN: "as asked for",
    Rank.MOCAP: "motion capture",
    Rank.MATCHED: "measured poses",
    Rank.TRANSFORMS: "transforms from a fixed frame",
    Rank.FIX: "satellite positions",
    Rank.TRUTH: "a simulator's truth",
    Rank.FUSED: "fused odometry, perhaps with the wheels",
    Rank.WHEELS: "odometry, perhaps from the wheels",
}
"""What a source is taken for."""


@dataclass(frozen=True)
class PoseSource:
    """Something in a bag that states poses."""

    name: str
    """The topic, or tf:PARENT:CHILD."""
    rank: Rank


def pose_sources(bag: Bag) -> list[PoseSource]:
    """All sources of poses, the best first."""
    found = [
        PoseSource(topic.name, _rank(bag, topic))
        for topic in bag.of_type(*POSE_TYPES)
        if not _WANTED.search(topic.name)
    ]
    return sorted([*found, *_in_transforms(bag)], key=lambda source: source.rank)


def chosen_source(bag: Bag) -> PoseSource:
    """The best source of poses; raises LogError if there is none, or several are equally good."""
    sources = pose_sources(bag)
    if not sources:
        needed = f"no topic of {', '.join(POSE_TYPES)}, and no transforms of a robot in a fixed frame"
        raise LogError(f"{bag.path}: no poses: {needed}; its topics are {bag.listed()}")
    best = [source for source in sources if source.rank == sources[0].rank]
    best = [source for source in best if source.name in bag.topics] or best  # transforms repeat what topics state
    bag.only([source.name for source in best], "poses", "--poses TOPIC")
    return best[0]


def known_source(bag: Bag, name: str) -> str:
    """The name of a topic or of tf:PARENT:CHILD as it stands in the bag; raises LogError for an unknown topic."""
    return name if name.startswith("tf:") else bag.topic(name).name


def _rank(bag: Bag, topic: Topic) -> Rank:
    """What the name, the type and the frame of a topic tell."""
    usual = Rank.FIX if topic.type == FIX else Rank.WHEELS if topic.type == ODOMETRY else Rank.MATCHED
    rank = next((rank for rank, marks in _MARKS.items() if marks.search(topic.name)), usual)
    if rank in (Rank.FUSED, Rank.WHEELS) and topic.type == ODOMETRY:
        first = bag.first(topic.name, 1)
        if first and _last(first[0].content.header.frame_id) in _FIXED_FRAMES:
            return Rank.MATCHED
    return rank


def _in_transforms(bag: Bag) -> list[PoseSource]:
    """The poses of robots' bodies in the frames at the roots of their transforms, if they have such frames."""
    pairs = frames_of(bag, _LOOKED_AT)
    children = {child for _, child in pairs}
    bodies = next((found for name in _BODIES if (found := [one for one in children if _last(one) == name])), [])
    roots = {body: _root(pairs, body) for body in sorted(bodies)}
    return [
        PoseSource(f"tf:{root}:{body}", Rank.TRANSFORMS if _last(root) in _FIXED_FRAMES else Rank.WHEELS)
        for body, root in roots.items()
    ]


def _root(pairs: dict[Pair, None], frame: str) -> str:
    """The frame at the root of the tree that a frame is in."""
    parents = {child: parent for parent, child in pairs}
    seen = {frame}
    while frame in parents and parents[frame] not in seen:
        frame = parents[frame]
        seen.add(frame)
    return frame


def _last(frame: str) -> str:
    """The last part of a frame's name, in lower case."""
    return frame.strip("/").rpartition("/")[2].lower()
