"""What is driven of a sweep: its results, and beside them the parts of one that isn't finished."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.parquet

from experiments.storage.manifest import changes, digest, made_by
from experiments.storage.plain_json import plain
from experiments.storage.results import MANIFEST_FILE, RUNS_FILE, SUMMARY_FILE
from experiments.sweep.drive import Part
from experiments.sweep.plan import Run
from experiments.sweep.table import is_row
from trackslip.errors import LogError, TrackslipError
from trackslip.logs.file_format import require_known_manifest
from trackslip.logs.logjoin import StoredRuns, join_parquet

PARTS = ".grid-parts"


@dataclass(frozen=True)
class Stored:
    """A run that has been driven, or has failed."""

    row: dict[str, Any]
    file: Path
    """Where its log is, unless it failed."""
    made_by: dict[str, Any]
    """Code, models and libraries that drove it."""

    @property
    def failed(self) -> bool:
        """Whether there is no log."""
        return self.row["error"] is not None


class Archive:
    """The runs in a folder of results."""

    def __init__(self, out: Path) -> None:
        self._out, self._parts = out, out / PARTS
        self._there: dict[str, Stored] = {}

    def take(self, runs: Sequence[Run], force: bool) -> None:
        """Look what is there of `runs` already. Runs that failed aren't: they are driven again.

        Raises:
            TrackslipError: when it was driven by other code, models or libraries, unless by `force`.
            LogError: when it is damaged, or a newer version's.
        """
        self._require_readable()
        wanted = {run.id for run in runs}
        for file, rows, by in self._records():
            there = [row for row in rows if row["id"] in wanted and row["error"] is None]
            if there and not _whole(file, {row["run"] for row in there}):
                if file.parent == self._parts:
                    continue
                raise LogError(f"{file}: damaged; --no-resume drives all runs anew")  # the user's to judge
            self._there |= {row["id"]: Stored(row, file, by[row["made_by"]]) for row in there}
        now = made_by()
        stale = [one.made_by for one in self._there.values() if one.made_by != now]
        if stale and not force:
            raise TrackslipError(
                f"out = {str(self._out)!r}: {len(stale)} of these runs are there, driven before a change of"
                f" {', '.join(changes(stale[0], now))}: --force takes them as they are, --no-resume drives them anew"
            )

    def missing(self, runs: Sequence[Run]) -> list[Run]:
        """Those of `runs` that are neither there nor have failed."""
        return [run for run in runs if run.id not in self._there]

    def keep(self, part: Part) -> None:
        """Store a part: its runs first, its rows last, each whole or not at all. One of failed runs alone isn't stored.

        Raises:
            TrackslipError: when other code, models or libraries than ours drove it.
        """
        now = made_by()
        if part.made_by != digest(now):
            raise TrackslipError("a worker has other code, models or libraries than this process")
        rows: list[dict[str, Any]] = plain([row | {"made_by": part.made_by} for row in part.rows])
        path = self._parts / f"{digest([row['id'] for row in rows])}.json"
        file = path.with_suffix(".parquet")
        if part.runs is not None:
            try:
                self._parts.mkdir(parents=True, exist_ok=True)
                _put(file, part.runs)
                _put(path, json.dumps({"made_by": {part.made_by: now}, "runs": rows}).encode())
            except OSError:
                with contextlib.suppress(OSError):  # there are other parts
                    self._parts.rmdir()
                raise
        self._there |= {row["id"]: Stored(row, file, now) for row in rows}

    def rows(self, runs: Sequence[Run]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
        """The rows of all `runs`, in order, failed ones too, and by what they were made, by its digest."""
        there = [self._there[run.id] for run in runs]
        rows = [_renamed(one.row, run.name) | {**run.axes} for run, one in zip(runs, there, strict=True)]
        by = {one.row["made_by"]: one.made_by for one in there}
        return rows, {key: by[key] for key in sorted(by)}

    def gather(self, runs: Sequence[Run], file: Path) -> None:
        """Write the logs of `runs`, in order, to one file."""
        there = [(self._there[run.id], run.name) for run in runs]
        join_parquet([(one.file, one.row["run"], name) for one, name in there if not one.failed], file)

    def discard(self) -> None:
        """Delete the parts, what is wanted of them being now among the results."""
        with contextlib.suppress(OSError):
            for file in self._parts.iterdir():
                file.unlink()
            self._parts.rmdir()

    def _require_readable(self) -> None:
        """Raise LogError for results of a newer version, or whose manifest or summary is damaged."""
        file = self._out / SUMMARY_FILE
        try:
            require_known_manifest(self._out)
            if (self._out / MANIFEST_FILE).exists() and file.exists():
                json.loads(file.read_text(encoding="utf-8"))
        except LogError as error:
            raise LogError(f"{error}; --no-resume replaces it") from error
        except (ValueError, RecursionError) as error:
            raise LogError(f"{file}: not JSON ({error}); --no-resume drives all runs anew") from error

    def _records(self) -> Iterable[tuple[Path, list[dict[str, Any]], dict[str, Any]]]:
        """File of runs, rows and by what they were made, of the results and of every whole part."""
        record = _record(self._out / SUMMARY_FILE)
        if record is not None and all((self._out / name).exists() for name in (MANIFEST_FILE, RUNS_FILE)):
            yield self._out / RUNS_FILE, *record
        for path in sorted(self._parts.glob("*.json")):
            with contextlib.suppress(LogError):
                record = _record(path)
                if record is not None:
                    yield path.with_suffix(".parquet"), *record


def _record(path: Path) -> tuple[list[dict[str, Any]], dict[str, Any]] | None:
    """Rows and by what they were made, if a sweep has left them here; raises LogError when they are damaged."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        rows, by = content["runs"], content["made_by"]
    except (OSError, ValueError, RecursionError, KeyError, TypeError):  # another command's, or none
        return None
    makers = isinstance(by, dict) and all(
        isinstance(one, dict) and isinstance(one.get("versions"), dict) for one in by.values()
    )
    if not (makers and isinstance(rows, list) and all(is_row(row) and row["made_by"] in by for row in rows)):
        raise LogError(f"{path}: its rows of runs are damaged; --no-resume drives all runs anew")
    return rows, by


def _renamed(row: dict[str, Any], name: str) -> dict[str, Any]:
    """The row of a run that has another name in this sweep; its note speaks of it."""
    note = {"note": row["note"].replace(repr(row["run"]), repr(name))} if row.get("note") else {}
    return row | {"run": name} | note


def _whole(file: Path, names: Iterable[str]) -> bool:
    """Whether all of a file can be read, and whether the runs of these names are in it."""
    try:
        with pyarrow.parquet.ParquetFile(file, page_checksum_verification=True) as runs:
            for group in range(runs.num_row_groups):
                runs.read_row_group(group)
        stored = StoredRuns(file)
        for name in names:
            stored.metadata(name)
    except (OSError, pyarrow.ArrowException, LogError):
        return False
    return True


def _put(path: Path, content: bytes) -> None:
    """A file, whole or not at all."""
    draft = path.with_name(f".{path.name}-{os.getpid()}")
    try:
        draft.write_bytes(content)
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)
