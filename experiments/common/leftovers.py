"""What an interrupted process must undo before it ends: temporary files, drafts and worker
processes.
"""

import contextlib
import os
import shutil
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Final

ATTEMPTS: Final = 20
"""Attempts to delete a folder into which another thread may be writing."""

_unfinished: Final[list[Callable[[], object]]] = []
"""What is still to be undone, in the order in which it was begun."""


@contextlib.contextmanager
def undone(undo: Callable[[], object]) -> Iterator[None]:
    """Call `undo` when the block ends, and when the process ends within the block by an interrupt.

    In the latter case `undo` may run in another thread while the block goes on, or a second time;
    exceptions that it raises are then dropped.
    """
    _unfinished.append(undo)
    try:
        yield
    finally:
        undo()
        _unfinished.remove(undo)


@contextlib.contextmanager
def temporary(path: Path) -> Iterator[Path]:
    """Delete a file or a folder, if it exists, when the block or an interrupted process ends."""
    with undone(partial(delete, path)):
        yield path


def delete(path: Path) -> None:
    """Delete a file or a folder, if it exists and can be deleted; a link is not followed."""
    for _ in range(ATTEMPTS):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
        if not os.path.lexists(path):
            return


def undo_all() -> None:
    """Undo what is unfinished, the latest first."""
    for undo in reversed(_unfinished.copy()):
        with contextlib.suppress(Exception):
            undo()
