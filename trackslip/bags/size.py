"""What a bag unpacks to, counted in small pieces before rosbags unpacks it: files, chunks and
messages that are compressed, lists of chunks that repeat them, and definitions of messages.

Nothing that a bag says of its own sizes is believed.
"""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
import struct
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path, PurePath
from typing import Any, BinaryIO, Final, NamedTuple

from trackslip.errors import LogError
from trackslip.files import read_text, reason, regular_file
from trackslip.memory import (
    Decompressor,
    half_of_memory,
    require_fits,
    size_text,
    unpacked,
    unpacked_size,
)

Types = Mapping[str, Any]
"""Constants and fields by the name of the message type, as rosbags has them."""
METADATA: Final = "metadata.yaml"
"""Name of the file that describes a ROS 2 bag in a folder."""
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
_ROS1_MAGIC: Final = b"#ROSBAG V2.0\n"

# Upper bounds on memory. A chunk of 1e6 empty messages took 6 (indexed) and 12 bytes per byte, a
# list of 2e6 messages with a bool 116 bytes per message.
_CHUNK: Final = 16  # the messages of a chunk [bytes per unpacked byte]
_PART: Final = 150  # a message in a decoded message [bytes]
_INDEX: Final = 20  # entries of a bag's index [bytes per byte of the index]

_MOST_YAML: Final = 2_000_000  # longest text about topics, which takes minutes to parse [bytes]
_ALIAS: Final = re.compile(rb"(?:^|(?<=[\s\[\]{},:?-]))\*[^\s*,\]}]+")  # of YAML
_MOST_TOPICS: Final = 10_000  # most topics, counted once for each publisher
_MOST_CHARACTERS: Final = 5_000_000  # most characters in definitions of messages
_MOST_LINES: Final = 50_000  # most lines in definitions that differ
_MOST_ELEMENTS: Final = 5_000  # most texts or messages in all arrays of fixed length
_MOST_PARTS: Final = 100_000  # most parts of a message whose arrays all have a fixed length

_PIECE: Final = 1_000_000  # size of the pieces in which files are read [bytes]
# kinds of records in MCAP files
_CHANNEL: Final = 0x04
_CHUNK_RECORD: Final = 0x06
_CHUNK_INDEX: Final = 0x08
_SUMMARY_END: Final = (0x02, 0x0E)  # kinds of records that follow the summary
_FOOTER: Final = 37  # length of an MCAP file's end [bytes]


def require_bag_fits(path: Path, max_memory: int | None = None) -> None:
    """Raise LogError for a bag that doesn't fit into the memory, see `require_fits`.

    `path` is a `.bag`, `.mcap` or `.db3` file, or a folder with a metadata.yaml. May raise any
    other error for a damaged bag.
    """
    if path.is_dir():
        _require_folder_fits(path, max_memory)
    else:
        _require_file_fits(regular_file(path), path.suffix, path, max_memory)


def _require_file_fits(path: Path, suffix: str, name: Path, max_memory: int | None) -> None:
    """Raise LogError, which begins with `name`, for a file that doesn't fit into the memory."""
    require = {".bag": _require_ros1_fits, ".mcap": _require_mcap_fits, ".db3": _require_plain_db3}
    if suffix not in require:
        raise LogError(f"{name}: must end in {', '.join(require)}")
    require[suffix](path, name, max_memory)


def _require_folder_fits(folder: Path, max_memory: int | None) -> None:
    from ruamel.yaml import YAML  # which rosbags uses, too

    metadata = regular_file(folder / METADATA)
    text = read_text(metadata, _MOST_YAML)
    _require_plain_yaml(metadata, [text.encode()])
    try:
        about = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
        mode = str(about.get("compression_mode", "")).lower()
        files = [folder / PurePath(name).name for name in about["relative_file_paths"]]
    except (LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"{METADATA}: {reason(error)}") from error
    if len(set(files)) < len(files):
        raise LogError(f"{metadata}: lists a file several times")
    for file in filter(Path.exists, files):  # rosbags names those that are missing
        regular_file(file)
        if mode == "file":
            _require_packed_file_fits(file, max_memory)
        else:
            _require_file_fits(file, file.suffix, file, max_memory)
        if mode == "message":
            _require_messages_fit(file, max_memory)


def _require_plain_yaml(source: object, texts: Iterable[bytes]) -> None:
    """Raise LogError for YAML that is too long, or has aliases, with which a few lines can stand
    for any number.
    """
    length = 0
    for text in texts:
        length += len(text)
        if length > _MOST_YAML:
            raise LogError(f"{source}: more than {_MOST_YAML} bytes about its topics")
        if alias := _ALIAS.search(text):
            name = alias[0].decode(errors="replace")
            raise LogError(f"{source}: YAML with an alias ({name}), which no recorder writes")


