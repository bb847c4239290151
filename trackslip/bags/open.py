"""ROS 1 and ROS 2 bags: topics and messages, read with rosbags."""

from __future__ import annotations

import importlib
import os
import shlex
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np

from trackslip.bags.size import (
    MCAP_MAGIC,
    METADATA,
    memory_per_byte,
    require_bag_fits,
    require_chunk_fits,
    require_definitions_fit,
    require_few_topics,
)
from trackslip.bags.stamps import Readings
from trackslip.errors import LogError, TrackslipError, first_line
from trackslip.files import reason, regular_file
from trackslip.inputs import note_listing
from trackslip.memory import require_fits

K = TypeVar("K", bound=Hashable)

_STORAGES: Final = (".bag", ".mcap", ".db3")
# suffixes of files that are compressed as a whole, or were not closed
_WRAPPINGS: Final = (".zstd", ".active")
_REPAIRS: Final = {
    ".bag": "rosbag reindex {file}",
    ".active": "rosbag reindex {file}",
    ".mcap": "mcap recover {file} -o NEW.mcap",
    ".db3": "sqlite3 {file} .recover | sqlite3 NEW.db3",
    ".zstd": "zstd -d {file}",
}
_END_OF_TIME: Final = 2**62  # times from which differences may not fit in 64 bits [ns]
_FOLDER_LEVELS: Final = 4  # number of folder levels that are searched for bags
_MAX_NAMES_SHOWN: Final = 12  # largest number of names in an error message
_BYTES_PER_NUMBER: Final = 24  # memory for a number that is kept, and for copies of it [bytes]
_BYTES_PER_LIST: Final = 1000  # memory for a topic or a pair of frames with its lists [bytes]


class Message(NamedTuple):
    """A message, decoded on request."""

    topic: str
    arrival: int
    """Time of recording [ns]."""
    content: Any
    """The message's fields as attributes, such as `content.header.stamp.sec`; None if not
    decoded.
    """

    @property
    def stamp(self) -> int:
        """The stamp in the message's header [ns]."""
        return _stamp(self.content.header)


def header_of(content: Any) -> Any:
    """A message's header, or None without one."""
    return getattr(content, "header", None)


def _stamp(header: Any) -> int:
    stamp = int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
    return _plausible(stamp, "a header stamp")


def _plausible(time: int, what: str) -> int:
    """Return a time [ns]; raises LogError if differences of such times don't fit in 64 bits."""
    if abs(time) >= _END_OF_TIME:
        raise LogError(f"{what} is {time} ns: must be below 2^62 ns, in the year 2116")
    return time


Read = Callable[[Collection[str], bool], Iterator[Message]]
"""Yields the messages of some topics in order of recording; the flag is true to decode their
content.
"""


@dataclass(frozen=True)
class Topic:
    """A topic in a bag."""

    name: str
    type: str  # name of the message type, such as `sensor_msgs/msg/JointState`
    count: int  # number of messages


