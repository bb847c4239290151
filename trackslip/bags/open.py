"""Bags of ROS 1 and ROS 2: their topics and messages, read by rosbags.

from trackslip.bags.open import open_bag

bag = open_bag("run.mcap")
for message in bag.messages("/scan"):
    message.stamp, message.content.ranges
"""

from __future__ import annotations

import importlib
import io
import os
import shlex
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from trackslip.errors import LogError, TrackslipError, first_line
from trackslip.files import regular_file
from trackslip.kinematics import Array
from trackslip.logs.runlog import Refused, none_usable

T = TypeVar("T")
_METADATA = "metadata.yaml"
_STORAGES = (".bag", ".mcap", ".db3")
_WRAPPINGS = {".zstd": "it is compressed as a whole", ".active": "the recording was not closed"}
_REPAIRS = {
    ".bag": "rosbag reindex {file}",
    ".active": "rosbag reindex {file}",
    ".mcap": "mcap recover {file} -o NEW.mcap",
    ".db3": "sqlite3 {file} .recover | sqlite3 NEW.db3",
    ".zstd": "zstd -d {file}",
}
_MCAP_END = b"\x89MCAP0\r\n"
_DEPTH = 3  # of folders in folders
_SHOWN = 12  # names in a message


class Message(NamedTuple):
    """A message, decoded."""

    topic: str
    arrival: int
    """Time of recording [ns]."""
    content: Any
    """Its fields as attributes: `content.header.stamp.sec`; None if only times are read."""

    @property
    def stamp(self) -> int:
        """The stamp in its header [ns]."""
        return stamp_of(self.content.header)


def stamp_of(header: Any) -> int:
    """The stamp in a header [ns]."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


Read = Callable[[Mapping[str, str], bool], Iterator[Message]]
"""Reads the messages of topics, given with their types, by time of recording; decodes their content or not."""


@dataclass(frozen=True)
class Topic:
    """A topic in a bag."""

    name: str
    type: str
    """Name of the message type, as in `sensor_msgs/msg/JointState`."""
    count: int
    """Number of messages."""


@dataclass(frozen=True)
class Bag:
    """A recording of any format."""

    name: str
    path: Path
    """Its file, or the folder of a ROS 2 bag."""
    topics: dict[str, Topic]
    """By name, in alphabetical order; of several types of messages in a topic, the most frequent one."""
    span: tuple[int, int]
    """Times at which the first and the last message were recorded [ns]."""
    read: Read = field(repr=False)
    notes: tuple[str, ...] = ()
    """What is missing, one line each."""

    def topic(self, name: str, kind: str | None = None) -> Topic:
        """The topic of a name; raises LogError for an unknown name, or messages of another type than `kind`."""
        bare = name.strip("/")
        topic = self.topics.get(name) or self.topics.get(f"/{bare}") or self.topics.get(bare)
        if topic is None:
            raise LogError(f"{self.path}: it has no topic {name!r}; its topics are {self.listed()}")
        if kind not in (None, topic.type):
            raise LogError(f"{self.path}: topic {topic.name} has messages of {topic.type}, needs {kind}")
        return topic

    def only(self, names: Sequence[str], what: str, option: str) -> str:
        """The only name; raises LogError, which asks for the option, if there are several."""
        if len(names) > 1:
            raise LogError(f"{self.path}: {what} may be {', '.join(names)}: choose with {option}")
        return names[0]

    def of_type(self, *types: str) -> list[Topic]:
        """The topics whose messages have one of the types, given as `sensor_msgs/msg/JointState`."""
        return [topic for topic in self.topics.values() if topic.type in types]

    def messages(self, *topics: str) -> Iterator[Message]:
        """Decoded messages of topics, by time of recording; raises LogError for unknown topics and damage."""
        return self.read({topic.name: topic.type for topic in map(self.topic, topics)}, True)

    def table(
        self, topics: Sequence[str], row: Callable[[Any], Sequence[float] | None]
    ) -> tuple[np.ndarray, np.ndarray, Array]:
        """Stamps and arrivals (n,) [ns] of messages, and the numbers (n, k) that `row` takes from the content of each.

        Messages for which it returns None are left out. Numbers may be NaN, but no signalling ones of damaged bytes.
        """
        times, numbers = array("q"), array("d")
        for message in self.messages(*topics):
            values = row(message.content)
            if values is not None:
                times.extend((message.stamp, message.arrival))
                numbers.extend(values)
        stamp, arrival = np.array(times, np.int64).reshape(-1, 2).T
        table = np.array(numbers).reshape(len(stamp), -1) if len(stamp) else np.empty((0, 0))
        table[np.isnan(table)] = np.nan
        return stamp, arrival, table

    def first(self, topic: str, most: int) -> list[Message]:
        """The first messages of a topic, at most `most`."""
        return list(islice(self.messages(topic), most))

    def arrivals(self) -> dict[str, np.ndarray]:
        """Times of recording (n,) of the messages of each topic, ascending [ns]; reads the whole bag."""
        times = {name: array("q") for name in self.topics}
        for message in self.read({name: topic.type for name, topic in self.topics.items()}, False):
            times[message.topic].append(message.arrival)
        return {name: np.sort(np.array(some, np.int64)) for name, some in times.items()}

    def listed(self) -> str:
        """The first topics with their types, for a message."""
        return listed([f"{topic.name} ({topic.type})" for topic in self.topics.values()])


def listed(names: Sequence[str]) -> str:
    """The first of some names, for a message."""
    more = f", ... ({len(names)} of them)" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN] or ["none"]) + more


def short_type(name: str) -> str:
    """The name of a message type as people write it, `package/Type`."""
    return name.replace("/msg/", "/")


def has_rosbags() -> bool:
    """True if rosbags is installed, and what else the extra `ros` installs."""
    try:
        for package in ("rosbags.typesys", "mcap", "pymap3d"):
            importlib.import_module(package)
    except ImportError:
        return False
    return True


def require_rosbags() -> None:
    """Raise TrackslipError unless rosbags is installed."""
    if not has_rosbags():
        raise TrackslipError('bags need the package rosbags: pip install -e ".[ros]"')


def is_bag(path: Path) -> bool:
    """True for a bag's file, or a folder with bags."""
    return bool(_places(path))


