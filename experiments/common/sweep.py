"""Sweeps: runs are driven fleet by fleet on any workers and stored as they finish, so that a killed
command can resume.

The store has a JSON file of rows and a Parquet file of logs per fleet. The JSON file has digests of
both, and files that differ from them count as missing. A run's id hashes everything but the code.
"""

import contextlib
import hashlib
import io
import itertools
import json
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from experiments.common.manifest import content, digest
from experiments.common.plain_json import plain
from experiments.common.pool import WorkersFailedError, processors, workers
from experiments.common.progress import progress
from experiments.common.results import write_whole
from experiments.common.run import Run
from sim.runs.loop import Progress
from sim.runs.stopwatch import StepTimes, Stopwatch
from trackslip.errors import OutputError, TrackslipError, counted
from trackslip.files import read_text
from trackslip.logs.logfile import join_parquet, write_parquet
from trackslip.logs.runlog import RunLog
from trackslip.replacement import STORE, SWEEP_FILE

# fewest fleets per worker, so that workers finish together, unless fleets would be too small
_EACH: Final = 4
# simulated time of a fleet, summed over robots, above which starting another worker pays off [s]
_LONG: Final = 2_000.0
# longest simulated time of a fleet, summed over robots, whose logs fit into memory [s]
_AT_ONCE: Final = 20_000.0

STEPS: Final = "steps"
"""Column with the `StepTimes` of a run that was timed. They differ each time that it is driven."""

Row = dict[str, Any]
"""Data on a run by column: its name `run`, `id`, `error` (None unless the run failed), and
measurements.
"""


class Planned(Protocol):
    """A planned run in a sweep."""

    @property
    def name(self) -> str:
        """Name of the run in the results."""

    @property
    def id(self) -> str:
        """Hash of everything that the run's numbers depend on, except the code."""

    @property
    def axes(self) -> Mapping[str, Any]:
        """Values that differ within the sweep, by axis name."""

    @property
    def fleet(self) -> str:
        """A key shared by runs that can be driven together and last equally long."""

    @property
    def duration(self) -> float:
        """Simulated time [s]."""


RunT = TypeVar("RunT", bound=Planned)
KindRunT = TypeVar("KindRunT", bound=Planned, contravariant=True)


class RunKind(Protocol[KindRunT]):
    """How a sweep drives and measures its runs; pickled for the workers."""

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of robots in the smallest and the largest fleet worth driving."""

    def drive(
        self, runs: Sequence[KindRunT], watch: Stopwatch, progress: Progress | None
    ) -> Sequence[RunLog]:
        """Drive runs as one fleet; `progress`, None in worker processes, is called with simulated
        seconds.
        """

    def measure(self, run: KindRunT, log: RunLog) -> Row:
        """Measurements from a run that didn't fail, by column."""


class Store:
    """Rows and logs of finished runs by id, kept in the STORE of a results folder."""

    def __init__(self, out: Path, ids: Collection[str], anew: bool) -> None:
        """Load the stored rows with these `ids`, except those of failed runs; with `anew`, load
        nothing.

        Raises OutputError if the store has runs with other ids, which would be lost.
        """
        self.rows: dict[str, Row] = {}
        self._folder = out / STORE
        self._logs = dict[str, Path]()
        for file in () if anew else sorted(self._folder.glob("*.json")):
            finished = [row for row in _stored_rows(file) if row["error"] is None]
            others = [row for row in finished if row["id"] not in ids]
            if others:
                about = f"contains {counted(len(others), 'run')} of other options"
                how = "which these options resume; --overwrite deletes them"
                raise OutputError(f"out = {str(out)!r}: {about}, {how}")
            self._add(finished, file)

    def keep(self, rows: Sequence[Row], logs: bytes | None = None) -> None:
        """Store rows and the Parquet file of their logs: logs first, then rows, each file
        completely or not at all.

        If all runs failed, nothing is written, so that a resumed command drives them again.
        """
        file = self._folder / f"{digest([row['id'] for row in rows])}.json"
        if any(row["error"] is None for row in rows):
            if logs is not None:
                write_whole(file.with_suffix(".parquet"), lambda draft: draft.write_bytes(logs))
            sha256 = None if logs is None else hashlib.sha256(logs).hexdigest()
            stored = {"rows": rows, "logs": sha256, "digest": digest([rows, sha256])}
            write_whole(file, lambda draft: draft.write_text(json.dumps(stored), encoding="utf-8"))
        self._add(rows, file)

    def gather(self, runs: Iterable[Planned], file: Path) -> None:
        """Write the logs of runs, in order, to one file; if there are no logs, no file is
        written.
        """
        driven = [run for run in runs if self.rows[run.id]["error"] is None]
        if driven:
            parts = [(self._logs[run.id], self.rows[run.id]["run"], run.name) for run in driven]
            join_parquet(parts, file)

    def _add(self, rows: Iterable[Row], file: Path) -> None:
        for row in rows:
            self.rows[row["id"]] = row
            self._logs[row["id"]] = file.with_suffix(".parquet")


def _stored_rows(file: Path) -> list[Row]:
    """The rows in a file that `Store.keep` wrote; none if it or its logs are missing, damaged or
    from another program, so that its runs are driven again.
    """
    try:
        stored = json.loads(read_text(file)) if file.is_file() else None
        if not isinstance(stored, dict) or stored.keys() != {"rows", "logs", "digest"}:
            return []
        rows: list[Row] = stored["rows"]
        if stored["digest"] != digest([rows, stored["logs"]]):
            return []
        return rows if stored["logs"] == content(file.with_suffix(".parquet")) else []
    except (OSError, ValueError, RecursionError):
        return []


