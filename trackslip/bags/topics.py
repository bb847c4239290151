"""The encoders, poses, gyros and scans in a bag, and the choice among them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import islice
from typing import Final

from trackslip.bags.choice import BagChoice
from trackslip.bags.counters import advice, counter_names, full_names, likely_counters
from trackslip.bags.open import Bag, Topic, listed
from trackslip.bags.transforms import frames_of, parents_of, path_up
from trackslip.errors import LogError

JOINT_STATE: Final = "sensor_msgs/msg/JointState"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
FIX: Final = "sensor_msgs/msg/NavSatFix"
IMU: Final = "sensor_msgs/msg/Imu"
LASER_SCAN: Final = "sensor_msgs/msg/LaserScan"
POSE_TYPES: Final = (
    ODOMETRY,
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
    FIX,
)
"""Message types with poses, besides transforms."""
Sides = tuple[tuple[str, ...], tuple[str, ...]]  # names of the joints on the left and on the right
WHEELS: Final[Sides] = (
    ("left wheels",),
    ("right wheels",),
)  # placeholders for joints if odometry is used

# Words in the names of topics, joints and frames from ROS packages for robots and localization.
_WANTED: Final = r"goal|initial_?pose|target|setpoint|cmd|command|desired|reference|waypoint|plan\b"
_LESSER_IMU: Final = r"camera|realsense|zed|oak|lidar|ouster|\bos\d?_|livox|velodyne|raw"
_WORDS: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_DRIVES: Final = re.compile(r"wheel|track|sprocket|belt|crawler|whl", re.IGNORECASE)
_OTHER: Final = re.compile(
    r"arm|hip|pan|tilt|head|neck|knee|ankle|calf"
    r"|(steer|caster|castor|flipper|finger|gripper|shoulder|elbow|wrist|thigh).*"
)
_LEFT: Final = {
    "left",
    "l",
    "fl",
    "lf",
    "rl",
    "lr",
    "bl",
    "lb",
    "ml",
    "lm",
    "cl",
    "lc",
    "lh",
    "lhs",
}
_RIGHT: Final = {"right", "r", "fr", "rf", "rr", "br", "rb", "mr", "rm", "cr", "rc", "rh", "rhs"}
_FIXED_FRAMES: Final = ("map", "world", "earth", "mocap", "vicon", "utm", "ned", "enu", "field")
_BODIES: Final = ("base_link", "base_footprint", "base", "chassis", "robot")
# numbers of messages that are searched for names, from the start
_JOINT_MESSAGES: Final = 100
_FRAME_MESSAGES: Final = 5000
_MOST_NAMES: Final = 100_000  # number of names in which joints are searched, from the start


class PoseOrigin(Enum):
    """Origins of poses, in order of decreasing independence from the wheels."""

    CHOSEN = "as asked for"
    MOCAP = "motion capture"
    MATCHED = "measured poses"
    TRANSFORMS = "transforms from a fixed frame"
    FIX = "satellite positions"
    TRUTH = "a simulator's truth"
    FUSED = "fused odometry, perhaps with the wheels"
    WHEELS = "odometry, perhaps from the wheels"
    IMU = "headings of an IMU"


_MARKS: Final = {
    PoseOrigin.MOCAP: r"vicon|optitrack|mocap|motion_capture|qualisys|vrpn|natnet"
    r"|total_?station|leica",
    PoseOrigin.TRUTH: r"ground_?truth|\btruth|gazebo|p3d|perfect",
    PoseOrigin.FUSED: r"filtered|fused|ekf|ukf|kalman|imu",
    PoseOrigin.MATCHED: r"slam|amcl|locali[sz]|lio|loam|icp|ndt|kiss|hdl|cartographer|rtabmap"
    r"|vins|vio\b|visual|lidar|laser|\bzed|scan|t265",
}


@dataclass(frozen=True)
class PoseSource:
    """A topic or a pair of frames that has poses."""

    name: str  # the topic, or tf:PARENT:CHILD
    origin: PoseOrigin


def encoder_topics(bag: Bag, choice: BagChoice) -> tuple[list[Topic], Sides]:
    """The topics with the encoders, and the joints, or counters, on the left and on the right.

    Raises LogError if the choice doesn't fit the bag or is ambiguous: the message lists the bag's
    topics or joints.
    """
    if choice.encoders is None:
        topics = _joint_topics(bag, choice)
        return topics, _required_sides(bag, topics, _joint_names(bag, topics), choice)
    topics = [bag.topic(name.strip()) for name in choice.encoders.split(",")]
    types = {topic.type for topic in topics}
    if types == {JOINT_STATE}:
        return topics, _required_sides(bag, topics, _joint_names(bag, topics), choice)
    if ODOMETRY in types:
        if len(topics) > 1:
            raise LogError(f"{bag.path}: encoders: odometry must be one topic, {ODOMETRY}")
        return topics, WHEELS
    if JOINT_STATE in types:
        raise LogError(f"{bag.path}: encoders: topics must be of one type, such as {JOINT_STATE}")
    return topics, _required_sides(bag, topics, counter_names(bag, topics), choice)


def _joint_topics(bag: Bag, choice: BagChoice) -> list[Topic]:
    """The topics of joint states to read unless the choice names them: one that has all joints, or
    all of those that have some.
    """
    topics = bag.of_type(JOINT_STATE)
    if not topics:
        raise LogError(f"{bag.path}: no encoders: no topic of {JOINT_STATE}{_instead(bag)}")
    topics = [
        topic for topic in topics if not re.search(_WANTED, topic.name, re.IGNORECASE)
    ] or topics
    complete = [
        topic.name
        for topic in topics
        if _sides_of(bag, _joint_names(bag, [topic]), choice) is not None
    ]
    if not complete:  # each topic may have some of the joints
        return topics
    usual = [name for name in complete if name.strip("/") == "joint_states"] or complete
    return [bag.topics[bag.only(usual, "encoders", "--encoders TOPIC")]]


def _required_sides(
    bag: Bag, topics: Sequence[Topic], names: Sequence[str], choice: BagChoice
) -> Sides:
    """The joints, or counters, on the left and on the right; LogError if they are unknown."""
    found = _sides_of(bag, names, choice)
    if found is None:
        raise LogError(
            f"{bag.path}: topic {topics[0].name}: which of its joints are left and right? It has "
            f"{listed(names)}: choose with --left NAMES --right NAMES"
        )
    return found


def _instead(bag: Bag) -> str:
    """Advice on a bag without joint states, as the end of an error message."""
    counters = likely_counters(bag)
    if counters:
        return advice(counters, sides([*counters]))
    reckoned = "; --encoders TOPIC takes odometry from the wheels" if bag.of_type(ODOMETRY) else ""
    return f"{reckoned}; its topics are {bag.listed()}"


def _sides_of(bag: Bag, names: Sequence[str], choice: BagChoice) -> Sides | None:
    """The chosen joints or, by default, those of the `names` that are recognised; None if none
    are.
    """
    if choice.left is not None and choice.right is not None:
        return full_names(choice.left, names), full_names(choice.right, names)
    return sides(names)


def _joint_names(bag: Bag, topics: Sequence[Topic]) -> list[str]:
    messages = (
        message for topic in topics for message in islice(bag.messages(topic.name), _JOINT_MESSAGES)
    )
    names = (
        name
        for message in messages
        for name in message.content.name
        if isinstance(name, str)  # a bag may define its messages otherwise
    )
    return [*dict.fromkeys(islice(names, _MOST_NAMES))]


def sides(names: Sequence[str]) -> Sides | None:
    """Names of the driven joints on the left and on the right; None if these are not recognised.

    Joints named after wheels or tracks are preferred; joints of arms, steering and similar parts
    are ignored.
    """
    candidates = [
        name for name in names if not any(_OTHER.fullmatch(word) for word in _words(name))
    ]
    for some in ([name for name in candidates if _DRIVES.search(name)], candidates):
        left, right = (
            tuple(name for name in some if _side(name) == side) for side in ("left", "right")
        )
        if left and len(left) == len(right):
            return left, right
    return None


def _side(name: str) -> str:
    """The side in a joint's name: left, right, or an empty string if the name contains neither or
    both.
    """
    words, plain = _words(name), name.lower()
    left = bool(words & _LEFT) or "left" in plain
    right = bool(words & _RIGHT) or "right" in plain
    if left == right:
        return ""
    return "left" if left else "right"


def _words(name: str) -> set[str]:
    """The words in a name, in lower case, such as front, left and wheel for front_leftWheel2."""
    return {word.lower() for word in _WORDS.findall(name)}


def pose_sources(bag: Bag) -> list[PoseSource]:
    """All sources of poses in a bag, best first."""
    topics = [
        topic
        for topic in bag.of_type(*POSE_TYPES)
        if not re.search(_WANTED, topic.name, re.IGNORECASE)
    ]
    found = [
        *(PoseSource(topic.name, _origin(bag, topic)) for topic in topics),
        *_in_transforms(bag),
    ]
    return sorted(found, key=lambda source: list(PoseOrigin).index(source.origin))


def pose_source(bag: Bag, choice: BagChoice) -> PoseSource:
    """The chosen pose source or, by default, the best; IMUs come last. LogError if there is none or
    no single best.
    """
    if choice.poses is not None:
        name = choice.poses if choice.poses.startswith("tf:") else bag.topic(choice.poses).name
        return PoseSource(name, PoseOrigin.CHOSEN)
    encoders = [bag.topic(name.strip()).name for name in (choice.encoders or "").split(",") if name]
    sources = [source for source in pose_sources(bag) if source.name not in encoders]
    if not sources:
        imu = imu_topic(bag, choice)
        if imu is not None:
            return PoseSource(imu.name, PoseOrigin.IMU)
        needed = (
            f"no other topic of {', '.join((*POSE_TYPES, IMU))}, and no transforms of a "
            "robot in a fixed frame"
        )
        raise LogError(f"{bag.path}: no poses: {needed}; its topics are {bag.listed()}")
    best = [source for source in sources if source.origin is sources[0].origin]
    # transforms repeat topics' poses
    best = [source for source in best if source.name in bag.topics] or best
    bag.only([source.name for source in best], "poses", "--poses TOPIC")
    return best[0]


def _origin(bag: Bag, topic: Topic) -> PoseOrigin:
    """The origin of a topic's poses, according to the topic's name, type and frame."""
    usual = {FIX: PoseOrigin.FIX, ODOMETRY: PoseOrigin.WHEELS}.get(topic.type, PoseOrigin.MATCHED)
    origin = next(
        (origin for origin, marks in _MARKS.items() if re.search(marks, topic.name, re.IGNORECASE)),
        usual,
    )
    if origin in (PoseOrigin.FUSED, PoseOrigin.WHEELS) and topic.type == ODOMETRY:
        first = bag.first(topic.name, 1)
        if first and _last(first[0].content.header.frame_id) in _FIXED_FRAMES:
            return PoseOrigin.MATCHED
    return origin


def _in_transforms(bag: Bag) -> list[PoseSource]:
    """Sources in the transforms: robot bodies with their root frames."""
    parents = parents_of(frames_of(bag, _FRAME_MESSAGES))
    of_name = ([child for child in sorted(parents) if _last(child) == name] for name in _BODIES)
    sources = []
    for body in next(filter(None, of_name), []):
        root = path_up(body, parents)[-1]
        origin = PoseOrigin.TRANSFORMS if _last(root) in _FIXED_FRAMES else PoseOrigin.WHEELS
        sources.append(PoseSource(f"tf:{root}:{body}", origin))
    return sources


def _last(frame: str) -> str:
    """The last part of a frame's name, in lower case."""
    return frame.strip("/").rpartition("/")[2].lower()


def imu_topic(bag: Bag, choice: BagChoice) -> Topic | None:
    """The chosen IMU topic or, by default, the one with most messages; IMUs in other sensors come
    last. May be None.
    """
    if choice.imu is not None:
        return None if choice.imu == "none" else bag.topic(choice.imu, IMU)

    def rank(topic: Topic) -> tuple[bool, int]:
        return bool(re.search(_LESSER_IMU, topic.name, re.IGNORECASE)), -topic.count

    return min(bag.of_type(IMU), key=rank, default=None)


def scan_topic(bag: Bag, name: str | None = None) -> Topic:
    """The topic of scans called `name` or, by default, the only one; raises LogError if there is
    none, or several.
    """
    if name is not None:
        return bag.topic(name, LASER_SCAN)
    topics = bag.of_type(LASER_SCAN)
    if not topics:
        raise LogError(f"{bag.path}: no topic of {LASER_SCAN}; its topics are {bag.listed()}")
    return bag.topic(bag.only([topic.name for topic in topics], "scans", "--scan TOPIC"))