@dataclass(frozen=True)
class Bag:
    """A recording in any supported format."""

    name: str
    path: Path  # the bag's file or, for ROS 2, its folder
    topics: dict[str, Topic]  # topics by name, in alphabetical order
    read: Read = field(repr=False)
    notes: tuple[str, ...] = ()  # missing parts of the recording, one line each
    max_memory: int | None = None  # limit on the memory for what is read [bytes], see require_fits

    def topic(self, name: str, kind: str | None = None) -> Topic:
        """Look up a topic by name; raises LogError if it doesn't exist or its messages are not of
        type `kind`.
        """
        bare = name.strip("/")
        topic = self.topics.get(name) or self.topics.get(f"/{bare}") or self.topics.get(bare)
        if topic is None:
            raise LogError(f"{self.path}: it has no topic {name!r}; its topics are {self.listed()}")
        if kind not in (None, topic.type):
            raise LogError(
                f"{self.path}: topic {topic.name} has messages of {topic.type}, needs {kind}"
            )
        return topic

    def only(self, names: Sequence[str], what: str, option: str) -> str:
        """The only name in `names`; raises LogError, which suggests `option`, if there are
        several.
        """
        if len(names) > 1:
            raise LogError(f"{self.path}: {what} may be {', '.join(names)}: choose with {option}")
        return names[0]

    def of_type(self, *types: str) -> list[Topic]:
        """Topics whose messages have any of the types, such as `sensor_msgs/msg/JointState`."""
        return [topic for topic in self.topics.values() if topic.type in types]

    def between(self, begin: int, end: int) -> Bag:
        """Limit the bag to static transforms and messages recorded from `begin` to before `end`
        [ns].
        """

        def read(chosen: Collection[str], decode: bool) -> Iterator[Message]:
            for message in self.read(chosen, decode):
                if begin <= message.arrival < end or message.topic.endswith("tf_static"):
                    yield message

        return replace(self, read=read)

    def messages(self, *topics: str) -> Iterator[Message]:
        """Yield decoded messages in order of recording; LogError for an unknown topic or a damaged
        bag.
        """
        return self.read([self.topic(name).name for name in topics], True)

    def readings(
        self,
        topics: Sequence[str],
        parts: Callable[[Any], Iterable[tuple[K, Any, Iterable[float]]]],
    ) -> dict[K, Readings]:
        """Collect numbers (N, k) by key; `parts` returns (key, header, numbers) for each part of a
        message; without a header, its time of recording is the stamp.

        Raises LogError if they don't fit into the memory.
        """
        times: dict[K, array[int]] = defaultdict(lambda: array("q"))
        numbers: dict[K, array[float]] = defaultdict(lambda: array("d"))
        kept = 0
        for message in self.messages(*topics):
            try:
                for key, header, values in parts(message.content):
                    known = len(numbers[key])
                    stamp = message.arrival if header is None else _stamp(header)
                    times[key].extend((stamp, message.arrival))
                    numbers[key].extend(values)
                    kept += 2 + len(numbers[key]) - known
            except LogError as error:
                raise LogError(f"topic {message.topic}: {error}") from error
            except (AttributeError, LookupError, TypeError, ValueError, OverflowError) as error:
                wrong = f"a message is not as its type defines it ({reason(error)})"
                raise LogError(f"topic {message.topic}: {wrong}") from error
            require_fits(
                self.path, _BYTES_PER_NUMBER * kept + _BYTES_PER_LIST * len(times), self.max_memory
            )
        found = {}
        for key in times:
            stamps, arrivals = np.array(times[key], np.int64).reshape(-1, 2).T
            values = np.array(numbers[key]).reshape(len(stamps), -1)
            found[key] = Readings(" and ".join(topics), stamps, arrivals, values)
        return found

    def table(self, topic: str, row: Callable[[Any], Sequence[float]]) -> Readings:
        """Collect the numbers (N, k) that `row` returns for a topic's messages; raises LogError
        without messages.
        """
        found = self.readings([topic], lambda content: [(topic, content.header, row(content))])
        if not found:
            raise LogError(f"topic {topic}: no messages")
        return found[topic]

    def stamps(self, topic: str) -> Readings:
        """The stamps of a topic's messages, without numbers."""
        found = self.readings([topic], lambda content: [(topic, header_of(content), ())])
        if not found:
            raise LogError(f"topic {topic}: no messages")
        return found[topic]

    def first(self, topic: str, most: int) -> list[Message]:
        """The first messages of a topic, at most `most`."""
        return list(islice(self.messages(topic), most))

    def arrivals(self) -> dict[str, np.ndarray]:
        """Ascending times of recording (n,) [ns] of each topic's messages; reads the whole bag."""
        times = {name: array("q") for name in self.topics}
        for number, message in enumerate(self.read(self.topics, False)):
            require_fits(self.path, _BYTES_PER_NUMBER * number, self.max_memory)
            times[message.topic].append(message.arrival)
        return {name: np.sort(np.array(some, np.int64)) for name, some in times.items()}

    def listed(self) -> str:
        """The first topics and their types, as text for an error message."""
        return listed([f"{topic.name} ({topic.type})" for topic in self.topics.values()])


def listed(names: Sequence[str]) -> str:
    """The first few names, as text for an error message."""
    more = f", ... ({len(names)} of them)" if len(names) > _MAX_NAMES_SHOWN else ""
    return ", ".join(names[:_MAX_NAMES_SHOWN] or ["none"]) + more


def has_rosbags() -> bool:
    """True if rosbags and the other packages of the extra `ros` are installed."""
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


