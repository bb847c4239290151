"""The messages in a file of a bag, as bytes: ROS 1 bags, MCAP and SQLite, told apart by their first bytes.

Each is read from front to back, so that recordings without index, with damaged chunks or without their end are read as
far as they go. Of the index at the end only the list of topics is used. Formats: http://wiki.ros.org/Bags/Format/2.0,
https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import os
import sqlite3
import struct
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from pathlib import Path
from typing import BinaryIO, NamedTuple
from zlib import crc32

from trackslip.errors import LogError, first_line
from trackslip.files import regular_file
from trackslip.ros.compression import Allowance, TooLargeError, decompressed, uncompressed

_ROS1_MAGIC, _MCAP_MAGIC, _SQLITE_MAGIC = b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"
_CUT = "its end is missing: the recording was cut off, or the file is damaged"
_LATEST = 2**63 - 1  # time that signed integers hold [ns]
_DAMAGED = (struct.error, UnicodeDecodeError, KeyError, EOFError)


class Channel(NamedTuple):
    """Source of messages of one type."""

    topic: str
    type: str
    """Name of the message type, as in `sensor_msgs/msg/JointState`."""
    encoding: str
    """Serialisation of its messages: cdr (ROS 2), ros1, or another that the file names."""


class Record(NamedTuple):
    """A message as stored."""

    channel: Channel
    arrival: int
    """Time of recording [ns]."""
    data: bytes
    """The serialised message; empty if its topic isn't wanted."""


Wanted = Callable[[Channel], bool]
"""Tells the channels whose messages are read; those of others are counted, at next to no cost."""


def read_file(path: Path, wanted: Wanted, notes: list[str], max_expanded: float | None = None) -> Iterator[Record]:
    """All messages of a file that can be read, in the file's order; `notes` gets a line for each damage.

    Raises LogError, naming the file, if it is no bag, or expands to more than `max_expanded` [MB].
    """
    try:
        allowance = Allowance(regular_file(path), max_expanded)
        with uncompressed(path, notes, allowance) as plain, plain.open("rb") as file:
            magic, size = file.read(16), file.seek(0, os.SEEK_END)
            if magic.startswith(_ROS1_MAGIC):
                yield from _Ros1(wanted, notes, allowance).read(file, size)
            elif magic.startswith(_MCAP_MAGIC):
                yield from _Mcap(wanted, notes, allowance).read(file, size)
            elif magic == _SQLITE_MAGIC:
                yield from _read_sqlite(plain, wanted, notes)
            else:
                raise LogError("is no bag of ROS 1 (version 2.0) or ROS 2 (MCAP or SQLite)")
    except LogError as error:
        raise LogError(f"{path}: {error}") from error
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or first_line(error)}") from error


class _Chunks:
    """A file whose messages lie in chunks, and the channels met so far."""

    magic: bytes

    def __init__(self, wanted: Wanted, notes: list[str], allowance: Allowance) -> None:
        self._wanted, self._notes, self._allowance = wanted, notes, allowance
        self._channels: dict[int | bytes, tuple[Channel, bool]] = {}  # and whether its messages are wanted

    def read(self, file: BinaryIO, size: int) -> Iterator[Record]:
        """The messages of a file of `size` bytes."""
        start = self._index(file, size)
        if len(self.magic) < start < size:  # its channels, in case their first mention is damaged
            file.seek(start)
            index = file.read()
            for _ in self._records(io.BytesIO(index), len(index)):
                pass
        file.seek(len(self.magic))
        complete = yield from self._records(file, size, is_file=True)
        if not complete:
            self._notes.append(_CUT)

    def _index(self, file: BinaryIO, size: int) -> int:
        """Offset of the index at the end; 0 if unknown."""
        raise NotImplementedError

    def _records(self, stream: BinaryIO, size: int, is_file: bool = False) -> Generator[Record, None, bool]:
        """The messages in a file or chunk of `size` bytes; returns whether it is complete."""
        raise NotImplementedError

    def _chunk(self, content: bytes, compression: str, size: int, checksum: int = 0) -> Iterator[Record]:
        """The messages of a chunk as far as it is undamaged; decompressed, it should have the size and checksum."""
        try:
            records = decompressed(content, compression, self._notes, self._allowance, size)
        except TooLargeError:
            raise
        except LogError as error:
            self._notes.append(f"a chunk can't be read ({error})")
            return
        if checksum and len(records) == size and crc32(records) != checksum:
            self._notes.append("a chunk has a wrong checksum: some of its messages may be damaged")
        yield from self._records(io.BytesIO(records), len(records))

    def _add(self, key: int | bytes, channel: Channel) -> None:
        self._channels[key] = channel, self._wanted(channel)

    def _message(self, key: int | bytes, arrival: int, content: bytes, start: int = 0) -> Record:
        """The message from `start` on, of a known channel."""
        channel, wanted = self._channels[key]
        return Record(channel, arrival, content[start:] if wanted else b"")


