"""Reading ROS 1 bags from front to back: unindexed ones, with damaged chunks or without their end, too.

Of the index at the end of a file only the connections are used, so that `.bag.active` files read like any other. The
format is that of http://wiki.ros.org/Bags/Format/2.0
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from trackslip.errors import LogError
from trackslip.ros.compression import decompressed, opened
from trackslip.ros.record import Channel, Record, Wanted, ros2_type

_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _CHUNK, _CHUNK_INFO, _CONNECTION = (bytes([kind]) for kind in (2, 3, 5, 6, 7))
_LENGTH = struct.Struct("<I")
_TIME = struct.Struct("<II")
_CUT = "its end is missing: the recording was cut off, or the file is damaged"
_DAMAGED = (struct.error, UnicodeDecodeError, KeyError)

_Fields = dict[bytes, bytes]


def read_rosbag1(path: Path, wanted: Wanted, notes: list[str]) -> Iterator[Record]:
    """All messages that can be read, in the file's order; `notes` gets a line for each damage."""
    with opened(path, notes) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        if file.read(len(_MAGIC)) != _MAGIC:
            raise LogError("is no ROS 1 bag of version 2.0")
        reader = _Reader(wanted, notes)
        reader.look_ahead(file, size)
        file.seek(len(_MAGIC))
        yield from reader.file(file, size)


class _Reader:
    """A file's connections met so far."""

    def __init__(self, wanted: Wanted, notes: list[str]) -> None:
        self._wanted, self._notes = wanted, notes
        self._channels: dict[bytes, tuple[Channel, bool]] = {}  # and whether its messages are wanted

    def look_ahead(self, file: BinaryIO, size: int) -> None:
        """Read the connections in the index, in case that their first mention is damaged."""
        try:
            fields, _ = _record(file, size)
            (index,) = struct.unpack("<Q", fields[b"index_pos"])
            if len(_MAGIC) < index < size:
                file.seek(index)
                for _ in self._records(file.read()):
                    pass
        except _DAMAGED:
            return

    def file(self, file: BinaryIO, size: int) -> Iterator[Record]:
        """The messages of a file of `size` bytes."""
        indexed = False
        try:
            while file.tell() < size:
                fields, length = _record(file, size)
                kind = fields[b"op"]
                indexed |= kind == _CHUNK_INFO
                if kind == _CHUNK:
                    compression = fields[b"compression"].decode()
                    yield from self._chunk(file.read(min(length, size)), compression)
                elif kind == _CONNECTION:
                    self._define(fields, file.read(min(length, size)))
                else:
                    file.seek(length, os.SEEK_CUR)
        except _DAMAGED:
            indexed = False
        if not indexed:
            self._notes.append(_CUT)

    def _chunk(self, content: bytes, compression: str) -> Iterator[Record]:
        """The messages of a chunk, as far as it is undamaged."""
        try:
            records = decompressed(content, compression, self._notes)
        except LogError as error:
            self._notes.append(f"a chunk can't be read ({error})")
            return
        yield from self._records(records)

    def _records(self, records: bytes) -> Iterator[Record]:
        """The messages in a sequence of records."""
        place = 0
        try:
            while place + _LENGTH.size <= len(records):
                head = place + _LENGTH.size
                body = head + _LENGTH.unpack_from(records, place)[0]
                if body + _LENGTH.size > len(records):
                    return
                fields = _fields(records[head:body])
                start = body + _LENGTH.size
                place = start + _LENGTH.unpack_from(records, body)[0]
                if place > len(records):
                    return
                kind = fields[b"op"]
                if kind == _MESSAGE and fields[b"conn"] in self._channels:
                    channel, wanted = self._channels[fields[b"conn"]]
                    seconds, nanoseconds = _TIME.unpack(fields[b"time"])
                    arrival = seconds * 1_000_000_000 + nanoseconds
                    yield Record(channel, arrival, records[start:place] if wanted else b"")
                elif kind == _CONNECTION:
                    self._define(fields, records[start:place])
        except _DAMAGED:
            self._notes.append("a chunk is damaged")

    def _define(self, fields: _Fields, content: bytes) -> None:
        """Remember a connection."""
        topic = fields[b"topic"].decode()
        name = ros2_type(_fields(content)[b"type"].decode())
        self._channels[fields[b"conn"]] = Channel(topic, name, "ros1"), self._wanted(topic)


def _record(file: BinaryIO, size: int) -> tuple[_Fields, int]:
    """The header of the next record, and the length of its data; struct.error if it is damaged."""
    (length,) = _LENGTH.unpack(file.read(_LENGTH.size))
    fields = _fields(file.read(min(length, size)))
    return fields, _LENGTH.unpack(file.read(_LENGTH.size))[0]


def _fields(header: bytes) -> _Fields:
    """The fields of a header; struct.error if it is damaged."""
    fields, place = {}, 0
    while place < len(header):
        (length,) = _LENGTH.unpack_from(header, place)
        place += _LENGTH.size + length
        name, equals, value = header[place - length : place].partition(b"=")
        if not equals or place > len(header):
            raise struct.error("a field is damaged")
        fields[name] = value
    return fields
