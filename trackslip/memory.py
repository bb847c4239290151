"""The memory that the content of a file may take, which is known from the file's own description or
counted in small pieces before the memory is taken.

Every reader of files from outside asks `require_fits` first. Its limit is `max_memory` [bytes];
None is half of the machine's memory.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, Protocol

from trackslip.errors import InvalidValueError, LogError

UNKNOWN: Final = 8_000_000_000
"""Memory that a machine is taken to have where the system doesn't say [bytes]."""
_CONTAINER_LIMIT: Final = Path("/sys/fs/cgroup/memory.max")  # of a Linux container
_UNITS: Final = {"KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_MIN_LIMIT: Final = 1_000_000  # least limit that can be chosen [bytes]
_PIECE_SIZE: Final = 1_000_000  # size of the pieces in which unpacked data are counted [bytes]


def half_of_memory() -> int:
    """Half of the memory that the machine, the container and the process may use [bytes]."""
    limits = [_physical_memory(), *_container_limit(), *_process_limit()]
    return min(limits) // 2


def _physical_memory() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows, for example
        return UNKNOWN


def _container_limit() -> list[int]:
    """The limit of a container, if there is one [bytes]."""
    try:
        return [int(_CONTAINER_LIMIT.read_text())]
    except (OSError, ValueError):  # no container, or "max"
        return []


def _process_limit() -> list[int]:
    """The limit on the process's address space, as set by `ulimit -v`, if there is one [bytes]."""
    if sys.platform == "win32":
        return []
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return [] if soft == resource.RLIM_INFINITY else [soft]


def require_fits(source: object, needed: int, max_memory: int | None = None) -> None:
    """Raise LogError, which begins with `source`, if its content would take more memory than is
    allowed.

    Args:
        source: the file, for the message.
        needed: most memory that the content may take [bytes].
        max_memory: limit [bytes]; None for half of the machine's memory.
    """
    limit = half_of_memory() if max_memory is None else max_memory
    if needed > limit:
        taken = f"reading it may take {size_text(needed)} of memory or more"
        raise LogError(f"{source}: {taken}, must be at most {size_text(limit)} (max_memory)")


def size_text(size: int) -> str:
    """A size [bytes] for messages, such as 11.9 GB."""
    for unit, factor in reversed(_UNITS.items()):
        if size >= 1000 * factor:
            return f"{size // factor} {unit}"
        if size >= factor:
            return f"{size / factor:.3g} {unit}"
    return f"{size} bytes"


def parse_size(field: str, text: str) -> int:
    """The number of bytes in a size such as 8GB or 500MB; raises InvalidValueError, which names
    `field`, for other texts.
    """
    number = text[:-2].strip()
    unit = text[-2:].upper()
    allowed = f"a size of at least 1 MB such as 8GB, in {', '.join(_UNITS)}"
    try:
        size = int(float(number) * _UNITS[unit])
    except (KeyError, ValueError, OverflowError) as error:
        raise InvalidValueError(field, text, allowed) from error
    if size < _MIN_LIMIT:
        raise InvalidValueError(field, text, allowed)
    return size


class Decompressor(Protocol):
    """A decompressor of bz2, lz4.frame or zstd, which unpacks one stream in pieces."""

    @property
    def eof(self) -> bool:
        """Whether the stream has ended."""

    @property
    def needs_input(self) -> bool:
        """Whether more packed data are needed for more output."""

    @property
    def unused_data(self) -> bytes | None:
        """Data after the end of the stream."""

    def decompress(self, data: bytes, max_length: int = -1) -> bytes:
        """Unpack more of the stream, at most `max_length` bytes."""


def unpacked(decompressor: Decompressor, packed: Iterable[bytes]) -> Iterator[bytes]:
    """Unpack a stream, given in pieces, to pieces of at most a megabyte.

    Raises ValueError for data after the stream, and the decompressor's own errors.
    """
    for piece in packed:
        if decompressor.eof:
            raise ValueError("data after the end of its compressed stream")
        yield decompressor.decompress(piece, _PIECE_SIZE)
        while not decompressor.eof and not decompressor.needs_input:
            yield decompressor.decompress(b"", _PIECE_SIZE)
        if decompressor.unused_data:
            raise ValueError("data after the end of its compressed stream")


def unpacked_size(decompressor: Decompressor, packed: Iterable[bytes], most: int) -> int:
    """Count the bytes to which a stream unpacks, without keeping them; stops above `most`."""
    size = 0
    for piece in unpacked(decompressor, packed):
        size += len(piece)
        if size > most:
            break
    return size