def _require_packed_file_fits(path: Path, max_memory: int | None) -> None:
    """Raise LogError for a compressed file that doesn't fit into the memory or on the disk, to
    which rosbags unpacks it while it reads.
    """
    limit = half_of_memory() if max_memory is None else max_memory
    with tempfile.TemporaryDirectory(prefix="trackslip-bag-") as folder:
        free = shutil.disk_usage(folder).free // 2  # this copy and that of rosbags
        size = 0
        with path.open("rb") as packed, Path(folder, path.stem).open("wb") as file:
            for piece in unpacked(_zstd(), _pieces(packed)):
                size += len(piece)
                require_fits(path, size, limit)
                if size > free:
                    raise LogError(
                        f"{path}: unpacks to more than the {size_text(free)} free in {folder}"
                    )
                file.write(piece)
        _require_file_fits(Path(file.name), Path(path.stem).suffix, path, max_memory)


def _require_messages_fit(path: Path, max_memory: int | None) -> None:
    """Raise LogError for a file with a compressed message that doesn't fit into the memory."""
    from rosbags.rosbag2 import Reader

    most = _most(max_memory)
    with Reader(path) as reader:
        for _, _, data in reader.messages():
            require_fits(path, unpacked_size(_zstd(), [bytes(data)], most), max_memory)


def _require_plain_db3(path: Path, name: Path, max_memory: int | None) -> None:
    """Raise LogError for a database whose rows are more than what is stored: computed tables and
    columns, or topics that repeat.
    """
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True)) as database:
        for table in ("messages", "topics", "message_definitions", "schema"):
            made = database.execute("SELECT sql FROM sqlite_master WHERE lower(name) = ?", [table])
            columns = database.execute(f"PRAGMA table_xinfo({table})").fetchall()
            plain = all(text.upper().startswith("CREATE TABLE") for (text,) in made)
            if not plain or any(hidden for *_, hidden in columns):
                raise LogError(f"{name}: its table {table} is computed, not stored")
        if not database.execute("PRAGMA table_info(topics)").fetchall():
            return  # rosbags names what is missing
        topics, different = database.execute(
            "SELECT count(*), count(DISTINCT id) FROM topics"
        ).fetchone()
        require_few_topics(name, topics)
        if different < topics:
            raise LogError(f"{name}: several of its topics have the same id")
        columns = [column for _, column, *_ in database.execute("PRAGMA table_info(topics)")]
        if "offered_qos_profiles" in columns:
            profiles = database.execute("SELECT CAST(offered_qos_profiles AS BLOB) FROM topics")
            _require_plain_yaml(name, (text or b"" for (text,) in profiles))


class _Chunk(NamedTuple):
    """A part of a bag that is unpacked at once."""

    first: int  # time of the first message [ns]
    last: int  # time of the last message [ns]
    compression: str
    position: int  # of the packed data in the file [bytes]
    packed: int  # size of the packed data [bytes]


def _chunk_size(file: BinaryIO, chunk: _Chunk, most: int) -> int:
    """Size of an unpacked chunk [bytes], or a larger number than `most` if it is larger."""
    if chunk.compression in ("", "none"):
        return chunk.packed
    file.seek(chunk.position)
    return unpacked_size(_decompressor(chunk.compression), _pieces(file, chunk.packed), most)


def require_chunk_fits(
    source: object, data: bytes, compression: str, max_memory: int | None
) -> None:
    """Raise LogError for a packed chunk that doesn't fit into the memory."""
    if compression:
        size = unpacked_size(_decompressor(compression), [data], _most(max_memory))
        require_fits(source, _CHUNK * size, max_memory)


def _most(max_memory: int | None) -> int:
    """Size above which a chunk can't be read [bytes]."""
    return (half_of_memory() if max_memory is None else max_memory) // _CHUNK


def _require_ros1_fits(path: Path, name: Path, max_memory: int | None) -> None:
    """Raise LogError for a ROS 1 bag with an index or a chunk that doesn't fit into the memory."""
    index = 0
    with path.open("rb") as file:
        for chunk, entries in _ros1_chunks(file):
            index += entries
            require_fits(name, _INDEX * index, max_memory)
            size = _chunk_size(file, chunk, _most(max_memory))
            require_fits(name, _CHUNK * size, max_memory)


