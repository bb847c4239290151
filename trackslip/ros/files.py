"""Files of bags: which belong together, and the topics and times of their messages."""

from __future__ import annotations

import os
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from trackslip.errors import LogError, first_line
from trackslip.ros.readers import Record, read_file

_METADATA = "metadata.yaml"
_STORAGES = {".bag", ".mcap", ".db3"}
_WRAPPINGS = {".zstd", ".active"}  # of compressed files, and of recordings that weren't closed
_DEPTH = 3  # of folders in folders
_PART = re.compile(r"(.*?)(?:_\d{4}(?:-\d\d){5})?_(\d+)")  # name and number of a part, perhaps with a date
_KEPT = (
    *("geometry_msgs/", "nav_msgs/msg/Odometry", "tf/", "tf2_msgs/"),
    *("sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState", "sensor_msgs/msg/NavSatFix"),
)  # beginnings of the types whose messages are small, and mostly read more than once
_MOST_KEPT = 256_000_000  # of their bytes
_MAX_PAUSE = 2.0  # time between the parts of a bag [s]


@dataclass
class Parts:
    """Files of a bag and their contents."""

    name: str
    files: tuple[Path, ...]
    arrivals: dict[tuple[str, str], list[int]] = field(default_factory=lambda: defaultdict(list))
    """Times of recording of the messages, by topic and type [ns]."""
    notes: list[str] = field(default_factory=list)
    """Damage and missing files, one line each."""
    kept: list[Record] | None = field(default_factory=list)
    """The small messages, in the order of the files; None if they are too many to keep."""

    @property
    def span(self) -> tuple[int, int]:
        """Times at which the first and the last message were recorded [ns]."""
        return min(map(min, self.arrivals.values())), max(map(max, self.arrivals.values()))


def is_bag(path: Path) -> bool:
    """True for a bag's file, or a folder with bags."""
    return _is_bag_file(path) or (path.is_dir() and bool(_bags_in(path)))


def read_parts(path: Path, max_expanded: float | None = None) -> list[Parts]:
    """The readable bags in a folder, or the bag of a file.

    A folder with a metadata.yaml is one bag. Other files are bags of their own, unless they are numbered and each
    begins when the one before ends. Raises LogError if there is none, or none can be read.
    """
    try:
        if not path.exists():
            raise LogError(f"{path}: no such file or folder")
        bags = _bags_in(path)
    except OSError as error:
        raise LogError(f"path = {str(path)[:80]!r}: {error.strerror}") from error
    if not bags:
        raise LogError(f"{path}: holds no bag (.bag, .mcap or .db3)" if path.is_dir() else f"{path}: is no bag")
    for bag in bags:
        _read(bag, max_expanded)
    found = [bag for bag in bags if bag.arrivals]
    refused = [_refusal(bag) for bag in bags if not bag.arrivals]
    if not found:
        raise LogError(refused[0])
    found = _joined(found)
    found[0].notes.extend(refused)
    return found


def _bags_in(path: Path, depth: int = _DEPTH) -> list[Parts]:
    """The bags in a folder, or the bag of a file, unread."""
    if not path.is_dir():
        return [Parts(_stem(path), (path,))] if _is_bag_file(path) else []
    entries = sorted(path.iterdir())
    files = [entry for entry in entries if _is_bag_file(entry) and entry.is_file()]
    if files and (path / _METADATA).is_file():
        name = path.resolve().name
        return [Parts(name, tuple(files), notes=[f"{name}: {line}" for line in _missing_files(path)])]
    found = [Parts(_stem(file), (file,)) for file in files]
    if depth:
        for folder in (entry for entry in entries if entry.is_dir() and os.access(entry, os.R_OK | os.X_OK)):
            found += _bags_in(folder, depth - 1)
    return found


def _read(bag: Parts, max_expanded: float | None) -> None:
    """Read the times of its messages and those to keep, and note damage."""
    size = 0
    for file in bag.files:
        said: list[str] = []
        try:
            for record in read_file(file, lambda channel: is_kept(channel.type), said, max_expanded):
                bag.arrivals[record.channel.topic, record.channel.type].append(record.arrival)
                size += len(record.data)
                if size > _MOST_KEPT:
                    bag.kept = None
                elif bag.kept is not None and record.data:
                    bag.kept.append(record)
        except LogError as error:
            said.append(str(error).removeprefix(f"{file}: "))
        for line, count in Counter(said).items():
            bag.notes.append(f"{file}: {line}" + (f" ({count} times)" if count > 1 else ""))


def is_kept(kind: str) -> bool:
    """True for the types whose messages are kept."""
    return kind.startswith(_KEPT)


def _refusal(bag: Parts) -> str:
    """The line for a bag that has no messages."""
    file = bag.files[0]
    reasons = [note.removeprefix(f"{file}: ") for note in bag.notes]
    return f"{file}: " + (f"no message can be read ({reasons[-1]})" if reasons else "it has no messages")


def _joined(bags: Sequence[Parts]) -> list[Parts]:
    """The bags, with those joined that are successive parts of one."""
    joined: list[Parts] = []
    last = None
    for bag in sorted(bags, key=_part):
        folder, name, number = part = _part(bag)
        if last is not None and name and last == (folder, name, number - 1):
            pause = (bag.span[0] - joined[-1].span[1]) / 1e9
            if 0 <= pause < _MAX_PAUSE:
                before = joined.pop()
                for key, times in bag.arrivals.items():
                    before.arrivals[key] += times
                kept = None if before.kept is None or bag.kept is None else before.kept + bag.kept
                bag = Parts(name, before.files + bag.files, before.arrivals, before.notes + bag.notes, kept)
        joined.append(bag)
        last = part
    return joined


def _part(bag: Parts) -> tuple[Path, str, int]:
    """Folder, name and number of a part; the name is empty for a bag that isn't one."""
    match = _PART.fullmatch(bag.name) if len(bag.files) == 1 else None
    return (bag.files[0].parent, match[1], int(match[2])) if match else (bag.files[0], "", 0)


def _missing_files(folder: Path) -> list[str]:
    """A line for each file that the metadata of a ROS 2 bag lists and its folder lacks, or for damaged metadata."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        about = YAML(typ="safe").load((folder / _METADATA).read_text(encoding="utf-8"))
        named = [Path(name).name for name in about["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (YAMLError, OSError, UnicodeError, ValueError, KeyError, TypeError, AttributeError) as error:
        return [f"its {_METADATA} is damaged ({first_line(error)})"]
    return [f"its file {name} is missing" for name in named if not (folder / name).is_file()]


def _is_bag_file(path: Path) -> bool:
    """True for the name of a bag's file."""
    suffixes = [suffix.lower() for suffix in path.suffixes]
    while suffixes and suffixes[-1] in _WRAPPINGS:
        suffixes.pop()
    return bool(suffixes) and suffixes[-1] in _STORAGES


def _stem(path: Path) -> str:
    """The name of a file without the suffixes of bags."""
    name = path.name
    while Path(name).suffix.lower() in _STORAGES | _WRAPPINGS:
        name = Path(name).stem
    return name
