"""One command at a time in a folder."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from trackslip.errors import OutputError

with contextlib.suppress(ImportError):  # there is none on Windows
    import fcntl

LOCK = ".lock"
_UNSUPPORTED = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)  # by the file system


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other commands out of a folder, which must exist, until the block ends.

    The system holds the lock, so it ends with the process, however that ends; a file that a killed one left locks
    nothing. Where the file system has no locks, there are none.

    Raises:
        OutputError: at once, when another command has the folder, or when it can't be written.
    """
    descriptor = None
    try:
        try:
            descriptor = _acquire(folder / LOCK)
        except BlockingIOError as error:
            raise OutputError(f"out = {str(folder)!r}: another command is writing there") from error
        except OSError as error:
            raise OutputError(f"out = {str(folder)!r}: can't be written ({error.strerror})") from error
        yield
    finally:
        if descriptor is not None:
            with contextlib.suppress(OSError):
                (folder / LOCK).unlink()  # while it is ours
            os.close(descriptor)


def _acquire(file: Path) -> int:
    """The descriptor of the locked file."""
    while True:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if os.name == "posix":  # elsewhere folders aren't locked
                _lock(descriptor)
            if _same(descriptor, file):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # its last owner has deleted it meanwhile


def _lock(descriptor: int) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise


def _same(descriptor: int, file: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), file.stat())
    except FileNotFoundError:
        return False