def open_bags(path: str | Path, max_memory: int | None = None) -> list[Bag]:
    """Open the bag in a file, or all bags in a folder: subfolders with a metadata.yaml, and single
    files elsewhere.

    Files are `.bag` for ROS 1, `.mcap` or `.db3` for ROS 2. An MCAP file whose end is missing is
    read as far as it goes, see `Bag.notes`. Unreadable bags in a folder are left out, with a note,
    if another bag can be read.

    Reading takes at most `max_memory` [bytes], by default half of the machine's memory, whatever
    a bag unpacks to.

    Raises:
        LogError: if there is no bag, or no bag can be read: the message names a command that may
            repair the file.
        TrackslipError: if rosbags is not installed.
    """
    require_rosbags()
    path = Path(path)
    try:
        if not path.exists():
            raise LogError(f"{path}: no such file or folder")
        places = bags_in(path)
    except OSError as error:
        raise LogError(f"path = {str(path)[:80]!r}: {error.strerror}") from error
    if not places:
        raise LogError(
            f"{path}: holds no bag (.bag, .mcap or .db3)" if path.is_dir() else f"{path}: is no bag"
        )
    bags, notes = [], []
    for place in places:
        try:
            bags.append(_open(place, max_memory))
        except LogError as error:
            notes.append(str(error))
    if not bags:
        raise LogError(notes[-1])
    return [replace(bags[0], notes=(*bags[0].notes, *notes)), *bags[1:]]


def bags_in(path: Path) -> list[Path]:
    """Paths of the bags in a folder (subfolders with metadata, or single files), or the path of a
    single bag file.
    """
    if not path.is_dir():
        return [path] if _is_bag_file(path) else []
    patterns = ("/".join("*" * depth) for depth in range(1, _FOLDER_LEVELS + 1))
    entries = (entry for pattern in patterns for entry in sorted(path.glob(pattern)))
    files = [entry for entry in entries if _is_bag_file(entry) and entry.is_file()]
    bags = dict.fromkeys(
        file.parent if (file.parent / METADATA).is_file() else file for file in files
    )
    note_listing(path, bags)
    return list(bags)


def _is_bag_file(path: Path) -> bool:
    suffixes = [suffix for suffix in path.suffixes if suffix not in _WRAPPINGS]
    return bool(suffixes) and suffixes[-1] in _STORAGES


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Turn exceptions from readers into a one-line LogError with a command that may repair the
    file.
    """
    try:
        yield
    except LogError:
        raise
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or first_line(error)}") from error
    except UnicodeEncodeError as error:  # readers pass paths on as UTF-8
        raise LogError(f"{path}: its path must be text in UTF-8: rename it") from error
    except Exception as error:  # for damaged files, readers raise exceptions of any type
        reason = first_line(error).rstrip(".")
        repair = _REPAIRS.get(path.suffix, "ros2 bag reindex {file}").format(
            file=shlex.quote(str(path))
        )
        raise LogError(f"{path}: can't be read ({reason}); this may repair it: {repair}") from error


def _open(path: Path, max_memory: int | None) -> Bag:
    try:
        return _indexed(path, max_memory)
    except LogError:
        if path.suffix != ".mcap":
            raise
        return _streamed(path, max_memory)


def _bag(
    path: Path,
    topics: Iterable[Topic],
    read: Read,
    notes: tuple[str, ...],
    max_memory: int | None,
) -> Bag:
    """Make a bag with all topics that have messages; raises LogError if there are none."""
    by_name = {
        topic.name: topic for topic in sorted(topics, key=lambda topic: topic.name) if topic.count
    }
    if not by_name:
        raise LogError(f"{path}: it has no messages")
    name = path.resolve().name
    if path.is_file():
        for suffix in _STORAGES:
            name = name.removesuffix(suffix)
    return Bag(name, path, by_name, read, notes, max_memory)


def _indexed(path: Path, max_memory: int | None) -> Bag:
    with _refusing(path):
        require_bag_fits(path, max_memory)
        reader = _reader(path)
        for storage in reader.readers:
            with storage:
                require_few_topics(path, len(storage.connections))
                require_definitions_fit(
                    path, [str(each.msgdef.data) for each in storage.connections]
                )
        with reader:
            topics = [
                Topic(name, topic.msgtype, topic.msgcount)
                for name, topic in reader.topics.items()
                if topic.msgtype is not None  # None if messages have several types
            ]
        read = partial(_read_indexed, path, max_memory)
        return _bag(path, topics, read, (), max_memory)


def _read_indexed(
    path: Path, max_memory: int | None, chosen: Collection[str], decode: bool
) -> Iterator[Message]:
    with _refusing(path), _reader(path) as reader:
        connections = [each for each in reader.connections if each.topic in chosen]
        if decode:
            types = reader.typestore.fielddefs
            kinds = {connection.msgtype for connection in connections}
            factors = {kind: memory_per_byte(path, types, kind) for kind in kinds}
        for connection, arrival, data in reader.messages(connections) if connections else ():
            content = None
            if decode:
                require_fits(path, factors[connection.msgtype] * len(data), max_memory)
                content = reader.deserialize(data, connection.msgtype)
            yield _message(connection.topic, arrival, content)


def _message(topic: str, arrival: int, content: Any) -> Message:
    return Message(topic, _plausible(arrival, f"topic {topic}: a time of recording"), content)


def _reader(path: Path) -> Any:
    """A reader for a file or folder; uses the message types of ROS 2 Humble if the bag doesn't
    define its own.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    return AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))


