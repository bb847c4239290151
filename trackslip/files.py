"""Reading of regular files, JSON and NumPy archives, and the format of stored results, by which
newer formats are refused.
"""

from __future__ import annotations

import errno
import importlib.metadata
import json
import math
import os
import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from trackslip.errors import LogError, first_line
from trackslip.inputs import note_input
from trackslip.memory import size_text
from trackslip.replacement import MANIFEST, complete_for_reading

FORMAT: Final = 1
"""Format of manifests, laws and runs from this version. The number increases when older versions
cannot read them.
"""
MOST_ARRAYS: Final = 100_000_000
"""Most memory for the arrays in a file, a hundred times those of a trained policy [bytes]."""
# largest text file, which takes 3 GB of memory if it is JSON made of empty lists [bytes]
_MAX_TEXT: Final = 100_000_000
_LFS_POINTER: Final = b"version https://git-lfs.github.com/spec/"  # beginning of a Git LFS pointer
_MAX_DIGITS: Final = 18  # largest number of digits with which every integer fits in 64 bits


def regular_file(path: Path) -> Path:
    """Return `path` if it is a regular file. Raises OSError with the reason otherwise.

    A pipe or a device, whose content may never end, and a Git LFS pointer are not regular files.
    """
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "not a regular file")
    with path.open("rb") as file:
        if file.read(len(_LFS_POINTER)) == _LFS_POINTER:
            problem = "a Git LFS pointer instead of the file; `git lfs pull` fetches it"
            raise OSError(errno.EINVAL, problem)
    note_input(path)
    return path


def read_text(path: Path, most: int = _MAX_TEXT) -> str:
    """Read the text of a file in UTF-8, without the byte order mark.

    Raises OSError if `path` is not a regular file or has more than `most` bytes, UnicodeDecodeError
    if it isn't text.
    """
    size = regular_file(path).stat().st_size
    if size > most:
        raise OSError(errno.EFBIG, f"{size} bytes long, must be at most {most}")
    return path.read_text(encoding="utf-8-sig")


def read_json(path: Path) -> Any:
    """Read a JSON file, with integers above 64 bits as floats. Raises LogError if the file can't be
    read.
    """
    try:
        return json.loads(read_text(path), parse_int=_integer)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise LogError(f"{path}: not JSON ({reason(error)})") from error


def read_npz(path: Path, most: int = MOST_ARRAYS) -> dict[str, np.ndarray]:
    """Read the arrays in a .npz file by name, without pickle.

    Raises LogError if they take more than `most` bytes, OSError if `path` is not a regular file,
    and any error of zipfile and NumPy for a damaged file.
    """
    with zipfile.ZipFile(regular_file(path)) as archive:
        members = archive.infolist()
        size = sum(member.file_size for member in members)
        if size > most:
            sizes = f"unpacks to {size_text(size)}, must be at most {size_text(most)}"
            raise LogError(f"{path}: {sizes}")
        arrays = {}
        for member in members:
            # the header first, as its numbers decide how much memory is taken
            with archive.open(member) as file:
                if _array_size(file) > member.file_size:
                    raise ValueError(f"{member.filename} states more numbers than it holds")
            with archive.open(member) as file:
                array = np.lib.format.read_array(file, allow_pickle=False)
            arrays[member.filename.removesuffix(".npy")] = array
    return arrays


def _array_size(file: IO[bytes]) -> int:
    """Size of the array in a .npy file, as its header states it [bytes]."""
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    version = np.lib.format.read_magic(file)
    shape, _, dtype = readers[version](file)
    return math.prod(shape) * dtype.itemsize


def reason(error: Exception) -> str:
    """Explain to people who don't know Python why an error makes the content of a file unusable."""
    match error:
        case KeyError():
            return f"{error.args[0]} is missing"
        case OverflowError():
            return "a number is too large"
        case RecursionError():
            return "nested too deeply"
        case TypeError() | AttributeError() | LookupError():
            return "a part has another form than expected"
        case UnicodeDecodeError():
            return f"not text: {error.reason}"
        case _:
            return first_line(error)


def _integer(digits: str) -> int | float:
    """An integer in a JSON file; a float if it may not fit in 64 bits."""
    return int(digits) if len(digits) <= _MAX_DIGITS else float(digits)


def require_known_format(content: Mapping[str, Any], source: object) -> None:
    """Raise LogError if `content`, called `source` in the message, has the format of a newer
    version.

    Content without the key `format` has the first format. In a manifest, `versions` includes the
    writer's version.
    """
    version = content.get("format", 1)
    if version not in range(1, FORMAT + 1):
        versions = content.get("versions")
        writer = versions.get("trackslip") if isinstance(versions, Mapping) else None
        written = f"trackslip {writer}" if writer else "a newer trackslip"
        installed = f"trackslip {installed_version()} reads formats up to {FORMAT}"
        raise LogError(f"{source}: written by {written} in format {version}; {installed}")


def installed_version() -> str:
    """Version of trackslip, or "(unknown version)" in a checkout that isn't installed."""
    try:
        return importlib.metadata.version("trackslip")
    except importlib.metadata.PackageNotFoundError:
        return "(unknown version)"


def known_manifest(folder: Path) -> Mapping[str, Any]:
    """Read the manifest of a results folder; empty if missing, as in a folder with a robot's logs.

    Results that a killed command has only begun to move are moved first. Raises LogError if the
    manifest is damaged or from a newer version, OutputError if the results can't be moved.
    """
    complete_for_reading(folder)
    return read_manifest(folder)


def read_manifest(folder: Path) -> Mapping[str, Any]:
    """Read the manifest of a results folder; empty if missing.

    Raises LogError if the manifest is damaged or from a newer version.
    """
    file = folder / MANIFEST
    if not file.exists():
        return {}
    content = read_json(file)
    if not isinstance(content, Mapping):
        raise LogError(f"{file}: not a manifest")
    require_known_format(content, file)
    return content
