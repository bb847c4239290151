"""Runs that have been driven: parts of an unfinished command, kept beside its results until those are complete.

A part holds the runs of a fleet: their rows as JSON, their logs as Parquet. A run is identified by its id, a hash of
everything its numbers depend on except code, models and libraries; those are recorded with its row.
"""

import contextlib
import io
import json
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import pyarrow
import pyarrow.parquet

from experiments.storage.manifest import changes, digest, made_by
from experiments.storage.plain_json import plain
from experiments.storage.results import MANIFEST_FILE, RUNS_FILE, SUMMARY_FILE, write_whole
from trackslip.errors import LogError, TrackslipError
from trackslip.logs.file_format import require_known_manifest
from trackslip.logs.logfile import StoredRuns, join_parquet, write_parquet
from trackslip.logs.runlog import RunLog

Row = dict[str, Any]


@dataclass(frozen=True)
class Part:
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
    file: Path
    """Where its log is, unless it failed."""
    made_by: dict[str, Any]
    """Code, models and libraries that drove it."""


@dataclass(frozen=True)
class _Record:
    """The content of a JSON file of rows."""

    logs: Path
    rows: list[Row]
    made_by: dict[str, Any]
    """Code, models and libraries by their digest."""


class Parts(dict[str, Stored]):
    """The driven runs in a folder of results, by their ids."""

    def __init__(self, out: Path, name: str) -> None:
        """Parts go to the folder `name` in `out`."""
        super().__init__()
        self._out, self._parts = out, out / name

    def take(self, ids: Collection[str], force: bool) -> None:
        """Find which of the runs `ids` are among the results or the parts. Failed runs are not: they are driven again.

        Raises TrackslipError if other code, models or libraries drove them, unless `force` is given; LogError if the
        results are damaged, or were written by a newer version.
        """
        self._require_readable()
        self._find(ids, [*self._results(), *self._records()])
        now = made_by()
        stale = [one.made_by for one in self.values() if one.made_by != now]
        if stale and not force:
            raise TrackslipError(
                f"out = {str(self._out)!r}: {len(stale)} of these runs were driven before a change of"
                f" {', '.join(changes(stale[0], now))}: --force takes them as they are, --no-resume drives them again"
            )

    def take_current(self, ids: Collection[str]) -> None:
        """Find which of the runs `ids` are among the parts; delete the parts driven by other code, and damaged ones."""
        now = digest(made_by())
        current = {record.logs.stem: record for record in self._records() if list(record.made_by) == [now]}
        self._delete(lambda file: file.stem not in current)
        self._find(ids, current.values())

    def keep(self, part: Part) -> None:
        """Store a part: its logs first, its rows last, each whole or not at all. Failed runs alone aren't stored.

        Raises TrackslipError if other code, models or libraries than this process's drove it.
        """
        now = made_by()
        if any(row["made_by"] != digest(now) for row in part.rows):
            raise TrackslipError("a worker has other code, models or libraries than this process")
        path = self._parts / f"{digest([row['id'] for row in part.rows])}.json"
        file = path.with_suffix(".parquet")
        if (logs := part.logs) is not None:
            rows = json.dumps({"made_by": {digest(now): now}, "runs": part.rows})
            try:
                write_whole(file, lambda draft: draft.write_bytes(logs))
                write_whole(path, lambda draft: draft.write_text(rows, encoding="utf-8"))
            except OSError:
                with contextlib.suppress(OSError):  # there are other parts
                    self._parts.rmdir()
                raise
        self.update({row["id"]: Stored(row, file, now) for row in part.rows})

    def gather(self, runs: Iterable[tuple[str, str]], file: Path) -> None:
        """Write the logs of runs, (id, new name) each, in order, to one file; without any log there is no file."""
        there = [(self[id], name) for id, name in runs]
        driven = [(one.file, one.row["run"], name) for one, name in there if one.row["error"] is None]
        if driven:
            join_parquet(driven, file)

    @property
    def made_by(self) -> dict[str, Any]:
        """Code, models and libraries that drove the runs, by their digest."""
        return {one.row["made_by"]: one.made_by for one in sorted(self.values(), key=lambda one: one.row["made_by"])}

    def discard(self, ids: Collection[str] | None = None) -> None:
        """Delete all parts, or those that hold none but the runs `ids`, which are now among the results."""
        done = {one.logs.stem for one in self._records() if ids and all(row["id"] in ids for row in one.rows)}
        self._delete(lambda file: ids is None or file.stem in done)

    def _delete(self, which: Callable[[Path], bool]) -> None:
        with contextlib.suppress(OSError):
            for file in self._parts.iterdir():
                if which(file):
                    file.unlink()
            self._parts.rmdir()

    def _find(self, ids: Collection[str], records: Iterable[_Record]) -> None:
        for record in records:
            there = [row for row in record.rows if row["id"] in ids and row["error"] is None]
            if there and not _is_whole(record.logs, {row["run"] for row in there}):
                if record.logs.parent == self._parts:
                    continue
                raise LogError(f"{record.logs}: damaged; --no-resume drives all runs again")  # the user decides
            self.update({row["id"]: Stored(row, record.logs, record.made_by[row["made_by"]]) for row in there})

    def _require_readable(self) -> None:
        """Raise LogError for results of a newer version, or with a damaged manifest or summary."""
        file = self._out / SUMMARY_FILE
        try:
            require_known_manifest(self._out)
            if (self._out / MANIFEST_FILE).exists() and file.exists():
                json.loads(file.read_text(encoding="utf-8"))
        except LogError as error:
            raise LogError(f"{error}; --no-resume replaces it") from error
        except (ValueError, RecursionError) as error:
            raise LogError(f"{file}: not JSON ({error}); --no-resume drives all runs again") from error

    def _results(self) -> Iterable[_Record]:
        if all((self._out / name).exists() for name in (MANIFEST_FILE, RUNS_FILE)):
            yield from _record(self._out / SUMMARY_FILE, self._out / RUNS_FILE)

    def _records(self) -> Iterable[_Record]:
        for path in sorted(self._parts.glob("*.json")):
            yield from _record(path, path.with_suffix(".parquet"))


def _record(path: Path, logs: Path) -> Iterable[_Record]:
    """The content of a file, if a sweep left it."""
    with contextlib.suppress(OSError, ValueError, RecursionError, LookupError, TypeError, AttributeError):
        content = json.loads(path.read_text(encoding="utf-8"))
        rows, by = content["runs"], content["made_by"]
        known = [{*row} >= {"run", "id", "error"} and "versions" in by[row["made_by"]] for row in rows]
        if all(known):
            yield _Record(logs, rows, by)


def _is_whole(file: Path, names: Iterable[str]) -> bool:
    """Whether all of a file can be read, and it has the runs of these names."""
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
