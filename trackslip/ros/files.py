"""Which files make up a bag."""

from __future__ import annotations

import os
from pathlib import Path

from trackslip.errors import LogError, first_line

METADATA = "metadata.yaml"
_STORAGES = (".bag", ".mcap", ".db3")
_WRAPPINGS = (".zstd", ".active")  # of compressed files, and of recordings that weren't closed
_DEPTH = 3  # of folders in folders


def is_bag_file(path: Path) -> bool:
    """Whether the name is that of a bag's file."""
    return _format(path) in _STORAGES


def is_bag(path: Path) -> bool:
    """Whether a path is a bag's file, or a folder that holds bags."""
    return is_bag_file(path) or (path.is_dir() and bool(bags_in(path)))


def stem(path: Path) -> str:
    """The name of a file without the suffixes of bags."""
    name = path.name
    while Path(name).suffix.lower() in (*_STORAGES, *_WRAPPINGS):
        name = Path(name).stem
    return name


def bags_in(path: Path, depth: int = _DEPTH) -> list[tuple[Path, ...]]:
    """The files of each bag in a folder, or the file itself.

    A folder with a metadata.yaml is one bag. Files in others are bags of their own.
    """
    if not path.is_dir():
        return [(path,)]
    entries = sorted(path.iterdir())
    files = [entry for entry in entries if is_bag_file(entry) and entry.is_file()]
    if files and (path / METADATA).is_file():
        return [tuple(files)]
    found: list[tuple[Path, ...]] = [(file,) for file in files]
    if depth:
        for folder in (entry for entry in entries if entry.is_dir() and os.access(entry, os.R_OK | os.X_OK)):
            found += bags_in(folder, depth - 1)
    return found


def missing_files(folder: Path) -> list[str]:
    """Names of files that the metadata of a ROS 2 bag lists and its folder lacks; raises LogError if it is damaged."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        about = YAML(typ="safe").load((folder / METADATA).read_text(encoding="utf-8"))
        listed = [Path(name).name for name in about["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (YAMLError, OSError, UnicodeError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LogError(f"its {METADATA} is damaged ({first_line(error)})") from error
    return [name for name in listed if not (folder / name).is_file()]


def _format(path: Path) -> str:
    suffixes = [suffix.lower() for suffix in path.suffixes]
    while suffixes and suffixes[-1] in _WRAPPINGS:
        suffixes.pop()
    return suffixes[-1] if suffixes else ""
