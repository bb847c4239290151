"""Reading MCAP files from front to back: without summary, with damaged chunks or without their end, too.

Of the summary at the end of a file only the list of channels is used, so that a recording that was cut off reads like
any other. The format is that of https://mcap.dev/spec.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

from trackslip.errors import LogError
from trackslip.ros.compression import decompressed, opened
from trackslip.ros.record import Channel, Record, Wanted, ros2_type

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_FRAME = struct.Struct("<BQ")  # kind of a record, length of its content
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence number, times of logging and publishing [ns]
_CHUNK_HEAD = struct.Struct("<QQQI")  # times of the first and last message [ns], decompressed size, checksum
_TAIL = struct.Struct("<BQQQI8s")  # the footer with its frame: place of the summary, ..., and the magic at the end
_LATEST = 2**63 - 1  # time that signed integers hold [ns]
_CUT = "its end is missing: the recording was cut off, or the file is damaged"


def read_mcap(path: Path, wanted: Wanted, notes: list[str]) -> Iterator[Record]:
    """All messages that can be read, in the file's order; `notes` gets a line for each damage."""
    with opened(path, notes) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        if file.read(len(_MAGIC)) != _MAGIC:
            raise LogError("is no MCAP file")
        reader = _Reader(wanted, notes)
        reader.look_ahead(file, size)
        file.seek(len(_MAGIC))
        complete = yield from reader.file(file, size)
        if not complete:
            notes.append(_CUT)


class _Reader:
    """A file's schemas and channels met so far."""

    def __init__(self, wanted: Wanted, notes: list[str]) -> None:
        self._wanted, self._notes = wanted, notes
        self._types: dict[int, str] = {}
        self._channels: dict[int, tuple[Channel, bool]] = {}  # and whether its messages are wanted

    def look_ahead(self, file: BinaryIO, size: int) -> None:
        """Read the channels in the summary, in case that their first mention is damaged."""
        file.seek(max(size - _TAIL.size, 0))
        tail = file.read()
        if len(tail) == _TAIL.size and tail.endswith(_MAGIC):
            start = _TAIL.unpack(tail)[2]
            if len(_MAGIC) < start < size:
                file.seek(start)
                for _ in self._records(file.read()):
                    pass

    def file(self, file: BinaryIO, size: int) -> Generator[Record, None, bool]:
        """The messages of a file of `size` bytes; returns whether its data is complete."""
        while len(frame := file.read(_FRAME.size)) == _FRAME.size:
            kind, length = _FRAME.unpack(frame)
            if kind in (_FOOTER, _DATA_END):
                return True
            length = min(length, size)
            if kind == _CHUNK:
                yield from self._chunk(file.read(length), length)
            elif kind == _MESSAGE or kind in (_SCHEMA, _CHANNEL):
                yield from self._records(frame + file.read(length))
            else:
                file.seek(length, os.SEEK_CUR)
        return False

    def _chunk(self, content: bytes, length: int) -> Iterator[Record]:
        """The messages of a chunk, as far as it is undamaged."""
        try:
            *_, size, checksum = _CHUNK_HEAD.unpack_from(content)
            compression, start = _string(content, _CHUNK_HEAD.size)
            records = decompressed(content[start + 8 :], compression, self._notes)
        except (struct.error, UnicodeDecodeError, LogError) as error:
            self._notes.append(f"a chunk can't be read ({error})")
            return
        if checksum and len(records) == size and len(content) == length and crc32(records) != checksum:
            self._notes.append("a chunk has a wrong checksum: some of its messages may be damaged")
        yield from self._records(records)

    def _records(self, records: bytes) -> Iterator[Record]:
        """The messages in a sequence of records."""
        place, end = 0, len(records)
        while place + _FRAME.size <= end:
            kind, length = _FRAME.unpack_from(records, place)
            place += _FRAME.size
            stop = place + length
            if stop > end:
                return
            if kind == _MESSAGE and length >= _MESSAGE_HEAD.size:
                number, _, arrival, _ = _MESSAGE_HEAD.unpack_from(records, place)
                if number in self._channels:
                    channel, wanted = self._channels[number]
                    arrival = min(arrival, _LATEST)
                    yield Record(channel, arrival, records[place + _MESSAGE_HEAD.size : stop] if wanted else b"")
            elif kind in (_SCHEMA, _CHANNEL):
                try:
                    self._define(kind, records[place:stop])
                except (struct.error, UnicodeDecodeError):
                    self._notes.append("the description of a topic is damaged")
            place = stop

    def _define(self, kind: int, content: bytes) -> None:
        """Remember a schema or a channel."""
        (number,) = struct.unpack_from("<H", content)
        if kind == _SCHEMA:
            self._types[number] = ros2_type(_string(content, 2)[0])
            return
        (schema,) = struct.unpack_from("<H", content, 2)
        topic, place = _string(content, 4)
        encoding, _ = _string(content, place)
        self._channels[number] = Channel(topic, self._types.get(schema, ""), encoding), self._wanted(topic)


def _string(content: bytes, place: int) -> tuple[str, int]:
    """The text that begins at `place` with its length, and the place behind it."""
    (length,) = struct.unpack_from("<I", content, place)
    end = place + 4 + length
    if end > len(content):
        raise struct.error("cut off")
    return content[place + 4 : end].decode(), end
