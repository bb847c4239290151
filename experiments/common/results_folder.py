"""The folder of a command's results: checked before anything is done, replaced as a whole."""

import contextlib
import os
import re
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from experiments.common.leftovers import temporary, undone
from experiments.common.manifest import RECORDING
from experiments.common.results import new_folders, output_errors
from trackslip.errors import OutputError
from trackslip.files import read_manifest
from trackslip.replacement import (
    DRAFT,
    DRAFT_FILE,
    LOCK,
    MANIFEST,
    MOVING,
    STORE,
    amend,
    begin,
    commit,
    complete,
    discard,
    discard_abandoned,
    is_ours,
    is_stored_file,
    listed_files,
    locked,
)


@contextlib.contextmanager
def results_folder(
    out: Path, overwrite: bool, resumed: re.Pattern[str] = DRAFT_FILE
) -> Iterator[Path]:
    """A folder to write results into, which are moved to `out` when the block ends, or deleted if
    it fails.

    `out` must be new or empty or, with `overwrite`, contain nothing but a command's results, which
    are replaced. It may also contain what an unfinished command left in STORE, which is deleted
    with the old results; without `overwrite`, all its files must have names as in `resumed`, those
    that this command takes up. No other command can write to `out` during the block. If the block
    writes no manifest, nothing is replaced.

    Raises OutputError before the block starts if `out` can't be used, and later if the disk is
    full. However the process ends, `out` has the whole old results, or the whole new ones, which
    the next command moves into place (`trackslip.replacement`).
    """
    what = f"out = {str(out)!r}"
    with output_errors(what), new_folders(out):
        _require_lockable(out)
        with locked(out, what), temporary(out / LOCK):
            complete(out)
            discard_abandoned(out)
            replaced = _old_results(out, overwrite, resumed)
            with undone(partial(_tidy, out)):
                draft = begin(out, replaced)
                yield draft
                if (draft / MANIFEST).exists():
                    commit(out)


def manifest_of(out: Path) -> Mapping[str, Any]:
    """The manifest of the results in a folder; empty if there are none.

    What a killed command left is completed or deleted before. Raises OutputError as
    `results_folder` does if that isn't possible, and LogError for a damaged manifest.
    """
    if not out.is_dir() or not ((out / MANIFEST).is_file() or is_ours(out / MOVING)):
        return {}
    what = f"out = {str(out)!r}"
    with output_errors(what):
        _require_lockable(out)
        with locked(out, what), temporary(out / LOCK):
            complete(out)
            discard_abandoned(out)
            return read_manifest(out)


def amend_manifest(out: Path, recording: str, added: Mapping[str, Any]) -> None:
    """Add entries to the manifest of a run's results, if it has the id of this `recording`:
    otherwise another command has replaced them, or none were written.

    Raises OutputError if it can't be written.
    """
    if not (out / MANIFEST).is_file():
        return
    with output_errors(str(out)), locked(out, str(out)), temporary(out / LOCK):
        manifest = read_manifest(out)
        if manifest.get(RECORDING) == recording:
            amend(out, {**manifest, **added})


def _tidy(out: Path) -> None:
    """Complete a replacement that an interrupt has stopped, or discard the draft."""
    complete(out)
    discard(out)


def _require_lockable(out: Path) -> None:
    """Raise OutputError if a file of the user has the name of the lock, which is always empty."""
    lock = out / LOCK
    if lock.is_symlink() or (lock.exists() and (not lock.is_file() or lock.stat().st_size > 0)):
        raise _no_result(out, LOCK)


def _old_results(out: Path, overwrite: bool, resumed: re.Pattern[str]) -> dict[str, int]:
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
    _require_listed(out, "", old)
    if old and not overwrite:
        raise OutputError(f"out = {str(out)!r}: contains results; --overwrite replaces them")
    stored = os.listdir(out / STORE) if (out / STORE).is_dir() else []
    kept = [name for name in stored if not (resumed.fullmatch(name) or DRAFT_FILE.fullmatch(name))]
    if kept and not overwrite:
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
    if entry.name == STORE:
        return all(is_stored_file(name) for name in os.listdir(entry.path))
    return entry.name == DRAFT and is_ours(Path(entry.path))


def _require_writable(folder: Path) -> None:
    """Raise PermissionError if nothing can be replaced in a folder."""
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(13, os.strerror(13), str(folder))


def _no_result(out: Path, path: str) -> OutputError:
    about = f"contains {path}, which is no result of trackslip"
    return OutputError(f"out = {str(out)!r}: {about}; move it away, or choose another folder")
