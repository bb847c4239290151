"""Driven runs of an unfinished command, kept in parts next to its results until these are complete.

A part holds the runs of a fleet: their rows as JSON, their logs as Parquet. A run is identified by its id, a hash of
everything its numbers depend on except code, models and libraries; those are recorded with its row.
"""

import contextlib
import io
import json
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import pyarrow
import pyarrow.parquet

from experiments.common.manifest import changes, digest, made_by
from experiments.common.plain_json import plain
from experiments.common.results import MANIFEST_FILE, RUNS_FILE, SUMMARY_FILE, write_whole
from trackslip.errors import LogError, TrackslipError
from trackslip.logs.file_format import known_manifest
from trackslip.logs.logfile import StoredRuns, join_parquet, write_parquet
from trackslip.logs.runlog import RunLog

Row = dict[str, Any]
"""A run and what was measured of it, by column; one that failed has but its name, id, axes, error and origin."""


@dataclass(frozen=True)
class StoredPart:
    """Runs that were driven together."""

    rows: list[Row]
    """Of each run its name (`run`), `id`, `error` (None unless it failed), `made_by`, and the command's own entries."""
    logs: bytes | None
    """Parquet file of the runs that did not fail, if any."""

    @classmethod
    def of(cls, rows: Iterable[Row], logs: Sequence[RunLog]) -> Self:
        """Rows, and the logs of those that did not fail."""
        file = io.BytesIO()
        if logs:
            write_parquet(logs, file)
        made = digest(made_by())
        return cls([plain(row) | {"made_by": made} for row in rows], file.getvalue() or None)


@dataclass(frozen=True)
class Stored:
    """A run that has been driven, or has failed."""

    row: Row
    logs: Path
    """The file with its log, unless it failed."""
    made_by: dict[str, Any]
    """Code, models and libraries that drove it."""