def open_bag(path: str | Path) -> Bag:
    """The bag in a file, or in a folder that holds one; reads its topics and counts messages.

    Files: `.bag` of ROS 1, `.mcap` and `.db3` of ROS 2, with or without `metadata.yaml`. An MCAP file whose end is
    missing is read as far as it goes, see `Bag.notes`.

    Raises:
        LogError: if there is no bag, if there are several, or it is damaged: the message names a command that repairs.
        TrackslipError: where rosbags is missing.
    """
    bags = open_bags(path)
    if len(bags) > 1:
        raise LogError(f"{path}: holds {len(bags)} bags ({', '.join(bag.name for bag in bags[:_SHOWN])}): name one")
    return bags[0]


def open_bags(path: str | Path) -> list[Bag]:
    """The bags in a folder, like `open_bag`: folders with a metadata.yaml, and files in others.

    Bags that can't be read are left out if others can be, with a note.
    """
    require_rosbags()
    path = Path(path)
    try:
        if not path.exists():
            raise LogError(f"{path}: no such file or folder")
        places = _places(path)
    except OSError as error:
        raise LogError(f"path = {str(path)[:80]!r}: {error.strerror}") from error
    if not places:
        raise LogError(f"{path}: holds no bag (.bag, .mcap or .db3)" if path.is_dir() else f"{path}: is no bag")
    bags, notes = [], []
    for place in places:
        try:
            bags.append(_open(place))
        except LogError as error:
            notes.append(str(error))
            if place.is_dir():
                notes[-1] += f"; read without its {_METADATA}"
                places += _files(place)
    if not bags:
        raise LogError(notes[-1])
    return [replace(bags[0], notes=(*bags[0].notes, *notes)), *bags[1:]]


def read_each(
    path: Path, read: Callable[[Bag, str, list[str]], Sequence[T]]
) -> tuple[list[T], tuple[Refused, ...], tuple[str, ...]]:
    """Results of `read` for the bags in a folder, the bags that it refuses, and notes on what was left out.

    `read` takes a bag, its name and a list for notes. Raises LogError if it refuses all bags.
    """
    bags = open_bags(path)
    results: list[T] = []
    refused: list[Refused] = []
    notes: list[str] = []
    for bag in bags:
        name = bag.name if sum(other.name == bag.name for other in bags) == 1 else str(bag.path)
        said: list[str] = []
        try:
            results += read(bag, name, said)
        except LogError as error:
            refused.append(Refused.of(name, error))
        notes += [*bag.notes, *(said if len(bags) == 1 else (f"{name}: {line}" for line in said))]
    if not results:
        raise LogError(refused[0].reason if len(bags) == 1 else none_usable(refused))
    return results, tuple(refused), tuple(notes)


def _places(path: Path, depth: int = _DEPTH) -> list[Path]:
    """The bags in a folder, or the one of a file: folders with metadata, and files."""
    if not path.is_dir():
        return [path] if _is_bag_file(path) else []
    places = _files(path)
    if places and (path / _METADATA).is_file():
        return [path]
    for folder in sorted(path.iterdir()) if depth else ():
        if folder.is_dir() and os.access(folder, os.R_OK | os.X_OK):
            places += _places(folder, depth - 1)
    return places


def _files(folder: Path) -> list[Path]:
    """The files of bags in a folder."""
    return sorted(entry for entry in folder.iterdir() if _is_bag_file(entry) and entry.is_file())


