"""Resumable sweeps: runs that are missing are driven fleet by fleet, kept as they end, and those that fail isolated."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Protocol, TypeVar

from experiments.common.parts import Row, StoredPart, StoredParts
from experiments.common.pool import WorkersFailedError, processors, workers
from experiments.common.progress import progress
from experiments.common.run import Run
from sim.loop import Progress
from sim.stopwatch import Stopwatch
from trackslip.errors import OutputError, RunFailedError, TrackslipError, counted
from trackslip.logs.runlog import RunLog

Outcome = RunLog | BaseException
"""The log of a run, or the error that it failed with."""
_EACH = 4
"""Minimum number of fleets per worker, so that all end at about the same time, unless fleets would be too small."""
_LONG = 2_000.0
"""Simulated time of a fleet, all robots together, above which it is worth starting a worker for it [s]."""
_AT_ONCE = 16_000.0  # longest time that a fleet drives, all robots together, for its logs to fit into memory [s]


class Planned(Protocol):
    """A run of a sweep."""

    @property
    def name(self) -> str:
        """Its name in the results."""

    @property
    def id(self) -> str:
        """Hash of everything its numbers depend on, except code, models and libraries."""

    @property
    def axes(self) -> Mapping[str, Any]:
        """Values that differ within the sweep, by name."""

    @property
    def fleet(self) -> str:
        """A key shared by runs that can be driven together and last equally long."""

    @property
    def duration(self) -> float:
        """Simulated time [s]."""


RunT = TypeVar("RunT", bound=Planned)
KindRunT = TypeVar("KindRunT", bound=Planned, contravariant=True)


class RunKind(Protocol[KindRunT]):
    """The kind of runs in a sweep; pickled for the workers."""

    @property
    def sizes(self) -> tuple[int, int]:
        """Robots of the smallest and of the largest fleet worth driving."""

    def drive(self, runs: Sequence[KindRunT], watch: Stopwatch, progress: Progress | None) -> Sequence[RunLog]:
        """Drive runs as one fleet; `progress` is given in the command's own process, and takes seconds of the fleet."""

    def measure(self, run: KindRunT, log: RunLog) -> Row:
        """Measurements of a run that didn't fail, by column."""


Driven = tuple[StoredPart, list[RunLog], dict[str, float]]
"""Runs that were driven together, what was recorded of others until they failed, and work by stage [s]."""


def drive_fleet(
    kind: RunKind[RunT], runs: Sequence[RunT], recorded: bool = False, report: Progress | None = None
) -> Driven:
    """Drive and measure a fleet; runs that fail are isolated. `report` takes simulated seconds of single robots."""
    watch = Stopwatch()

    def drive(some: Sequence[RunT]) -> Sequence[RunLog]:
        return kind.drive(some, watch, report and (lambda seconds: report(seconds * len(some))))

    def row(run: RunT, outcome: Outcome) -> Row:
        about = {"run": run.name, "id": run.id, **run.axes}
        if not isinstance(outcome, RunLog):
            return about | {"error": _reason(outcome)}
        return about | {"error": None} | kind.measure(run, outcome)

    outcomes = _isolating(runs, drive)
    with watch.stage("measuring"):
        rows = list(map(row, runs, outcomes))
    with watch.stage("storing"):
        part = StoredPart.of(rows, [one for one in outcomes if isinstance(one, RunLog)])
    failed = [one for one in outcomes if isinstance(one, RunFailedError)] if recorded else []
    return part, [log for one in failed for log in one.logs], watch.stages


def _isolating(runs: Sequence[RunT], drive: Callable[[Sequence[RunT]], Sequence[RunLog]]) -> list[Outcome]:
    """Drive runs as one fleet; if it fails, drive its halves, until the runs that fail stand alone."""
    try:
        return list(drive(runs))
    except (Exception, SystemExit) as error:  # a user's controller may raise anything
        if len(runs) == 1:
            return [error]
    middle = len(runs) // 2
    return _isolating(runs[:middle], drive) + _isolating(runs[middle:], drive)


def _reason(error: BaseException) -> str:
    """The reason why a run failed, on one line."""
    said = str(error) if isinstance(error, TrackslipError) else f"{type(error).__name__}: {error}"
    return " ".join(said.split())


def fleets(runs: Sequence[RunT], workers: int, sizes: tuple[int, int]) -> list[tuple[RunT, ...]]:
    """Runs that can be driven together, in fleets of suitable `sizes` for that many workers, the longest first."""
    least, most = sizes
    size = min(max(least, -(-len(runs) // (_EACH * workers))), most)
    alike: dict[str, list[RunT]] = {}
    for run in runs:
        alike.setdefault(run.fleet, []).append(run)
    found = []
    for same in alike.values():
        duration = same[0].duration
        count = -(-len(same) // min(size, max(1, int(_AT_ONCE / duration))))
        count = max(count, min(workers, int(len(same) * duration / _LONG)))
        ends = [round(len(same) * k / count) for k in range(count + 1)]
        found += [tuple(same[a:b]) for a, b in itertools.pairwise(ends)]
    return sorted(found, key=lambda fleet: -len(fleet) * fleet[0].duration)


def drive_missing(
    config: Any,
    runs: Sequence[RunT],
    parts: StoredParts,
    kind: RunKind[RunT],
    watch: Stopwatch,
    executor: str = "processes",
) -> list[RunLog]:
    """Drive the runs that `parts` lacks, and keep them there.

    Args:
        config: the options: number of `jobs`, 0 for one per processor, and whether recordings (`rrd`) are made.
        runs: all runs of the sweep.
        parts: the driven ones.
        kind: drives and measures a fleet.
        watch: takes the work of all workers together, by stage.
        executor: name of an executor, as in `workers`.

    Returns:
        What was recorded of runs until they failed, if recordings are made.
    """
    missing = [run for run in runs if run.id not in parts]
    if not missing:
        return []
    unfinished: list[RunLog] = []
    durations = {run.id: run.duration for run in runs}
    left = sum(run.duration for run in missing)
    total = sum(durations.values())
    jobs = config.jobs or processors()
    jobs = min(jobs, len(fleets(missing, jobs, kind.sizes)))
    with progress(counted(len(runs), "run"), total, done=total - left) as report, workers(executor, jobs) as pool:
        drive = partial(drive_fleet, kind, recorded=config.rrd, report=report if pool.inline else None)
        for part, until_failure, stages in pool.each(drive, fleets(missing, pool.count, kind.sizes)):
            parts.keep(part)
            report(0.0 if pool.inline else sum(durations[row["id"]] for row in part.rows))
            unfinished += until_failure
            watch.add(stages)
    return unfinished


@contextlib.contextmanager
def resumable(
    config: Any, runs: Sequence[Planned], parts: StoredParts, again: str = "the same command"
) -> Iterator[Run]:
    """The run of a command that sweeps; its parts are deleted when the results are complete.

    Of a sweep that is stopped, the message says what was kept, and that the command `again` resumes.
    """
    ids = {run.id for run in runs}
    try:
        with Run(config, then=lambda: parts.discard(ids)) as run:
            yield run
    except (KeyboardInterrupt, WorkersFailedError, OutputError) as stop:
        driven, said = len(ids & parts.keys()), str(stop) or "interrupted"
        kept = f" with {driven} of {len(runs)} runs driven; {again} resumes" if driven else ""
        raise type(stop)(said + kept) from None
