"""The files that a command reads, each with a digest of its content when it was read first.

Every reader of files from outside notes them here. Nothing is noted, and no digest computed, unless
a caller records them.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import json
import os
import sys
import sysconfig
import uuid
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Final

from trackslip.replacement import MANIFEST

SUMMARY: Final = "summary.json"
"""File of a folder of results with its numbers, and the times that computing them took."""
_INSTALLED: Final = ("stdlib", "platstdlib", "purelib", "platlib")  # folders of installed modules

_recorded: list[Inputs] = []
"""Those that are recording at present, the latest last."""


class Inputs:
    """The files that were read while this was recording."""

    def __init__(self, ignored: Sequence[Path] = ()) -> None:
        """`ignored`: folders whose files are no inputs."""
        self.id = uuid.uuid4().hex
        """Unlike that of any other recording."""
        self.digests: dict[str, str] = {}
        """Digests by path, as given to the reader."""
        self._ignored = [_real(folder) for folder in ignored]

    def note(self, path: Path, digest: str | None = None) -> None:
        """Note a file, or a folder with the `digest` of what counts in it, unless it is ignored or
        was noted before.

        Manifests are no inputs: they state when and how results were made, not what they are.
        """
        name = str(path)
        place = _real(path)
        is_ignored = any(place.is_relative_to(folder) for folder in self._ignored)
        if is_ignored or name in self.digests or path.name == MANIFEST:
            return
        with contextlib.suppress(OSError):  # the reader reports it
            self.digests[name] = content_digest(path) if digest is None else digest


def _real(path: Path) -> Path:
    """A path without links, as far as there are folders: Path.resolve fails for links in a loop."""
    return Path(os.path.realpath(path))


@contextlib.contextmanager
def recorded(inputs: Inputs) -> Iterator[Inputs]:
    """Record the files that are read in a block."""
    _recorded.append(inputs)
    try:
        yield inputs
    finally:
        _recorded.remove(inputs)


def note_input(path: Path) -> None:
    """Note a file that is about to be read."""
    for inputs in _recorded:
        inputs.note(path)


def note_listing(folder: Path, found: Iterable[Path]) -> None:
    """Note the files that were `found` in a folder."""
    for inputs in _recorded:
        inputs.note(folder, listing_digest(found))


def import_own(name: str) -> ModuleType:
    """Import a user's module, and note its file and those of all modules that aren't installed,
    as it may have imported them.
    """
    module = importlib.import_module(name)
    installed = tuple(sysconfig.get_paths()[kind] + os.sep for kind in _INSTALLED)
    for each in [module, *sys.modules.values()]:
        file = getattr(each, "__file__", None)
        if file and (each is module or not file.startswith(installed)):
            note_input(Path(file))
    return module


def recording() -> Inputs | None:
    """What records at present, if anything does."""
    return _recorded[-1] if _recorded else None


def content_digest(path: Path) -> str:
    """SHA-256 of a file's content, of a summary's without its computing times; raises OSError if it
    can't be read.
    """
    with path.open("rb") as file:
        whole = hashlib.file_digest(file, "sha256").hexdigest()
    if path.name != SUMMARY:
        return whole
    try:
        summary = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return whole
    if not isinstance(summary, dict):
        return whole
    summary.pop("timing", None)
    return hashlib.sha256(json.dumps(summary, sort_keys=True).encode()).hexdigest()


def listing_digest(found: Iterable[Path]) -> str:
    """SHA-256 of the names of files."""
    names = "\n".join(sorted(map(str, found)))
    return hashlib.sha256(names.encode(errors="surrogateescape")).hexdigest()
