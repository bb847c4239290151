"""Bags of ROS 1 and ROS 2: their topics and messages.

from trackslip.ros.bag import open_bag

bag = open_bag("run.mcap")
for message in bag.messages("/scan"):
    message.stamp, message.content.ranges
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.logs.runlog import Refused, none_usable
from trackslip.ros.files import Parts, is_kept, read_parts
from trackslip.ros.messages import decode, require_rosbags
from trackslip.ros.readers import Record, read_file

T = TypeVar("T")
_SHOWN = 12  # names in a message


class Message(NamedTuple):
    """A message, decoded."""

    topic: str
    arrival: int
    """Time of recording [ns]."""
    content: Any
    """Its fields as attributes: `content.header.stamp.sec`."""

    @property
    def stamp(self) -> int:
        """The stamp in its header [ns]."""
        stamp = self.content.header.stamp
        return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


@dataclass(frozen=True)
class Topic:
    """A topic in a bag."""

    name: str
    type: str
    """Name of the message type, as in `sensor_msgs/msg/JointState`."""
    arrival: np.ndarray
    """(n,) int: times of recording of its messages, ascending [ns]."""

    @property
    def count(self) -> int:
        """Number of messages."""
        return len(self.arrival)

    @cached_property
    def intervals(self) -> np.ndarray:
        """(n - 1,) times between messages [s]."""
        return np.diff(self.arrival) / 1e9

    @property
    def rate(self) -> float:
        """Median rate [Hz]; NaN of a single message."""
        usual = float(np.median(self.intervals)) if self.count > 1 else 0.0
        return 1.0 / usual if usual > 0.0 else np.nan

    @property
    def longest_gap(self) -> float:
        """Longest time between messages [s]; NaN of a single message."""
        return float(self.intervals.max()) if self.count > 1 else np.nan


@dataclass(frozen=True)
class Bag:
    """A recording of any format, of one or several files."""

    name: str
    files: tuple[Path, ...]
    topics: dict[str, Topic]
    """By name, in alphabetical order; only those with messages."""
    notes: tuple[str, ...]
    """Damage and missing files, one line each."""
    span: tuple[int, int]
    """Times at which the first and the last message were recorded [ns]."""
    max_expanded: float | None = None
    """Largest size of a file's content once decompressed [MB]; None for 268 MB and 100 times the file's size."""
    kept: Sequence[Record] | None = field(default=None, repr=False)
    """Its small messages, which need not be read again; None if they are too many."""

    @property
    def path(self) -> Path:
        """Its file, or the folder of its files."""
        return self.files[0] if len(self.files) == 1 else self.files[0].parent

    def topic(self, name: str, kind: str | None = None) -> Topic:
        """The topic of a name; raises LogError for an unknown name, or messages of another type than `kind`."""
        bare = name.strip("/")
        found = self.topics.get(name) or self.topics.get(f"/{bare}") or self.topics.get(bare)
        if found is None:
            raise LogError(f"{self.path}: it has no topic {name!r}; its topics are {self.listed()}")
        if kind not in (None, found.type):
            raise LogError(f"{self.path}: topic {found.name} has messages of {found.type}, needs {kind}")
        return found

    def only(self, names: Sequence[str], what: str, option: str) -> str:
        """The only name; raises LogError, which asks for the option, if there are several."""
        if len(names) > 1:
            raise LogError(f"{self.path}: {what} may be {', '.join(names)}: choose with {option}")
        return names[0]

    def of_type(self, *types: str) -> list[Topic]:
        """The topics whose messages have one of the types, given as `sensor_msgs/msg/JointState`."""
        return [topic for topic in self.topics.values() if topic.type in types]

    def messages(self, *topics: str, notes: list[str] | None = None) -> Iterator[Message]:
        """Decoded messages of topics, in the order of the files, which is nearly the order of arrival.

        Messages that can't be decoded are left out; `notes` gets a line for each topic that has some. Raises LogError
        for an unknown topic, or one none of whose messages can be decoded.
        """
        chosen = {found.name: found.type for found in map(self.topic, topics)}
        damaged: Counter[str] = Counter()
        reasons: dict[str, str] = {}
        for channel, arrival, data in self._records(chosen):
            if chosen.get(channel.topic) != channel.type:
                continue
            try:
                yield Message(channel.topic, arrival, decode(channel, data))
            except LogError as error:
                damaged[channel.topic] += 1
                reasons.setdefault(channel.topic, str(error))
        for topic, count in damaged.items():
            total = self.topics[topic].count
            if count == total:
                raise LogError(f"{self.path}: topic {topic}: no message can be decoded: {reasons[topic]}")
            if notes is not None:
                notes.append(f"topic {topic}: {count} of {total} messages left out: {reasons[topic]}")

    def _records(self, chosen: Mapping[str, str]) -> Iterable[Record]:
        """Records of at least the chosen topics, given with their types, in the order of the files."""
        if self.kept is not None and all(map(is_kept, chosen.values())):
            return self.kept
        return (
            record
            for file in self.files
            for record in read_file(file, lambda channel: channel.topic in chosen, [], self.max_expanded)
        )

    def first(self, topic: str, most: int) -> list[Message]:
        """The first messages of a topic that can be decoded, at most `most`; next to nothing else is read."""
        return list(islice(self.messages(topic), min(most, self.topic(topic).count)))

    def listed(self) -> str:
        """The first topics with their types, for a message."""
        return listed([f"{name} ({topic.type})" for name, topic in self.topics.items()])


def listed(names: Sequence[str]) -> str:
    """The first of some names, for a message."""
    more = f", ... ({len(names)} of them)" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN] or ["none"]) + more


def open_bag(path: str | Path, max_expanded: float | None = None) -> Bag:
    """The bag in a file, or in a folder that holds one; reads its topics and counts messages.

    Files: `.bag` of ROS 1, `.mcap` and `.db3` of ROS 2, compressed or not, with or without `metadata.yaml`. What is
    damaged or cut off is left out, see `Bag.notes`.

    Raises:
        LogError: if there is no bag, if there are several, or nothing in it can be read.
    """
    bags = open_bags(path, max_expanded)
    if len(bags) > 1:
        raise LogError(f"{path}: holds {len(bags)} bags ({', '.join(bag.name for bag in bags[:_SHOWN])}): name one")
    return bags[0]


def open_bags(path: str | Path, max_expanded: float | None = None) -> list[Bag]:
    """The bags in a folder, like `open_bag`; bags that can't be read are left out if others can be."""
    require_rosbags()
    return [_bag(parts, max_expanded) for parts in read_parts(Path(path), max_expanded)]


