"""Replacement of a results folder's files by new ones: all or none, even if the process is killed.

New files are written to the subfolder DRAFT. To commit them, it is renamed to MOVING, which is the
one step that decides: before it, the old results are whole; after it, the new ones are, partly in
MOVING. `complete` then moves the new files into the folder, the manifest last, and deletes the old
files and what an unfinished command left. It can be killed at any file operation, and called again.

Only files that a command of trackslip has written are ever deleted: those that the old manifest
lists, with the listed size. Symbolic links are neither followed nor deleted.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, Final, TypeGuard

from filelock import FileLock, Timeout

from trackslip.errors import OutputError

MANIFEST: Final = "manifest.json"
"""File in a folder of results with everything needed to repeat them."""
DRAFT: Final = ".draft"
"""Subfolder with the new files of a command that has not ended."""
MOVING: Final = ".moving"
"""Subfolder with the new files that are complete and have yet to be moved."""
STORE: Final = ".runs"
"""Subfolder with the work of an unfinished command: a sweep's runs, or a training's checkpoint."""
LOCK: Final = ".lock"
"""File that a command locks while it writes to the folder; always empty."""
JOURNAL: Final = ".replaced.json"
"""File in DRAFT and MOVING with the sizes of the old files; it marks both folders as ours."""
FILES: Final = "files"
"""Key of a manifest with the sizes [bytes] of all other files of the results, by path."""

SWEEP_FILE: Final = re.compile(r"[0-9a-f]{32}\.(json|parquet)")
"""Names of a sweep's files in STORE: a hash of their runs."""
CHECKPOINT_FILE: Final = re.compile(r"checkpoint\.npz")
"""Name of a training's file in STORE."""
DRAFT_FILE: Final = re.compile(r"\.draft-\d+-\d+")
"""Names of the drafts from which files in STORE are made."""
# a reader waits so long for a command that is moving its results, which takes milliseconds [s]
PATIENCE: Final = 10.0


def entries(folder: Path) -> Iterator[tuple[str, os.stat_result]]:
    """Everything in a folder, with its path in there and its own status: links aren't followed.

    A subfolder comes after its contents, so that it can be deleted when its contents are.
    """
    with os.scandir(folder) as scanned:
        found = sorted(scanned, key=lambda entry: entry.name)
    for entry in found:
        if entry.is_dir(follow_symlinks=False):
            for path, status in entries(Path(entry.path)):
                yield f"{entry.name}/{path}", status
        yield entry.name, entry.stat(follow_symlinks=False)


def sizes(folder: Path) -> dict[str, int]:
    """Sizes [bytes] of the regular files in a folder and its subfolders, by path."""
    return {path: status.st_size for path, status in entries(folder) if is_file(status)}


def is_file(status: os.stat_result) -> bool:
    """Whether a status is that of a regular file."""
    return stat.S_ISREG(status.st_mode)


def listed_files(manifest: Any) -> dict[str, int] | None:
    """Sizes [bytes] of the files that a manifest lists, by path; None if trackslip didn't write it.

    The list doesn't include the manifest.
    """
    if not isinstance(manifest, Mapping) or not isinstance(manifest.get("versions"), Mapping):
        return None
    if "command" not in manifest or "trackslip" not in manifest["versions"]:
        return None
    files = manifest.get(FILES)
    return dict(files) if _are_sizes(files) else None


def is_ours(folder: Path) -> bool:
    """Whether a DRAFT or MOVING is there and made by trackslip: it is empty or has the journal."""
    if not os.path.lexists(folder) or not _is_folder(folder):
        return False
    names = os.listdir(folder)
    return not names or JOURNAL in names


def begin(folder: Path, replaced: Mapping[str, int]) -> Path:
    """Make an empty DRAFT in a folder whose old files have the sizes `replaced`; returns its path.

    Raises OSError if it can't be written, or if the last command's draft can't be deleted.
    """
    draft = folder / DRAFT
    discard(folder)
    draft.mkdir()
    (draft / JOURNAL).write_text(json.dumps(replaced), encoding="utf-8")
    return draft


def discard(folder: Path) -> None:
    """Delete the DRAFT in a folder, if there is one; its journal goes last, as it marks it as ours.

    Raises OSError if a file can't be deleted.
    """
    draft = folder / DRAFT
    if not draft.exists():
        return
    for path, status in entries(draft):
        if stat.S_ISDIR(status.st_mode):
            os.rmdir(draft / path)
        elif path != JOURNAL:
            os.unlink(draft / path)
    (draft / JOURNAL).unlink(missing_ok=True)
    os.rmdir(draft)


