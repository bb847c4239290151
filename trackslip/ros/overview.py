"""What could be taken of a bag, for what, and what will be."""

from __future__ import annotations

from dataclasses import dataclass

from trackslip.errors import LogError
from trackslip.ros.bag import Bag
from trackslip.ros.choice import BagChoice
from trackslip.ros.encoders import encoder_topic
from trackslip.ros.pose_sources import RANKS, chosen_source, pose_sources

SCAN = "sensor_msgs/msg/LaserScan"


@dataclass(frozen=True)
class Overview:
    """Uses of the topics of a bag."""

    uses: dict[str, str]
    """By topic or tf:PARENT:CHILD: what it could be used for; with a star in front, will be."""
    doubts: tuple[str, ...]
    """Why something isn't chosen, one line each; empty where the choice is clear."""


def overview(bag: Bag, choice: BagChoice) -> Overview:
    """What could be taken, and what will be."""
    uses: dict[str, str] = {topic.name: "scans" for topic in bag.of_type(SCAN)}
    doubts = []
    sources = pose_sources(bag)
    uses |= {source.name: f"poses: {RANKS[source.rank]}" for source in sources}
    try:
        topic, (left, right) = encoder_topic(bag, choice)
        uses[topic.name] = f"* encoders: left {', '.join(left)}; right {', '.join(right)}"
    except LogError as error:
        doubts.append(str(error))
    try:
        name = chosen_source(bag).name if choice.poses is None else choice.poses
        uses[name] = f"* {uses.get(name, 'poses')}"
    except LogError as error:
        doubts.append(str(error))
    return Overview(uses, tuple(doubts))
