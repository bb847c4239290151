"""The topic of the encoders and its joints on the left and the right, by their names."""

from __future__ import annotations

import re
from collections.abc import Sequence

from trackslip.errors import LogError
from trackslip.ros.bag import Bag, Topic, listed
from trackslip.ros.choice import AUTOMATIC, BagChoice

JOINT_STATE, ODOMETRY = "sensor_msgs/msg/JointState", "nav_msgs/msg/Odometry"
Sides = tuple[tuple[str, ...], tuple[str, ...]]
"""Names of the joints on the left and on the right."""
WHEELS: Sides = ("left wheels",), ("right wheels",)
"""What stands for the joints in odometry."""
_COMMANDS = re.compile(r"command|cmd|desired|target|setpoint|reference|goal", re.IGNORECASE)
_LOOKED_AT = 100  # messages whose joints are looked at to choose a topic
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_DRIVES = re.compile(r"wheel|track|sprocket|belt|crawler|whl", re.IGNORECASE)
_OTHERS = {"arm", "hip", "pan", "tilt", "head", "neck", "knee", "ankle", "calf"}
_OTHERS_BEGIN = ("steer", "caster", "castor", "flipper", "finger", "gripper", "shoulder", "elbow", "wrist", "thigh")
_LEFT = {"left", "l", "fl", "lf", "rl", "lr", "bl", "lb", "ml", "lm", "cl", "lc", "lh", "lhs"}
_RIGHT = {"right", "r", "fr", "rf", "rr", "br", "rb", "mr", "rm", "cr", "rc", "rh", "rhs"}


def encoder_topics(bag: Bag, choice: BagChoice = AUTOMATIC) -> tuple[tuple[Topic, ...], Sides]:
    """The topic with the encoders, or several where each has some of them, and the joints on the left and on the right.

    Raises LogError if the choice doesn't fit the bag, or leaves a doubt: the message lists what there is.
    """
    if choice.encoders is not None:
        chosen = tuple(bag.topic(name.strip()) for name in choice.encoders.split(","))
        if [topic.type for topic in chosen] == [ODOMETRY]:
            if choice.wheels is None:
                raise LogError(
                    f"{bag.path}: topic {chosen[0].name}: speeds of wheels need the geometry that it assumes"
                )
            return chosen, WHEELS
        chosen = tuple(bag.topic(topic.name, JOINT_STATE) for topic in chosen)
        return chosen, _joints(bag, chosen, choice)
    topics = bag.of_type(JOINT_STATE)
    if not topics:
        reckoned = "; --encoders TOPIC takes odometry from the wheels" if bag.of_type(ODOMETRY) else ""
        raise LogError(f"{bag.path}: no encoders: no topic of {JOINT_STATE}{reckoned}; its topics are {bag.listed()}")
    topics = [topic for topic in topics if not _COMMANDS.search(topic.name)] or topics
    fitting: dict[str, tuple[tuple[Topic, ...], Sides]] = {}
    refused = []
    for some in (*((topic,) for topic in topics), tuple(topics)):
        try:
            if not fitting or len(some) == 1:
                fitting[some[0].name] = some, _joints(bag, some, choice)
        except LogError as error:
            refused.append(error)
    if not fitting:
        raise refused[0]
    names = sorted(fitting)
    names = [name for name in names if name.rpartition("/")[2] == "joint_states"] or names
    names = [name for name in names if name.strip("/") == "joint_states"] or names
    return fitting[bag.only(names, "encoders", "--encoders TOPIC")]


def _joints(bag: Bag, topics: Sequence[Topic], choice: BagChoice) -> Sides:
    """The chosen joints, or the ones recognised by their names; LogError if there are none."""
    if choice.left is not None and choice.right is not None:
        return choice.left, choice.right
    messages = (message for topic in topics for message in bag.first(topic.name, _LOOKED_AT))
    names = [*dict.fromkeys(name for message in messages for name in message.content.name)]
    found = sides(names)
    if found is None:
        raise LogError(
            f"{bag.path}: topic {topics[0].name}: which of its joints are left and right? It has {listed(names)}: "
            "choose with --left NAMES --right NAMES"
        )
    return found


def sides(names: Sequence[str]) -> Sides | None:
    """Names of the driven joints on the left and on the right; None if they aren't recognised.

    Joints whose names speak of wheels or tracks come before others, and arms, steering and the like don't count.
    """
    candidates = [name for name in names if not any(map(_drives_neither, _words(name)))]
    for some in ([name for name in candidates if _DRIVES.search(name)], candidates):
        left, right = (tuple(name for name in some if _side(name) == side) for side in ("left", "right"))
        if left and len(left) == len(right):
            return left, right
    return None


def _side(name: str) -> str:
    """left, right, or an empty text if the name contains neither or both."""
    words, plain = _words(name), name.lower()
    left = bool(words & _LEFT) or "left" in plain
    right = bool(words & _RIGHT) or "right" in plain
    return "" if left == right else "left" if left else "right"


def _words(name: str) -> set[str]:
    """The words in a name, in lower case: front, left and wheel of front_leftWheel2."""
    return {word.lower() for word in _WORDS.findall(name)}


def _drives_neither(word: str) -> bool:
    """True if a word names a joint that drives neither side."""
    return word in _OTHERS or word.startswith(_OTHERS_BEGIN)