@dataclass(frozen=True)
class DrivenFleet:
    """Results from runs that were driven together."""

    rows: list[Row]
    logs: bytes | None
    """Parquet file of the runs that did not fail, if any."""
    stages: Mapping[str, float]
    """Computing time by stage [s]."""


def drive_fleet(
    kind: RunKind[RunT], runs: Sequence[RunT], report: Progress | None = None
) -> DrivenFleet:
    """Drive and measure a fleet and isolate runs that fail; `report` is called with seconds, summed
    over robots.
    """
    watch = Stopwatch()

    def drive(some: Sequence[RunT]) -> Sequence[RunLog]:
        return kind.drive(some, watch, report and (lambda seconds: report(seconds * len(some))))

    outcomes = _isolating(runs, drive)
    with watch.stage("measuring"):
        rows = [
            _row(kind, run, outcome, watch.steps.get(run.name))
            for run, outcome in zip(runs, outcomes, strict=True)
        ]
    with watch.stage("storing"):
        file = io.BytesIO()
        logs = [outcome for outcome in outcomes if isinstance(outcome, RunLog)]
        if logs:
            write_parquet(logs, file)
    return DrivenFleet(plain(rows), file.getvalue() or None, watch.stages)


def _isolating(
    runs: Sequence[RunT], drive: Callable[[Sequence[RunT]], Sequence[RunLog]]
) -> list[RunLog | BaseException]:
    """Drive runs as one fleet; if it fails, drive its halves, until each failing run is driven
    alone.
    """
    try:
        return list(drive(runs))
    except (Exception, SystemExit) as error:  # a user's controller may raise anything
        if len(runs) == 1:
            return [error]
    middle = len(runs) // 2
    return _isolating(runs[:middle], drive) + _isolating(runs[middle:], drive)


def _row(
    kind: RunKind[RunT],
    run: RunT,
    outcome: RunLog | BaseException,
    steps: Sequence[float] | None,
) -> Row:
    about = {"run": run.name, "id": run.id, **run.axes, "error": None}
    if steps:  # even of a run that failed
        about[STEPS] = vars(StepTimes.of(steps))
    if isinstance(outcome, RunLog):
        return about | dict(kind.measure(run, outcome))
    reason = str(outcome)
    if not isinstance(outcome, TrackslipError):
        reason = f"{type(outcome).__name__}: {outcome}"
    return about | {"error": " ".join(reason.split())}


def fleets(runs: Sequence[RunT], workers: int, sizes: tuple[int, int]) -> list[tuple[RunT, ...]]:
    """Split runs into fleets that can be driven together, sized within `sizes` for the workers,
    longest first.
    """
    least, most = sizes
    for_workers = math.ceil(len(runs) / (_EACH * workers))
    size = min(max(least, for_workers), most)
    alike: dict[str, list[RunT]] = {}
    for run in runs:
        alike.setdefault(run.fleet, []).append(run)
    split = []
    for same in alike.values():
        duration = same[0].duration
        in_memory = max(1, int(_AT_ONCE / duration))
        count = math.ceil(len(same) / min(size, in_memory))
        # more fleets, where another worker pays off
        workers_each = math.ceil(workers / len(alike))
        paying = int(len(same) * duration / _LONG)
        count = max(count, min(workers_each, paying))
        ends = [round(len(same) * k / count) for k in range(count + 1)]
        split += [tuple(same[a:b]) for a, b in itertools.pairwise(ends)]
    return sorted(split, key=lambda fleet: -len(fleet) * fleet[0].duration)


def drive_missing(
    runs: Sequence[RunT],
    store: Store,
    kind: RunKind[RunT],
    watch: Stopwatch,
    jobs: int = 0,
    executor: str = "processes",
    wait: bool = False,
) -> None:
    """Drive the runs that are missing from `store`, and add their results to it.

    Args:
        runs: all runs of the sweep.
        store: the finished runs.
        kind: drives and measures a fleet.
        watch: adds up the computing time of all workers, by stage.
        jobs: number of worker processes, 0 for one per processor.
        executor: name of an executor, as in `workers`.
        wait: whether to wait for other workers if all have died, as in `workers`.
    """
    missing = [run for run in runs if run.id not in store.rows]
    if not missing:
        return
    durations = {run.id: run.duration for run in runs}
    done = sum(durations[id] for id in durations.keys() & store.rows.keys())
    jobs = jobs or processors()
    jobs = min(jobs, len(fleets(missing, jobs, kind.sizes)))
    inline = executor == "inline" or (executor == "processes" and jobs == 1)
    with (
        progress(counted(len(runs), "run"), sum(durations.values()), done=done) as report,
        workers("inline" if inline else executor, jobs, wait) as pool,
    ):
        drive = partial(drive_fleet, kind, report=report if inline else None)
        for fleet in pool.each(drive, fleets(missing, pool.count, kind.sizes)):
            store.keep(fleet.rows, fleet.logs)
            watch.add(fleet.stages)
            if not inline:
                report(sum(durations[row["id"]] for row in fleet.rows))


@contextlib.contextmanager
def resumable(
    config: Any, ids: Collection[str], what: str = "runs driven"
) -> Iterator[tuple[Run, Store]]:
    """The run of a command that can be stopped and resumed, and its store, which is deleted when
    results are complete.

    The error raised when the command is stopped says how much was kept, and that the same command
    resumes.
    """
    with Run(config, resumed=SWEEP_FILE) as run:
        store = Store(Path(config.out), ids, config.overwrite)
        try:
            yield run, store
        except (KeyboardInterrupt, WorkersFailedError, OutputError) as stop:
            message = str(stop) or "interrupted"
            if store.rows:
                message += f" with {len(store.rows)} of {len(ids)} {what}; the same command resumes"
            raise type(stop)(message) from None