def _ros1_chunks(file: BinaryIO) -> Iterator[tuple[_Chunk, int]]:
    """Yield each chunk in a ROS 1 bag's list of chunks, with the size of its index [bytes]."""
    from rosbags.rosbag1.reader import Header, RecordType, read_uint32

    first = file.readline(len(_ROS1_MAGIC))
    if first != _ROS1_MAGIC:
        raise ValueError(f"it begins with {first!r}, must begin with {_ROS1_MAGIC!r}")
    header = Header.read(file, RecordType.BAGHEADER)
    file.seek(header.get_uint64("index_pos"))
    for _ in range(header.get_uint32("conn_count")):
        Header.read(file, RecordType.CONNECTION)
        file.seek(read_uint32(file), os.SEEK_CUR)
    for _ in range(header.get_uint32("chunk_count")):
        about = Header.read(file, RecordType.CHUNK_INFO)
        file.seek(read_uint32(file), os.SEEK_CUR)
        after = file.tell()

        file.seek(about.get_uint64("chunk_pos"))
        compression = Header.read(file, RecordType.CHUNK).get_string("compression")
        packed = read_uint32(file)
        chunk = _Chunk(0, 0, compression, file.tell(), packed)
        file.seek(packed, os.SEEK_CUR)
        entries = 0
        for _ in range(about.get_uint32("count")):
            file.seek(read_uint32(file), os.SEEK_CUR)  # the header of a connection's index
            size = read_uint32(file)
            file.seek(size, os.SEEK_CUR)
            entries += size
        yield chunk, entries
        file.seek(after)


def _require_mcap_fits(path: Path, name: Path, max_memory: int | None) -> None:
    """Raise LogError for an MCAP file without a summary, or with chunks that don't fit into the
    memory: each alone, or, where their times in the index overlap, together.
    """
    sizes: dict[tuple[str, int, int], int] = {}
    most = _most(max_memory)
    with path.open("rb") as file:

        def size_of(chunk: _Chunk) -> int:
            key = chunk.compression, chunk.position, chunk.packed
            if key not in sizes:
                sizes[key] = _chunk_size(file, chunk, most)
                require_fits(name, _CHUNK * sizes[key], max_memory)
            return sizes[key]

        begin, end = _summary_of(file)
        if begin == end:
            raise LogError(f"{name}: it has no summary; this may write one: mcap recover")
        require_fits(name, _INDEX * (end - begin), max_memory)
        _require_plain_yaml(name, _mcap_channels(file, begin, end))
        for chunk in _mcap_chunks(file, len(MCAP_MAGIC), begin):
            size_of(chunk)
        indexed = [(chunk, size_of(chunk)) for chunk in _mcap_index(file, begin, end)]
    require_fits(name, _CHUNK * _most_at_once(indexed), max_memory)


def _summary_of(file: BinaryIO) -> tuple[int, int]:
    """Begin and end of the summary in an MCAP file [bytes], which are equal if it has none."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - _FOOTER))
    tail = file.read()
    (begin,) = struct.unpack_from("<Q", tail, 9) if len(tail) == _FOOTER else (0,)
    whole = tail.endswith(MCAP_MAGIC) and tail.startswith(b"\x02") and 0 < begin < size
    return (begin, size - _FOOTER) if whole else (size, size)


def _mcap_records(file: BinaryIO, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield the kind, the position and the length [bytes] of the records in a part of a file."""
    position = begin
    while position < end:
        file.seek(position)
        head = file.read(9)
        if len(head) < 9:
            return
        kind, length = struct.unpack("<BQ", head)
        position += 9
        if length > end - position:
            return  # cut off
        yield kind, position, length
        position += length


def _mcap_chunks(file: BinaryIO, begin: int, end: int) -> Iterator[_Chunk]:
    """Yield the chunks among the records."""
    for kind, position, length in _mcap_records(file, begin, end):
        if kind == _CHUNK_RECORD:
            file.seek(position)
            first, last, _, _, letters = struct.unpack("<QQQII", file.read(32))
            compression = file.read(min(letters, length)).decode()
            (packed,) = struct.unpack("<Q", file.read(8))
            yield _Chunk(first, last, compression, file.tell(), min(packed, length))


def _mcap_index(file: BinaryIO, begin: int, end: int) -> Iterator[_Chunk]:
    """Yield the chunks that a summary lists, where and as long as it states."""
    for kind, position, length in _mcap_records(file, begin, end):
        if kind in _SUMMARY_END:
            return
        if kind == _CHUNK_INDEX:
            file.seek(position)
            content = file.read(length)
            first, last, offset, _, entries = struct.unpack_from("<QQQQI", content)
            (letters,) = struct.unpack_from("<I", content, 36 + entries + 8)
            rest = 36 + entries + 8 + 4
            compression = content[rest : rest + letters].decode()
            (packed,) = struct.unpack_from("<Q", content, rest + letters)
            start = offset + 9 + 40 + len(compression)
            yield _Chunk(first, last, compression, start, packed)


