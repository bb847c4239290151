"""Decompression of files, chunks and messages; damaged data is recovered as far as possible."""

from __future__ import annotations

import bz2
import io
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from trackslip.errors import LogError

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_BLOCK = 1 << 20  # bytes decompressed at a time
_LEAST, _USUAL = 1 << 28, 100  # bytes that any file may expand to, and bytes for each of its own


class TooLargeError(LogError):
    """Data that expands beyond what its reader allows."""


class Allowance:
    """What may still be decompressed of a file: small ones that expand to fill any memory are refused."""

    def __init__(self, path: Path, megabytes: float | None = None) -> None:
        """At most `megabytes`, by default _LEAST and _USUAL times the size of the file."""
        self.left = _LEAST + _USUAL * path.stat().st_size if megabytes is None else megabytes * 1e6
        self._most = self.left

    def take(self, size: int) -> None:
        """Count bytes that were decompressed; raises TooLargeError beyond what is allowed."""
        self.left -= size
        if self.left < 0:
            raise TooLargeError(f"expands to more than {self._most / 1e6:.0f} MB; --max-expanded allows more")


def decompressed(
    data: bytes, compression: str, notes: list[str], allowance: Allowance | None = None, size: int = _LEAST
) -> bytes:
    """Data decompressed, as far as it is undamaged, and no more than the `size` that it should have [bytes].

    Raises LogError for an unknown compression, TooLargeError beyond what is allowed.
    """
    if compression in ("", "none"):
        return data
    if compression not in _DECOMPRESSORS:
        raise LogError(f"compression {compression!r} is not one of {', '.join(_DECOMPRESSORS)}")
    plain = io.BytesIO()
    if not _expand(io.BytesIO(data), plain, _DECOMPRESSORS[compression], allowance, size):
        notes.append("a compressed chunk is damaged or cut off")
    return plain.getvalue()


@contextmanager
def uncompressed(path: Path, notes: list[str], allowance: Allowance) -> Iterator[Path]:
    """The file, or a decompressed copy if it is compressed as a whole."""
    with path.open("rb") as file:
        if file.read(len(ZSTD_MAGIC)) != ZSTD_MAGIC:
            yield path
            return
        file.seek(0)
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder, "bag")
            with copy.open("wb") as plain:
                complete = _expand(file, plain, _zstd, allowance)
            if not complete:
                notes.append("its compressed data is damaged or cut off")
            yield copy


def _expand(
    file: BinaryIO, plain: BinaryIO, new: Callable[[], Any], allowance: Allowance | None, left: int = sys.maxsize
) -> bool:
    """Decompress all frames of a file, up to `left` bytes; returns whether it could be done to the end."""
    decompressor = new()
    while block := file.read(_BLOCK):
        while block or not (decompressor.eof or decompressor.needs_input):
            if decompressor.eof:  # another frame follows
                decompressor = new()
            try:
                content = decompressor.decompress(block, _BLOCK)
            except Exception:  # each library has errors of its own
                return False
            if allowance is not None:
                allowance.take(len(content))
            if len(content) > left:
                plain.write(content[:left])
                return False
            plain.write(content)
            left -= len(content)
            block = decompressor.unused_data if decompressor.eof else b""
    return bool(decompressor.eof)


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
