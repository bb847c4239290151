"""Files: JSON, regular files, and the format of stored results, so that newer formats are refused, not misread."""

from __future__ import annotations

import errno
import importlib.metadata
import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trackslip.errors import LogError, first_line

_MOST = 256_000_000  # most bytes of a text file; as JSON it takes some gigabytes of memory
_POINTER = b"version https://git-lfs.github.com/spec/"
_DIGITS = 18  # most digits of an integer that surely fits in 64 bits


def regular_file(path: Path) -> Path:
    """The path, if it is a regular file: not a pipe or device, whose content may never end, or a Git LFS pointer.

    Raises OSError with the reason otherwise.
    """
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "not a regular file")
    with path.open("rb") as file:
        if file.read(len(_POINTER)) == _POINTER:
            raise OSError(errno.EINVAL, "a Git LFS pointer instead of the file; `git lfs pull` fetches it")
    return path


def read_text(path: Path, most: int = _MOST) -> str:
    """The text of a file in UTF-8, without its byte order mark.

    Raises OSError if there is no regular file or it has more than `most` bytes, UnicodeDecodeError if it isn't text.
    """
    size = regular_file(path).stat().st_size
    if size > most:
        raise OSError(errno.EFBIG, f"{size} bytes long, must be at most {most}")
    return path.read_text(encoding="utf-8-sig")


def read_json(path: Path) -> Any:
    """The content of a JSON file, integers beyond 64 bits as floating-point numbers; LogError if it can't be read."""
    try:
        return json.loads(read_text(path), parse_int=_integer)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise LogError(f"{path}: not JSON ({reason(error)})") from error


def reason(error: Exception) -> str:
    """Why the content of a file can't be used, in words for people who don't know Python."""
    match error:
        case KeyError():
            return f"{error.args[0]} is missing"
        case OverflowError() | RecursionError():
            return "a number is too large" if isinstance(error, OverflowError) else "nested too deeply"
        case TypeError() | AttributeError() | LookupError():
            return "a part has another form than expected"
        case UnicodeDecodeError():
            return f"not text: {error.reason}"
        case _:
            return first_line(error)


def _integer(digits: str) -> int | float:
    return int(digits) if len(digits) <= _DIGITS else float(digits)


FORMAT = 1
"""Format of the manifests, laws and runs written by this version; it increases when older versions cannot read them."""
MANIFEST = "manifest.json"


def require_known_format(content: Mapping[str, Any], source: object) -> None:
    """Raise LogError if `content`, called `source` in the message, is from a newer version.

    Content without `format` is of the first format. A manifest has `versions`, which name the version that wrote it.
    """
    version = content.get("format", 1)
    if version not in range(1, FORMAT + 1):
        versions = content.get("versions")
        writer = versions.get("trackslip") if isinstance(versions, Mapping) else None
        by = f"trackslip {writer}" if writer else "a newer trackslip"
        this = f"trackslip {installed_version()}"
        raise LogError(f"{source}: written by {by} in format {version}; {this} reads formats up to {FORMAT}")


def installed_version() -> str:
    """The version of trackslip, "(unknown version)" in a checkout that isn't installed."""
    try:
        return importlib.metadata.version("trackslip")
    except importlib.metadata.PackageNotFoundError:
        return "(unknown version)"


def known_manifest(folder: Path) -> Mapping[str, Any]:
    """The manifest of a folder of results, empty where there is none, as in a folder of a real robot's logs.

    Raises LogError if it is damaged or from a newer version.
    """
    file = folder / MANIFEST
    if not file.exists():
        return {}
    content = read_json(file)
    if not isinstance(content, Mapping):
        raise LogError(f"{file}: not a manifest")
    require_known_format(content, file)
    return content
