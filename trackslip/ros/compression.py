"""Decompression of whole files, chunks and messages; of damaged data, as much as there is."""

from __future__ import annotations

import bz2
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from trackslip.errors import LogError

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_BLOCK = 1 << 20  # bytes decompressed at a time


@contextmanager
def opened(path: Path, notes: list[str]) -> Iterator[BinaryIO]:
    """The file, opened to be read; if it is compressed as a whole, a decompressed copy."""
    with path.open("rb") as file:
        if path.suffix.lower() != ".zstd":
            yield file
            return
        with tempfile.TemporaryFile() as copy:
            if not _expand(file, copy):
                notes.append("its compressed data is damaged or cut off")
            copy.seek(0)
            yield copy


def decompressed(data: bytes, compression: str, notes: list[str]) -> bytes:
    """A chunk decompressed, as far as it is undamaged; raises LogError for an unknown compression."""
    if compression in ("", "none"):
        return data
    if compression not in _DECOMPRESSORS:
        raise LogError(f"compression {compression!r} is not one of {', '.join(_DECOMPRESSORS)}")
    parts, complete = _parts(_DECOMPRESSORS[compression](), data)
    if not complete:
        notes.append("a compressed chunk is damaged or cut off")
    return b"".join(parts)


def _expand(file: BinaryIO, copy: BinaryIO) -> bool:
    """Decompress a Zstandard file; returns whether all of it could be."""
    decompressor, complete = _zstd(), False
    while block := file.read(_BLOCK):
        while block:
            if complete:  # another frame follows
                decompressor, complete = _zstd(), False
            try:
                copy.write(decompressor.decompress(block))
            except Exception:  # each library has errors of its own
                return False
            complete = decompressor.eof
            block = decompressor.unused_data if complete else b""
    return complete


def _parts(decompressor: Any, data: bytes) -> tuple[list[bytes], bool]:
    """What can be decompressed, and whether that is all."""
    parts: list[bytes] = []
    for first in range(0, len(data), _BLOCK):
        try:
            parts.append(decompressor.decompress(data[first : first + _BLOCK]))
        except Exception:  # each library has errors of its own
            return parts, False
        if decompressor.eof:
            return parts, True
    return parts, False


def _zstd() -> Any:
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd.ZstdDecompressor()


def _lz4() -> Any:
    from lz4.frame import LZ4FrameDecompressor

    return LZ4FrameDecompressor()


_DECOMPRESSORS: dict[str, Callable[[], Any]] = {"zstd": _zstd, "lz4": _lz4, "bz2": bz2.BZ2Decompressor}
