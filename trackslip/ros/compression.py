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


def decompressed(data: bytes, compression: str, notes: list[str]) -> bytes:
    """Data decompressed, as far as it is undamaged; raises LogError for an unknown compression."""
    if compression in ("", "none"):
        return data
    if compression not in _DECOMPRESSORS:
        raise LogError(f"compression {compression!r} is not one of {', '.join(_DECOMPRESSORS)}")
    plain = io.BytesIO()
    if not _expand(io.BytesIO(data), plain, _DECOMPRESSORS[compression]):
        notes.append("a compressed chunk is damaged or cut off")
    return plain.getvalue()


@contextmanager
def uncompressed(path: Path, notes: list[str]) -> Iterator[Path]:
    """The file, or a decompressed copy if it is compressed as a whole."""
    with path.open("rb") as file:
        if file.read(len(ZSTD_MAGIC)) != ZSTD_MAGIC:
            yield path
            return
        file.seek(0)
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder, "bag")
            with copy.open("wb") as plain:
                complete = _expand(file, plain, _zstd)
            if not complete:
                notes.append("its compressed data is damaged or cut off")
            yield copy


def _expand(file: BinaryIO, plain: BinaryIO, new: Callable[[], Any]) -> bool:
    """Decompress all frames of a file; returns whether it could be done to the end."""
    decompressor, complete = new(), False
    while block := file.read(_BLOCK):
        while block:
            if complete:  # another frame follows
                decompressor, complete = new(), False
            try:
                plain.write(decompressor.decompress(block))
            except Exception:  # each library has errors of its own
                return False
            complete = decompressor.eof
            block = decompressor.unused_data if complete else b""
    return complete


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