def _is_bag_file(path: Path) -> bool:
    """True for the name of a bag's file."""
    suffixes = [suffix for suffix in path.suffixes if suffix not in _WRAPPINGS]
    return bool(suffixes) and suffixes[-1] in _STORAGES


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Turn what readers raise into a LogError of one line, which names the command that repairs the file."""
    try:
        yield
    except LogError:
        raise
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or first_line(error)}") from error
    except Exception as error:  # readers of damaged files raise whatever they meet first
        reason = first_line(error).rstrip(".")
        repair = _REPAIRS.get(path.suffix, "ros2 bag reindex {file}").format(file=shlex.quote(str(path)))
        raise LogError(f"{path}: can't be read ({reason}); this may repair it: {repair}") from error


def _open(path: Path) -> Bag:
    """The bag of a file, or of a folder with metadata."""
    try:
        return _indexed(path)
    except LogError:
        if path.suffix != ".mcap":
            raise
        return _streamed(path)


def _bag(path: Path, counts: Counter[tuple[str, str]], span: tuple[int, int], read: Read, *notes: str) -> Bag:
    """A bag of numbers of messages by topic and type."""
    if not +counts:
        raise LogError(f"{path}: it has no messages")
    name = path.resolve().name
    if path.is_file():
        for suffix in _STORAGES:
            name = name.removesuffix(suffix)
    by_count = sorted((count, topic, kind) for (topic, kind), count in counts.items() if count)
    topics = {topic: Topic(topic, kind, count) for count, topic, kind in by_count}
    return Bag(name, path, dict(sorted(topics.items())), span, read, notes)


def _indexed(path: Path) -> Bag:
    """A bag that rosbags reads."""
    with _refusing(path):
        if path.suffix in _WRAPPINGS:
            raise ValueError(_WRAPPINGS[path.suffix])
        if not path.is_dir():
            regular_file(path)
        counts: Counter[tuple[str, str]] = Counter()
        with _reader(path) as reader:
            for connection in reader.connections:
                counts[connection.topic, connection.msgtype] += connection.msgcount
            return _bag(path, counts, (reader.start_time, reader.end_time - 1), partial(_read_indexed, path))


def _read_indexed(path: Path, chosen: Mapping[str, str], decode: bool) -> Iterator[Message]:
    with _refusing(path), _reader(path) as reader:
        connections = [one for one in reader.connections if chosen.get(one.topic) == one.msgtype]
        for connection, arrival, data in reader.messages(connections) if connections else ():
            content = reader.deserialize(data, connection.msgtype) if decode else None
            yield Message(connection.topic, arrival, content)


def _reader(path: Path) -> Any:
    """The reader of a file or folder; types are those of ROS 2 Humble where the bag states none."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    return AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))


def _streamed(path: Path) -> Bag:
    """The bag in an MCAP file without index, as a recorder leaves it whose battery went flat."""
    counts: Counter[tuple[str, str]] = Counter()
    first, last, end = 2**63, 0, 0
    with _refusing(path):
        size = regular_file(path).stat().st_size
        with path.open("rb") as file:
            file.seek(-min(size, len(_MCAP_END)), os.SEEK_END)
            is_complete = file.read() == _MCAP_END
        for schema, channel, message, place in _records(path):
            end = place
            counts[channel.topic, schema.name] += 1
            first, last = min(first, message.log_time), max(last, message.log_time)
        if not counts:
            raise ValueError("it has no whole message")
    note = (
        f"{path}: its end is missing, as after a power cut: {(last - first) / 1e9:.1f} s are read, "
        f"{(size - end) / 1e3:.0f} of {size / 1e3:.0f} kB are lost"
    )
    return _bag(path, counts, (first, last), partial(_read_streamed, path), *(() if is_complete else (note,)))


def _read_streamed(path: Path, chosen: Mapping[str, str], decode: bool) -> Iterator[Message]:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.EMPTY)
    with _refusing(path):
        for schema, channel, message, _ in _records(path):
            if chosen.get(channel.topic) != schema.name:
                continue
            if decode and schema.name not in types.fielddefs:
                types.register(get_types_from_msg(schema.data.decode(), schema.name))
            content = types.deserialize_cdr(message.data, schema.name) if decode else None
            yield Message(channel.topic, message.log_time, content)


def _records(path: Path) -> Iterator[tuple[Any, Any, Any, int]]:
    """Schema, channel, message and place in the file [bytes] of each message, as far as the file goes."""
    from mcap import records
    from mcap.exceptions import RecordLengthLimitExceeded
    from mcap.stream_reader import StreamReader

    schemas: dict[int, records.Schema] = {}
    channels: dict[int, records.Channel] = {}
    with _WholeReads(io.FileIO(path)) as file:
        try:
            for record in StreamReader(file, record_size_limit=path.stat().st_size).records:
                match record:
                    case records.Schema():
                        schemas[record.id] = record
                    case records.Channel():
                        channels[record.id] = record
                    case records.Message() if channels[record.channel_id].schema_id in schemas:
                        channel = channels[record.channel_id]
                        yield schemas[channel.schema_id], channel, record, file.tell()
        except (EOFError, RecordLengthLimitExceeded):
            return  # the last record is longer than the file


class _WholeReads(io.BufferedReader):
    """A file whose reads are complete, or raise EOFError: its last record may be cut off."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Exactly `size` bytes."""
        data = super().read(size)
        if size is not None and len(data) < size:
            raise EOFError
        return data
