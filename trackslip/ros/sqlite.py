"""Reading the SQLite files of ROS 2 bags, as far as they are undamaged."""

from __future__ import annotations

import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from shutil import copyfileobj

from trackslip.errors import LogError, first_line
from trackslip.ros.compression import opened
from trackslip.ros.record import Channel, Record, Wanted, ros2_type

_MAGIC = b"SQLite format 3\0"


def read_sqlite(path: Path, wanted: Wanted, notes: list[str]) -> Iterator[Record]:
    """All messages that can be read, in the file's order; `notes` gets a line for each damage."""
    with opened(path, notes) as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise LogError("is no SQLite database")
        if path.suffix.lower() != ".zstd":
            yield from _read(path, wanted, notes)
            return
        file.seek(0)
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder, "bag.db3")
            with copy.open("wb") as into:
                copyfileobj(file, into)
            yield from _read(copy, wanted, notes)


def _read(path: Path, wanted: Wanted, notes: list[str]) -> Iterator[Record]:
    uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    with closing(sqlite3.connect(uri, uri=True)) as database:
        database.execute("PRAGMA writable_schema = ON")  # without it, SQLite refuses files that were cut off
        database.text_factory = lambda text: text.decode(errors="replace")
        try:
            channels = {
                number: Channel(topic, ros2_type(name), encoding)
                for number, topic, name, encoding in database.execute(
                    "SELECT id, name, type, serialization_format FROM topics"
                )
            }
        except (sqlite3.Error, AttributeError) as error:
            raise LogError(f"is no ROS 2 bag, or damaged ({first_line(error)})") from error
        read = {number: wanted(channel.topic) for number, channel in channels.items()}
        some = ", ".join(str(int(number)) for number, chosen in read.items() if chosen) or "NULL"
        # by rowid, whose table is what a cut end leaves longest
        rows = f"SELECT topic_id, timestamp, CASE WHEN topic_id IN ({some}) THEN data END FROM messages NOT INDEXED"
        try:
            for number, arrival, data in database.execute(rows):
                if number in channels and isinstance(arrival, int):
                    yield Record(channels[number], arrival, data if isinstance(data, bytes) else b"")
        except sqlite3.Error as error:
            notes.append(f"its end is missing, or it is damaged ({first_line(error)})")