class _Mcap(_Chunks):
    magic = _MCAP_MAGIC
    _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
    _FRAME = struct.Struct("<BQ")  # kind of a record, length of its content
    _MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence number, times of logging and publishing [ns]
    _CHUNK_HEAD = struct.Struct("<QQQI")  # times of the first and last message [ns], decompressed size, checksum
    _TAIL = struct.Struct("<BQQQI8s")  # the footer with its frame: start of the summary, ..., and the magic at the end

    def __init__(self, wanted: Wanted, notes: list[str], allowance: Allowance) -> None:
        super().__init__(wanted, notes, allowance)
        self._types: dict[int, str] = {}

    def _index(self, file: BinaryIO, size: int) -> int:
        file.seek(max(size - self._TAIL.size, 0))
        tail = file.read()
        return self._TAIL.unpack(tail)[2] if len(tail) == self._TAIL.size and tail.endswith(self.magic) else 0

    def _records(self, stream: BinaryIO, size: int, is_file: bool = False) -> Generator[Record, None, bool]:
        while len(frame := stream.read(self._FRAME.size)) == self._FRAME.size:
            kind, length = self._FRAME.unpack(frame)
            if is_file and kind in (self._FOOTER, self._DATA_END):
                return True
            if not length:  # no record is empty: zeros of a damaged file, or of a small one that expands
                return False
            length = min(length, size)
            if kind == self._MESSAGE:
                content = stream.read(length)
                if len(content) == length >= self._MESSAGE_HEAD.size:
                    number, _, arrival, _ = self._MESSAGE_HEAD.unpack_from(content)
                    if number in self._channels:
                        yield self._message(number, min(arrival, _LATEST), content, self._MESSAGE_HEAD.size)
            elif kind in (self._SCHEMA, self._CHANNEL):
                content = stream.read(length)
                if len(content) == length:
                    self._define(kind, content)
            elif is_file and kind == self._CHUNK:
                chunk = io.BytesIO(stream.read(length))
                try:
                    *_, unpacked, checksum = self._CHUNK_HEAD.unpack(chunk.read(self._CHUNK_HEAD.size))
                    compression = _sized(chunk, length).decode()
                except _DAMAGED as error:
                    self._notes.append(f"a chunk can't be read ({error})")
                    continue
                chunk.seek(8, os.SEEK_CUR)  # the length of what follows
                yield from self._chunk(chunk.read(), compression, unpacked, checksum)
            else:
                stream.seek(length, os.SEEK_CUR)
        return False

    def _define(self, kind: int, content: bytes) -> None:
        """Remember a schema or a channel."""
        stream = io.BytesIO(content)
        try:
            (number,) = struct.unpack("<H", stream.read(2))
            if kind == self._SCHEMA:
                self._types[number] = _ros2_type(_sized(stream, len(content)).decode())
                return
            (schema,) = struct.unpack("<H", stream.read(2))
            topic, encoding = (_sized(stream, len(content)).decode() for _ in range(2))
            self._add(number, Channel(topic, self._types.get(schema, ""), encoding))
        except _DAMAGED:
            self._notes.append("the description of a topic is damaged")


