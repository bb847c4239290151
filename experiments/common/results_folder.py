"""The folder of a command's results: checked before anything is done, replaced as a whole."""

import contextlib
import os
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, Final

from experiments.common.results import new_folders, output_errors
from trackslip.errors import OutputError
from trackslip.files import read_manifest
from trackslip.replacement import (
    DRAFT,
    LOCK,
    MANIFEST,
    STORE,
    STORED_FILE,
    begin,
    commit,
    complete,
    discard,
    is_ours,
    listed_files,
    locked,
)

UNFINISHED: Final[Mapping[str, re.Pattern[str]]] = {STORE: STORED_FILE}
"""Subfolders that unfinished commands leave, each with a pattern of its files' names."""


@contextlib.contextmanager
def results_folder(out: Path, overwrite: bool, resumed: Collection[str] = ()) -> Iterator[Path]:
    """A folder to write results into, which are moved to `out` when the block ends, or deleted if
    it fails.

    `out` must be new or empty or, with `overwrite`, contain nothing but a command's results, which
    are replaced. It may also contain what an unfinished command left, in one of the subfolders
    UNFINISHED; this is deleted with the old results, but without `overwrite` only if it is named
    in `resumed`. No other command can write to `out` during the block. If the block writes no
    manifest, nothing is replaced.

    Raises OutputError before the block starts if `out` can't be used, and later if the disk is
    full. However the process ends, `out` has the whole old results, or the whole new ones, which
    the next command moves into place (`trackslip.replacement`).
    """
    what = f"out = {str(out)!r}"
    with output_errors(what), new_folders(out):
        _require_lockable(out)
        with locked(out, what):
            complete(out)
            replaced = _old_results(out, overwrite, resumed)
            try:
                draft = begin(out, replaced)
                yield draft
                if (draft / MANIFEST).exists():
                    _commit(out)
            finally:
                discard(out)


def _commit(out: Path) -> None:
    """Replace the old results by the draft; an interrupt is obeyed as soon as that is done."""
    try:
        commit(out)
    except KeyboardInterrupt:
        complete(out)
        raise


def _require_lockable(out: Path) -> None:
    """Raise OutputError if a file of the user has the name of the lock, which is always empty."""
    lock = out / LOCK
    if lock.is_symlink() or (lock.exists() and (not lock.is_file() or lock.stat().st_size > 0)):
        raise _no_result(out, LOCK)


def _old_results(out: Path, overwrite: bool, resumed: Collection[str]) -> dict[str, int]:
    """Sizes [bytes] of the old results by path, including the manifest.

    Raises OutputError if `out` contains anything that no command has written, and if a command may
    not replace what is there.
    """
    manifest = read_manifest(out)
    listed = listed_files(manifest)
    if listed is None and _written_by_trackslip(manifest):
        version = manifest["versions"]["trackslip"]
        about = f"contains results of trackslip {version}, whose manifest lists no files"
        raise OutputError(f"out = {str(out)!r}: {about}; move them away")
    old = {} if listed is None else {**listed, MANIFEST: (out / MANIFEST).stat().st_size}
    unfinished = [name for name in UNFINISHED if os.path.lexists(out / name)]
    _require_listed(out, "", old)
    if old and not overwrite:
        raise OutputError(f"out = {str(out)!r}: contains results; --overwrite replaces them")
    if not overwrite and not set(unfinished) <= set(resumed):
        about = "contains work of an unfinished command, which the same command resumes"
        raise OutputError(f"out = {str(out)!r}: {about}; --overwrite deletes it")
    return old


def _written_by_trackslip(manifest: Mapping[str, Any]) -> bool:
    versions = manifest.get("versions")
    return isinstance(versions, Mapping) and "trackslip" in versions


def _require_listed(out: Path, folder: str, files: Mapping[str, int]) -> None:
    """Raise OutputError if a folder in `out` has anything but `files` and trackslip's own entries.

    Args:
        out: the folder of results.
        folder: the folder in `out`, "" for `out` itself.
        files: sizes [bytes] of all files of the results, by path in `out`.
    """
    folders = {str(parent) for path in files for parent in PurePosixPath(path).parents}
    with os.scandir(out / folder) as scanned:
        found = sorted(scanned, key=lambda entry: entry.name)
    for entry in found:
        path = f"{folder}/{entry.name}" if folder else entry.name
        if entry.is_file(follow_symlinks=False) and path in files:
            if entry.stat(follow_symlinks=False).st_size != files[path]:
                about = f"contains {path}, which has changed since a command wrote it"
                raise OutputError(f"out = {str(out)!r}: {about}; move it away")
        elif entry.is_dir(follow_symlinks=False) and path in folders:
            _require_writable(out / path)
            _require_listed(out, path, files)
        elif folder or not _is_own(entry):
            raise _no_result(out, path)


def _is_own(entry: os.DirEntry[str]) -> bool:
    """Whether an entry of a folder of results was made by trackslip for its own use."""
    if entry.name == LOCK:
        return True  # checked before it was locked
    if not entry.is_dir(follow_symlinks=False):
        return False
    if entry.name in UNFINISHED:
        files = os.listdir(entry.path)
        return all(UNFINISHED[entry.name].fullmatch(file) for file in files)
    return entry.name == DRAFT and is_ours(Path(entry.path))


def _require_writable(folder: Path) -> None:
    """Raise PermissionError if nothing can be replaced in a folder."""
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(13, os.strerror(13), str(folder))


def _no_result(out: Path, path: str) -> OutputError:
    about = f"contains {path}, which is no result of trackslip"
    return OutputError(f"out = {str(out)!r}: {about}; move it away, or choose another folder")
