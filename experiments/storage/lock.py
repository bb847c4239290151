"""One command at a time in a folder."""

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from trackslip.errors import OutputError

LOCK_FILE = ".lock"
_UNSUPPORTED = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)  # by the file system


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other commands out of a folder, which must exist, until the block ends.

    The operating system holds the lock, so it ends with the process, however that ends; a file left behind by a killed
    process locks nothing. A file system without locks is used without one. Raises OutputError, at once, if another
    command is using the folder or the folder isn't writable.
    """
    lock = FileLock(folder / LOCK_FILE, blocking=False, fallback_to_soft=False)
    try:
        lock.acquire()
    except Timeout as error:
        raise OutputError(f"out = {str(folder)!r}: another command is writing there") from error
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise OutputError(f"out = {str(folder)!r}: can't be written ({error.strerror})") from error
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            (folder / LOCK_FILE).unlink()  # while it is ours; Windows deletes it on release
        lock.release()