def _streamed(path: Path, max_memory: int | None) -> Bag:
    """Open the bag in an MCAP file without an index, such as from a recorder with a flat
    battery.
    """
    counts: Counter[tuple[str, str]] = Counter()
    with _refusing(path):
        size = regular_file(path).stat().st_size
        with path.open("rb") as file:
            file.seek(-min(size, len(MCAP_MAGIC)), os.SEEK_END)
            is_complete = file.read() == MCAP_MAGIC
        for schema, channel, _ in _records(path, max_memory):
            counts[channel.topic, schema.name] += 1
            require_few_topics(path, len(counts))
        if not counts:
            raise ValueError("it has no whole message")
    topics = [Topic(name, kind, count) for (name, kind), count in counts.items()]
    notes = (
        ()
        if is_complete
        else (f"{path}: its end is missing, as after a power cut: read as far as it goes",)
    )
    return _bag(path, topics, partial(_read_streamed, path, max_memory), notes, max_memory)


def _read_streamed(
    path: Path, max_memory: int | None, chosen: Collection[str], decode: bool
) -> Iterator[Message]:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.EMPTY)
    factors: dict[str, int] = {}
    with _refusing(path):
        for schema, channel, message in _records(path, max_memory):
            if channel.topic not in chosen:
                continue
            content = None
            if decode:
                if schema.name not in types.fielddefs:
                    require_definitions_fit(path, [schema.data.decode()])
                    types.register(get_types_from_msg(schema.data.decode(), schema.name))
                    factors[schema.name] = memory_per_byte(path, types.fielddefs, schema.name)
                require_fits(path, factors[schema.name] * len(message.data), max_memory)
                content = types.deserialize_cdr(message.data, schema.name)
            yield _message(channel.topic, message.log_time, content)


def _records(path: Path, max_memory: int | None) -> Iterator[tuple[Any, Any, Any]]:
    """Yield schema, channel and message of each complete record in an MCAP file."""
    from mcap import records
    from mcap.exceptions import RecordLengthLimitExceeded
    from mcap.stream_reader import StreamReader, breakup_chunk

    size = path.stat().st_size
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    with path.open("rb") as file:
        reader = StreamReader(file, emit_chunks=True, record_size_limit=size)
        try:
            for record in reader.records:
                parts = [record]
                if isinstance(record, records.Chunk):
                    require_chunk_fits(path, record.data, record.compression, max_memory)
                    parts = breakup_chunk(record)
                for part in parts:
                    if isinstance(part, records.Schema):
                        schemas[part.id] = part
                    elif isinstance(part, records.Channel):
                        channels[part.id] = part
                    elif isinstance(part, records.Message):
                        if file.tell() == size:
                            return  # the record that ends with the file may be cut off
                        channel = channels[part.channel_id]
                        if channel.schema_id in schemas:
                            yield schemas[channel.schema_id], channel, part
        except RecordLengthLimitExceeded:
            return  # the last record is longer than the file
        except LogError:
            raise
        except Exception:  # a record that is cut off may raise exceptions of any type
            if file.tell() < size:
                raise
