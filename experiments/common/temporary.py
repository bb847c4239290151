"""Temporary files of a command: private, and deleted even after a command that was killed."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from filelock import FileLock, Timeout

from experiments.common.leftovers import temporary

_PREFIX: Final = "trackslip-"
_LOCK: Final = ".lock"  # held by the process whose files are in the folder
_NEW_LOCK: Final = ".new-lock"  # the same, until it is held


@contextlib.contextmanager
def temporary_files() -> Iterator[Path]:
    """Keep all temporary files of a block, libraries' and child processes' too, in a folder that
    only the user can read.

    The folder is deleted at the end. Folders that killed processes left behind are deleted first.
    """
    _delete_abandoned(Path(tempfile.gettempdir()))
    before = tempfile.tempdir
    variable = os.environ.get("TMPDIR")
    folder = tempfile.mkdtemp(prefix=_PREFIX)
    with temporary(Path(folder)):
        # The lock gets its name when it is held, so that no other command can take it before and
        # delete the folder as abandoned.
        new_lock = Path(folder) / _NEW_LOCK
        with FileLock(new_lock):
            new_lock.rename(Path(folder) / _LOCK)
            tempfile.tempdir = os.environ["TMPDIR"] = folder
            try:
                yield Path(folder)
            finally:
                tempfile.tempdir = before
                if variable is None:
                    del os.environ["TMPDIR"]
                else:
                    os.environ["TMPDIR"] = variable


def _delete_abandoned(parent: Path) -> None:
    """Delete the user's folders from earlier commands whose processes have ended."""
    for folder in parent.glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError, Timeout):
            mine = not folder.is_symlink() and folder.stat().st_uid == os.getuid()
            if mine and (folder / _LOCK).is_file():
                with FileLock(folder / _LOCK, blocking=False):
                    shutil.rmtree(folder)