class StoredParts(dict[str, Stored]):
    """The driven runs in a folder of results, by their ids."""

    def __init__(self, out: Path, name: str) -> None:
        """Parts go to the folder `name` in `out`."""
        super().__init__()
        self._out, self._folder = out, out / name

    def take(self, ids: Collection[str], force: bool) -> None:
        """Find which of the runs `ids` are among the results or the parts. Failed runs are not: they are driven again.

        Raises TrackslipError if other code, models or libraries drove them, unless `force` is given; LogError if the
        results are damaged, or were written by a newer version.
        """
        self._require_readable()
        file = self._out / RUNS_FILE
        if file.exists() and (self._out / MANIFEST_FILE).exists():
            there = _wanted(_rows(self._out / SUMMARY_FILE, file), ids)
            if there and not _is_whole(file, there):  # the user decides
                raise LogError(f"{file}: damaged; --no-resume drives all runs again")
            self.update(there)
        self._take_parts(ids)
        now = made_by()
        stale = [one.made_by for one in self.values() if one.made_by != now]
        if stale and not force:
            raise TrackslipError(
                f"out = {str(self._out)!r}: {len(stale)} of these runs were driven before a change of"
                f" {', '.join(changes(stale[0], now))}: --force takes them as they are, --no-resume drives them again"
            )

    def take_current(self, ids: Collection[str]) -> None:
        """Find which of the runs `ids` the present code, models and libraries drove, among the parts."""
        self._take_parts(ids)
        now = made_by()
        for id in [id for id, one in self.items() if one.made_by != now]:
            del self[id]

    def _take_parts(self, ids: Collection[str]) -> None:
        for path, rows in self._parts():
            there = _wanted(rows, ids)
            if there and _is_whole(path.with_suffix(".parquet"), there):
                self.update(there)

    def keep(self, part: StoredPart) -> None:
        """Store a part: its logs first, its rows last, each whole or not at all. Failed runs alone aren't stored.

        Raises TrackslipError if other code, models or libraries than this process's drove it.
        """
        now = made_by()
        if any(row["made_by"] != digest(now) for row in part.rows):
            raise TrackslipError("a worker has other code, models or libraries than this process")
        path = self._folder / f"{digest([row['id'] for row in part.rows])}.json"
        file = path.with_suffix(".parquet")
        if (logs := part.logs) is not None:
            content = {"made_by": {digest(now): now}, "runs": part.rows}
            rows = json.dumps(content | {"digest": digest(content)})
            try:
                write_whole(file, lambda draft: draft.write_bytes(logs))
                write_whole(path, lambda draft: draft.write_text(rows, encoding="utf-8"))
            except OSError:
                with contextlib.suppress(OSError):  # there are other parts
                    self._folder.rmdir()
                raise
        self.update({row["id"]: Stored(row, file, now) for row in part.rows})

    def gather(self, runs: Iterable[tuple[str, str]], file: Path) -> None:
        """Write the logs of runs, (id, new name) each, in order, to one file; without any log there is no file."""
        there = [(self[id], name) for id, name in runs]
        driven = [(one.logs, one.row["run"], name) for one, name in there if one.row["error"] is None]
        if driven:
            join_parquet(driven, file)

    @property
    def made_by(self) -> dict[str, Any]:
        """Code, models and libraries that drove the runs, by their digest."""
        return {one.row["made_by"]: one.made_by for one in sorted(self.values(), key=lambda one: one.row["made_by"])}

    def discard(self, ids: Collection[str]) -> None:
        """Delete the parts, but those of the present code with runs other than `ids`: another sweep resumes them."""
        now = made_by()
        others = ((path, one) for path, runs in self._parts() for one in runs if one.row["id"] not in ids)
        kept = {path.stem for path, one in others if one.made_by == now}
        with contextlib.suppress(OSError):
            for file in self._folder.iterdir():
                if file.stem not in kept:
                    file.unlink()
            self._folder.rmdir()

    def _require_readable(self) -> None:
        """Raise LogError for results of a newer version, or with a damaged manifest or summary."""
        file = self._out / SUMMARY_FILE
        try:
            known_manifest(self._out)
            if (self._out / MANIFEST_FILE).exists() and file.exists():
                json.loads(file.read_text(encoding="utf-8"))
        except LogError as error:
            raise LogError(f"{error}; --no-resume replaces it") from error
        except (ValueError, RecursionError) as error:
            raise LogError(f"{file}: not JSON ({error}); --no-resume drives all runs again") from error

    def _parts(self) -> Iterator[tuple[Path, list[Stored]]]:
        """The files of rows, and the runs in them."""
        for path in sorted(self._folder.glob("*.json")):
            yield path, _rows(path, path.with_suffix(".parquet"))


def _rows(path: Path, logs: Path) -> list[Stored]:
    """The runs in a file of rows; none if no sweep left it."""
    with contextlib.suppress(OSError, ValueError, RecursionError, LookupError, TypeError, AttributeError):
        content = json.loads(path.read_text(encoding="utf-8"))
        if content.pop("digest", None) not in (None, digest(content)):  # a summary has none
            return []
        rows, by = content["runs"], content["made_by"]
        if all(_is_row(row) and "versions" in by[row["made_by"]] for row in rows):
            return [Stored(row, logs, by[row["made_by"]]) for row in rows]
    return []


def _is_row(row: Row) -> bool:
    """True if a row has texts, or nothing where it may, for what every run is told by."""
    told = [row["run"], row["id"], row["error"] or "", row.get("note") or ""]
    return all(isinstance(one, str) for one in told)


def _wanted(rows: Iterable[Stored], ids: Collection[str]) -> dict[str, Stored]:
    """The runs `ids` that did not fail, by id."""
    return {one.row["id"]: one for one in rows if one.row["id"] in ids and one.row["error"] is None}


def _is_whole(file: Path, runs: dict[str, Stored]) -> bool:
    """True if a whole file can be read and has these runs."""
    try:
        with pyarrow.parquet.ParquetFile(file, page_checksum_verification=True) as stored:
            for group in range(stored.num_row_groups):
                stored.read_row_group(group)
        names = StoredRuns(file)
        for one in runs.values():
            names.metadata(one.row["run"])
    except (OSError, pyarrow.ArrowException, LogError):
        return False
    return True
