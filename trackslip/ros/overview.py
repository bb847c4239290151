"""What could be taken of a bag, for what, and what will be."""

from __future__ import annotations

from dataclasses import dataclass

from trackslip.errors import LogError
from trackslip.ros.bag import Bag
from trackslip.ros.choice import BagChoice
from trackslip.ros.joints import encoder_topic
from trackslip.ros.pose_sources import RANKS, chosen_source, known_source, pose_sources
from trackslip.ros.scans import LASER_SCAN, scan_topic


@dataclass(frozen=True)
class Overview:
    """Uses of the topics of a bag."""

    uses: dict[str, str]
    """By topic or tf:PARENT:CHILD: what it could be used as; with a star in front, what it is taken as."""
    taken: tuple[str, ...]
    """What is taken, one line each."""
    doubts: tuple[str, ...]
    """Why something isn't taken, one line each."""


def overview(bag: Bag, choice: BagChoice) -> Overview:
    """What could be taken, and what is."""
    uses: dict[str, str] = {topic.name: "scans, for --plate" for topic in bag.of_type(LASER_SCAN)}
    uses |= {source.name: f"poses: {RANKS[source.rank]}" for source in pose_sources(bag)}
    taken, doubts = [], []
    try:
        topic, (left, right) = encoder_topic(bag, choice)
        uses[topic.name] = "* encoders"
        taken.append(f"encoders: {topic.name}, left {', '.join(left)}, right {', '.join(right)}")
    except LogError as error:
        doubts.append(str(error))
    try:
        if choice.plate is not None:
            name = scan_topic(bag, choice.scan).name
            uses[name] = "* scans of the plate"
            taken.append(f"poses: the plate's in {name}")
        else:
            name = chosen_source(bag).name if choice.poses is None else known_source(bag, choice.poses)
            uses[name] = f"* {uses.get(name, 'poses')}"
            taken.append(f"poses: {name}")
    except LogError as error:
        doubts.append(str(error))
    return Overview(uses, tuple(taken), tuple(doubts))