class _Ros1(_Chunks):
    magic = _ROS1_MAGIC
    _MESSAGE, _CHUNK, _CONNECTION = (bytes([kind]) for kind in (2, 5, 7))

    def _index(self, file: BinaryIO, size: int) -> int:
        file.seek(len(self.magic))
        try:
            fields = _fields(_sized(file, size))
            index = int(struct.unpack("<Q", fields[b"index_pos"])[0])
        except _DAMAGED:
            index = 0
        self._closed = 0 < index <= size
        return index

    def _records(self, stream: BinaryIO, size: int, is_file: bool = False) -> Generator[Record, None, bool]:
        try:
            while stream.tell() < size:
                fields = _fields(_sized(stream, size))
                kind = fields[b"op"]
                if is_file and kind == self._CHUNK:
                    compression = fields[b"compression"].decode()
                    (unpacked,) = struct.unpack("<I", fields[b"size"])
                    yield from self._chunk(_sized(stream, size, partly=True), compression, unpacked)
                    continue
                content = _sized(stream, size)
                if kind == self._CONNECTION:
                    name = _ros2_type(_fields(content)[b"type"].decode())
                    self._add(fields[b"conn"], Channel(fields[b"topic"].decode(), name, "ros1"))
                elif kind == self._MESSAGE and not is_file and fields[b"conn"] in self._channels:
                    seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
                    yield self._message(fields[b"conn"], seconds * 1_000_000_000 + nanoseconds, content)
        except EOFError:
            return False
        except _DAMAGED:
            if not is_file:
                self._notes.append("a chunk is damaged")
            return False
        return not is_file or self._closed


def _read_sqlite(path: Path, wanted: Wanted, notes: list[str]) -> Iterator[Record]:
    uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(uri, uri=True)) as database:
        database.execute("PRAGMA writable_schema = ON")  # without it, SQLite refuses files that were cut off
        database.text_factory = lambda text: text.decode(errors="replace")
        try:
            topics = database.execute("SELECT id, name, type, serialization_format FROM topics")
            channels = {number: Channel(topic, _ros2_type(name), how) for number, topic, name, how in topics}
        except (sqlite3.Error, AttributeError) as error:
            raise LogError(f"is no ROS 2 bag, or damaged ({first_line(error)})") from error
        read = {number: wanted(channel) for number, channel in channels.items()}
        some = ", ".join(str(int(number)) for number, chosen in read.items() if chosen) or "NULL"
        # by rowid, whose table is what a cut end leaves longest
        rows = f"SELECT topic_id, timestamp, CASE WHEN topic_id IN ({some}) THEN data END FROM messages NOT INDEXED"
        try:
            for number, arrival, data in database.execute(rows):
                if number in channels and isinstance(arrival, int):
                    yield Record(channels[number], arrival, data if isinstance(data, bytes) else b"")
        except sqlite3.Error as error:
            notes.append(f"its end is missing, or it is damaged ({first_line(error)})")


def _ros2_type(name: str) -> str:
    """`package/msg/Type` for a ROS 1 or ROS 2 name of a message type."""
    package, _, last = name.partition("/")
    return f"{package}/msg/{last}" if last and "/" not in last else name


def _sized(stream: BinaryIO, most: int, partly: bool = False) -> bytes:
    """The next bytes, which begin with their length; EOFError if they are cut off, unless `partly` will do."""
    head = stream.read(4)
    length = int.from_bytes(head, "little")
    content = stream.read(min(length, most))
    if len(head) < 4 or (len(content) < length and not partly):
        raise EOFError("cut off")
    return content


def _fields(header: bytes) -> dict[bytes, bytes]:
    """The fields of a ROS 1 header; struct.error if it is damaged."""
    fields, place = {}, 0
    while place < len(header):
        end = place + 4 + int.from_bytes(header[place : place + 4], "little")
        name, equals, value = header[place + 4 : end].partition(b"=")
        if not equals or end > len(header):
            raise struct.error("a field is damaged")
        fields[name], place = value, end
    return fields


def short_type(name: str) -> str:
    """The name of a message type as people write it, `package/Type`."""
    return name.replace("/msg/", "/")
