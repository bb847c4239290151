"""Files that are written whole or not at all."""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

from trackslip.errors import OutputError


def write_whole(file: Path, write: Callable[[Path], object]) -> None:
    """Have `write` fill a draft beside the file, and put that in its place; where it fails, nothing is left behind."""
    draft = file.with_name(f".{file.name}-{os.getpid()}")
    made = [folder for folder in file.parents if not folder.exists()]
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write(draft)
        os.replace(draft, file)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def write_output(file: Path, write: Callable[[Path], object]) -> None:
    """The same for a file that the user has named: raises OutputError if it can't be written."""
    try:
        write_whole(file, write)
    except OSError as error:
        why = "a folder of its path is a file" if isinstance(error, FileExistsError) else error.strerror or error
        raise OutputError(f"{file}: can't be written ({why})") from error
