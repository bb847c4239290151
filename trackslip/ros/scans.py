"""Scans of a laser range finder from the `sensor_msgs/LaserScan` messages in a bag."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.rangefinder.series import ScanSeries
from trackslip.ros.bag import Bag, Topic
from trackslip.ros.stamps import seconds, stretches

LASER_SCAN = "sensor_msgs/msg/LaserScan"
_ANGLE = 1e-4  # difference of the first angles of equal scanners [rad]
_STEP = 1e-7  # difference of their angles between beams [rad]
_LIMITS = ("angle_min", "angle_increment", "range_min", "range_max", "time_increment")


@dataclass(frozen=True)
class Scans:
    """Scans by one clock, all with the same beams."""

    source: str
    """The topic."""
    frame: str
    """The scanner's frame, as the headers name it."""
    stamp: np.ndarray
    """(S,) int: stamps of the first rays, ascending [ns]."""
    ranges: np.ndarray  # (S, B) float32, as published [m]
    about: Any
    """A message with the angles and limits."""

    def series(self, run: str, origin: int) -> ScanSeries:
        """The scans, their times since `origin` [ns]; raises LogError for scans that can't be used."""
        limits = [float(getattr(self.about, name)) for name in _LIMITS]
        try:
            return ScanSeries.measured(run, seconds(self.stamp, origin), self.ranges, *limits)
        except LogError as error:
            raise LogError(f"topic {self.source}: {error}") from error


def scan_topic(bag: Bag, name: str | None = None) -> Topic:
    """The topic of scans, by default the only one; raises LogError if there is none, or a choice."""
    if name is not None:
        return bag.topic(name, LASER_SCAN)
    topics = bag.of_type(LASER_SCAN)
    if not topics:
        raise LogError(f"{bag.path}: no topic of {LASER_SCAN}; its topics are {bag.listed()}")
    return bag.topic(bag.only([topic.name for topic in topics], "scans", "--scan TOPIC"))


def read_scans(bag: Bag, name: str | None, notes: list[str]) -> list[Scans]:
    """The scans of a topic, one for each stretch between restarts of their clock: nearly always one.

    Scans with other beams than most are left out; `notes` gets a line for that. Raises LogError if there are none.
    """
    topic = scan_topic(bag, name)
    found: dict[Any, list[Any]] = defaultdict(list)
    frames: Counter[str] = Counter()
    for message in bag.messages(topic.name, notes=notes):
        scan = message.content
        key = len(scan.ranges), round(scan.angle_min / _ANGLE), round(scan.angle_increment / _STEP)
        found[key].append((message.stamp, message.arrival, np.array(scan.ranges, np.float32), scan))
        frames[scan.header.frame_id] += 1
    usual = max(found.values(), key=len)
    others = sum(map(len, found.values())) - len(usual)
    if others:
        notes.append(f"topic {topic.name}: {counted(others, 'scan')} with other beams than most left out")
    stamps, arrivals, ranges, about = zip(*usual, strict=True)
    stamp, values, frame = np.array(stamps, np.int64), np.stack(ranges), frames.most_common(1)[0][0]
    rows = stretches(topic.name, stamp, np.array(arrivals, np.int64), notes)
    return [Scans(topic.name, frame, stamp[part], values[part], about[0]) for part in rows]