def _mcap_channels(file: BinaryIO, begin: int, end: int) -> Iterator[bytes]:
    """Yield the descriptions of topics in a summary, with their YAML."""
    for kind, position, length in _mcap_records(file, begin, end):
        if kind in _SUMMARY_END:
            return
        if kind == _CHANNEL:
            file.seek(position)
            yield file.read(min(length, _MOST_YAML + 1))


def _most_at_once(chunks: Iterable[tuple[_Chunk, int]]) -> int:
    """Largest total size of chunks whose times overlap [bytes]; rosbags holds them at once."""
    changes = []
    for chunk, size in chunks:
        changes.append((chunk.first, 0, size))
        changes.append((chunk.last, 1, -size))  # after those that begin at that time
    at_once = most = 0
    for _, _, change in sorted(changes):
        at_once += change
        most = max(most, at_once)
    return most


def require_few_topics(source: object, topics: int) -> None:
    """Raise LogError for more topics than any robot has."""
    if topics > _MOST_TOPICS:
        raise LogError(f"{source}: has {topics} topics, must have at most {_MOST_TOPICS}")


def require_definitions_fit(source: object, texts: Sequence[str]) -> None:
    """Raise LogError for definitions of messages that take minutes to parse."""
    characters = sum(map(len, texts))
    lines = sum(text.count("\n") for text in set(texts))
    for count, what, most in (
        (characters, "characters", _MOST_CHARACTERS),
        (lines, "lines", _MOST_LINES),
    ):
        if count > most:
            raise LogError(
                f"{source}: {count} {what} of message definitions, must be at most {most}"
            )


def memory_per_byte(source: object, types: Types, name: str) -> int:
    """Most memory that a message of type `name` takes for each of its bytes when it is decoded.

    `types` are those in a typestore of rosbags. Raises LogError for long arrays of fixed length,
    whose elements rosbags writes out one by one, RecursionError for a type that contains itself.
    """
    counts: dict[str, int] = {}
    _count_parts(types, name, counts)
    fields = [field for inner in counts for field in _parts(types, inner)]
    elements = sum(field.length for field in fields if field.is_array)
    for count, what, most in (
        (elements, "texts or messages in arrays", _MOST_ELEMENTS),
        (counts[name], "texts or messages", _MOST_PARTS),
    ):
        if count > most:
            raise LogError(f"{source}: type {name} has {count} {what}, must be at most {most}")
    # a message in a list may take no byte, if it has no fields, but counts as one
    lists = [counts.get(field.type, 1) for field in fields if field.is_list]
    return _PART * max(lists, default=1)


class _Part(NamedTuple):
    """A field with messages or texts."""

    type: str  # name of the type of message; empty for texts
    length: int  # number of messages or texts; 1 in a list, which may have any length
    is_array: bool
    is_list: bool


def _parts(types: Types, name: str) -> Iterator[_Part]:
    """Yield the fields of a type that have messages, or several texts."""
    from rosbags.interfaces import Nodetype

    for _, (node, detail) in types[name][1]:
        if node == Nodetype.NAME:
            yield _Part(detail, 1, is_array=False, is_list=False)
        elif node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            (inner, base), length = detail
            is_list = node == Nodetype.SEQUENCE
            if inner == Nodetype.NAME or base[0] == "string":
                part = base if inner == Nodetype.NAME else ""
                yield _Part(part, 1 if is_list else length, not is_list, is_list)


def _count_parts(types: Types, name: str, counts: dict[str, int]) -> int:
    """Number of messages and texts in a message; adds those of all types in it to `counts`."""
    if name not in counts:
        counts[name] = 1 + sum(
            part.length * (_count_parts(types, part.type, counts) if part.type in types else 1)
            for part in _parts(types, name)
        )
    return counts[name]


def _decompressor(compression: str) -> Decompressor:
    """A decompressor for a chunk; raises ValueError for an unknown compression."""
    if compression == "zstd":
        return _zstd()
    if compression == "bz2":
        import bz2

        return bz2.BZ2Decompressor()
    if compression == "lz4":
        import lz4.frame

        return lz4.frame.LZ4FrameDecompressor()
    raise ValueError(f"compression {compression!r}, must be zstd, lz4 or bz2")


def _zstd() -> Decompressor:
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd  # which rosbags uses, too

    return zstd.ZstdDecompressor()


def _pieces(file: BinaryIO, size: int | None = None) -> Iterator[bytes]:
    """Yield `size` bytes of a file, or the rest of it, in pieces."""
    left = sys.maxsize if size is None else size
    while left > 0 and (piece := file.read(min(left, _PIECE))):
        left -= len(piece)
        yield piece