def commit(folder: Path) -> None:
    """Replace the old files in a folder by those in its DRAFT, which must include a manifest.

    The manifest gets a list of the other files.

    Raises:
        OutputError: if a new file would replace something that isn't one of the old files; nothing
            is moved then.
        OSError: if a file can't be moved or deleted.
    """
    draft = folder / DRAFT
    replaced = _journal(draft)
    new = sizes(draft)
    del new[JOURNAL], new[MANIFEST]
    _require_free(folder, new, replaced)
    manifest = {**_json(draft / MANIFEST), FILES: new}
    (draft / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    os.rename(draft, folder / MOVING)
    complete(folder)


def amend(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Replace the manifest of a folder's results, whose other files stay. Raises OSError if that
    fails.
    """
    draft = begin(folder, {})
    text = json.dumps(manifest, indent=2) + "\n"
    (draft / MANIFEST).write_text(text, encoding="utf-8")
    os.replace(draft / MANIFEST, folder / MANIFEST)
    discard(folder)


def discard_abandoned(folder: Path) -> None:
    """Delete the DRAFT that a killed command left in a folder, which must be locked."""
    if is_ours(folder / DRAFT):
        discard(folder)


def complete(folder: Path) -> None:
    """Complete a replacement in a folder that a killed command began to move, if there is one.

    Raises:
        OutputError: if files of somebody else are in the way.
        OSError: if a file can't be moved or deleted.
    """
    moving = folder / MOVING
    if not is_ours(moving):
        return
    if not os.listdir(moving):  # all is done
        os.rmdir(moving)
        return
    replaced = _journal(moving)
    new = sizes(moving)
    del new[JOURNAL]
    _require_free(folder, new, replaced)
    # readers take the folder's files for results of the manifest, so it goes last
    for path in sorted(new, key=lambda path: path == MANIFEST):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        os.replace(moving / path, folder / path)
    kept = {MANIFEST, *(listed_files(_json(folder / MANIFEST)) or {})}
    _delete(folder, {path: size for path, size in replaced.items() if path not in kept})
    delete_store(folder)
    for path, status in entries(moving):
        if stat.S_ISDIR(status.st_mode):
            os.rmdir(moving / path)
    os.unlink(moving / JOURNAL)
    os.rmdir(moving)


def complete_for_reading(folder: Path) -> None:
    """Complete a replacement before a folder is read, unless its command still runs.

    Raises OutputError if that isn't possible.
    """
    if not is_ours(folder / MOVING):
        return
    try:
        with locked(folder, str(folder), PATIENCE):
            complete(folder)
            (folder / LOCK).unlink()
    except OutputError:
        raise
    except OSError as error:
        reason = f"its new results can't be moved into place ({error.strerror})"
        raise OutputError(f"{folder}: {reason}") from error


@contextlib.contextmanager
def locked(folder: Path, what: str, patience: float = 0.0) -> Iterator[None]:
    """Keep other commands out of a folder. However the process ends, its lock is released.

    The file LOCK stays, unless the block deletes it at its end.

    Raises OutputError, which calls the folder `what`, if a command holds it for longer than
    `patience` [s], and OSError if nothing can be written there.
    """
    lock = FileLock(folder / LOCK, timeout=patience)
    try:
        lock.acquire()
    except Timeout as error:
        raise OutputError(f"{what}: another command is writing there") from error
    try:
        yield
    finally:
        lock.release()


def is_stored_file(name: str) -> bool:
    """Whether a file in STORE with this name was written by a command."""
    return any(p.fullmatch(name) for p in (SWEEP_FILE, CHECKPOINT_FILE, DRAFT_FILE))


def delete_store(folder: Path) -> None:
    """Delete the STORE in a folder, if there is one. Raises OSError if that fails."""
    store = folder / STORE
    if not store.is_dir() or store.is_symlink():
        return
    for name in sorted(os.listdir(store)):
        if is_stored_file(name):
            os.unlink(store / name)
    with contextlib.suppress(OSError):  # somebody put a file of his own there
        os.rmdir(store)


def _require_free(folder: Path, new: Mapping[str, int], replaced: Mapping[str, int]) -> None:
    """Raise OutputError unless all files in `new` can be moved to places that are free or old."""
    for path in new:
        for parent in reversed(PurePosixPath(path).parents[:-1]):
            if os.path.lexists(folder / parent) and not _is_folder(folder / parent):
                raise OutputError(f"{folder / parent}: must be a folder, for the new {path}")
        place = folder / path
        if path in replaced or path == MANIFEST or not os.path.lexists(place):
            continue
        raise OutputError(f"{place}: appeared while the command ran; move it away")


def _is_folder(path: Path) -> bool:
    return stat.S_ISDIR(path.lstat().st_mode)


def _is_empty_folder(path: Path) -> bool:
    return _is_folder(path) and not os.listdir(path)


def _are_sizes(files: Any) -> TypeGuard[Mapping[str, int]]:
    return isinstance(files, Mapping) and all(type(size) is int for size in files.values())


def _journal(folder: Path) -> dict[str, int]:
    """Sizes [bytes] of the old files, by path, from the journal in DRAFT or MOVING."""
    replaced = _json(folder / JOURNAL)
    if not _are_sizes(replaced):
        raise OutputError(f"{folder / JOURNAL}: damaged; move {folder.name} away")
    return dict(replaced)


def _json(path: Path) -> Any:
    """A JSON file that a command wrote. Raises OutputError if it isn't one."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise OutputError(f"{path}: damaged; move it away") from error


def _delete(folder: Path, files: Mapping[str, int]) -> None:
    """Delete files with these sizes in a folder, and the subfolders that this leaves empty."""
    folders = {str(parent) for path in files for parent in PurePosixPath(path).parents[:-1]}
    for path, status in list(entries(folder)):
        if is_file(status) and files.get(path) == status.st_size:
            os.unlink(folder / path)
        elif path in folders and _is_empty_folder(folder / path):
            os.rmdir(folder / path)  # comes after its contents