def read_each(
    path: Path, read: Callable[[Bag, str, list[str]], Sequence[T]], max_expanded: float | None = None
) -> tuple[list[T], tuple[Refused, ...], tuple[str, ...]]:
    """Results of `read` for the bags in a folder, the bags that it refuses, and notes on what was left out.

    `read` takes a bag, its name and a list for notes. Raises LogError if it refuses all bags.
    """
    bags = open_bags(path, max_expanded)
    found: list[T] = []
    refused: list[Refused] = []
    notes: list[str] = []
    for bag in bags:
        name = bag.name if sum(other.name == bag.name for other in bags) == 1 else str(bag.files[0])
        said: list[str] = []
        try:
            found += read(bag, name, said)
        except LogError as error:
            refused.append(Refused.of(name, error))
        notes += [*bag.notes, *(said if len(bags) == 1 else (f"{name}: {line}" for line in said))]
    if not found:
        raise LogError(refused[0].reason if len(bags) == 1 else none_usable(refused))
    return found, tuple(refused), tuple(notes)


def _bag(parts: Parts, max_expanded: float | None) -> Bag:
    """The bag; of a topic with several message types, only the type with most messages."""
    topics: dict[str, Topic] = {}
    notes = [*parts.notes]
    for (name, kind), times in sorted(parts.arrivals.items(), key=lambda item: (item[0][0], -len(item[1]))):
        if name in topics:
            notes.append(f"topic {name}: {counted(len(times), 'message')} of another type, {kind}, left out")
        else:
            topics[name] = Topic(name, kind, np.sort(np.array(times, np.int64)))
    return Bag(parts.name, parts.files, topics, tuple(notes), parts.span, max_expanded, parts.kept)
