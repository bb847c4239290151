"""The encoders, poses and scans that a bag offers, and the choice among them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

from trackslip.errors import LogError
from trackslip.ros.bag import Bag, Topic
from trackslip.ros.choice import BagChoice
from trackslip.ros.imu import IMU, imu_topic
from trackslip.ros.joints import ODOMETRY, encoder_topics
from trackslip.ros.poses import FIX, POSE_TYPES
from trackslip.ros.scans import LASER_SCAN, scan_topic
from trackslip.ros.transforms import frames_of

_LOOKED_AT = 5000  # messages with transforms that are looked at for frames
_FIXED_FRAMES = ("map", "world", "earth", "mocap", "vicon", "utm", "ned", "enu", "field")
_BODIES = ("base_link", "base_footprint", "base", "chassis", "robot")


class PoseOrigin(Enum):
    """Origins of poses, from those independent of the wheels to those computed from them."""

    CHOSEN = "as asked for"
    MOCAP = "motion capture"
    MATCHED = "measured poses"
    TRANSFORMS = "transforms from a fixed frame"
    FIX = "satellite positions"
    TRUTH = "a simulator's truth"
    FUSED = "fused odometry, perhaps with the wheels"
    WHEELS = "odometry, perhaps from the wheels"


_MARKS = {
    PoseOrigin.MOCAP: r"vicon|optitrack|mocap|motion_capture|qualisys|vrpn|natnet|total_?station|leica",
    PoseOrigin.TRUTH: r"ground_?truth|\btruth|gazebo|p3d|perfect",
    PoseOrigin.FUSED: r"filtered|fused|ekf|ukf|kalman|imu",
    PoseOrigin.MATCHED: r"slam|amcl|locali[sz]|lio|loam|icp|ndt|kiss|hdl|cartographer|rtabmap|vins|vio\b|visual"
    r"|lidar|laser|\bzed|scan|t265",
}
_WANTED = r"goal|initial_?pose|target|setpoint|cmd|command|desired|reference|waypoint|plan\b"


@dataclass(frozen=True)
class OfferedPoses:
    """A topic or a pair of frames that states poses."""

    name: str
    """The topic, or tf:PARENT:CHILD."""
    origin: PoseOrigin


def pose_sources(bag: Bag) -> list[OfferedPoses]:
    """All sources of poses, the best first."""
    topics = [topic for topic in bag.of_type(*POSE_TYPES) if not re.search(_WANTED, topic.name, re.IGNORECASE)]
    found = [*(OfferedPoses(topic.name, _origin(bag, topic)) for topic in topics), *_in_transforms(bag)]
    return sorted(found, key=lambda source: list(PoseOrigin).index(source.origin))


def pose_source(bag: Bag, choice: BagChoice) -> OfferedPoses:
    """The source chosen, or the best; raises LogError if there is none, or several are equally good."""
    if choice.poses is not None:
        name = choice.poses if choice.poses.startswith("tf:") else bag.topic(choice.poses).name
        return OfferedPoses(name, PoseOrigin.CHOSEN)
    sources = pose_sources(bag)
    if not sources:
        needed = f"no topic of {', '.join(POSE_TYPES)}, and no transforms of a robot in a fixed frame"
        raise LogError(f"{bag.path}: no poses: {needed}; its topics are {bag.listed()}")
    best = [source for source in sources if source.origin is sources[0].origin]
    best = [source for source in best if source.name in bag.topics] or best  # transforms repeat what topics state
    bag.only([source.name for source in best], "poses", "--poses TOPIC")
    return best[0]


def _origin(bag: Bag, topic: Topic) -> PoseOrigin:
    """The origin of a topic's poses by its name, type and frame."""
    usual = PoseOrigin.FIX if topic.type == FIX else PoseOrigin.WHEELS if topic.type == ODOMETRY else PoseOrigin.MATCHED
    origin = next((origin for origin, marks in _MARKS.items() if re.search(marks, topic.name, re.IGNORECASE)), usual)
    if origin in (PoseOrigin.FUSED, PoseOrigin.WHEELS) and topic.type == ODOMETRY:
        first = bag.first(topic.name, 1)
        if first and _last(first[0].content.header.frame_id) in _FIXED_FRAMES:
            return PoseOrigin.MATCHED
    return origin


def _in_transforms(bag: Bag) -> list[OfferedPoses]:
    """The poses of robots' bodies in the frames at the roots of their transforms, if they have such frames."""
    parents = {child: parent for parent, child in frames_of(bag, _LOOKED_AT)}
    bodies = next((some for name in _BODIES if (some := [one for one in parents if _last(one) == name])), [])
    found = []
    for body in sorted(bodies):
        root, seen = body, {body}
        while root in parents and parents[root] not in seen:
            root = parents[root]
            seen.add(root)
        origin = PoseOrigin.TRANSFORMS if _last(root) in _FIXED_FRAMES else PoseOrigin.WHEELS
        found.append(OfferedPoses(f"tf:{root}:{body}", origin))
    return found


def _last(frame: str) -> str:
    """The last part of a frame's name, in lower case."""
    return frame.strip("/").rpartition("/")[2].lower()


def overview(bag: Bag, choice: BagChoice) -> tuple[dict[str, str], list[str], list[str]]:
    """Possible uses of a bag's topics, the sources taken under a choice, and reasons for taking none, in words.

    Uses are by topic or tf:PARENT:CHILD; a star marks those taken.
    """
    uses: dict[str, str] = {topic.name: "scans, for --plate" for topic in bag.of_type(LASER_SCAN)}
    uses |= {source.name: f"poses: {source.origin.value}" for source in pose_sources(bag)}
    uses |= {topic.name: "gyro" for topic in bag.of_type(IMU)}
    taken: list[str] = []
    doubts: list[str] = []
    try:
        topics, (left, right) = encoder_topics(bag, choice)
        uses |= dict.fromkeys((topic.name for topic in topics), "* encoders")
        named = " and ".join(topic.name for topic in topics)
        taken.append(f"encoders: {named}, left {', '.join(left)}, right {', '.join(right)}")
    except LogError as error:
        doubts.append(str(error))
    try:
        if choice.plate is not None:
            name = scan_topic(bag, choice.scan).name
            uses[name] = "* scans of the plate"
            taken.append(f"poses: the plate's in {name}")
        else:
            name = pose_source(bag, choice).name
            uses[name] = f"* {uses.get(name, 'poses')}"
            taken.append(f"poses: {name}")
        if choice.plate is None and (imu := imu_topic(bag, choice)) is not None:
            uses[imu.name] = "* gyro"
            taken.append(f"gyro: {imu.name}")
    except LogError as error:
        doubts.append(str(error))
    return uses, taken, doubts
