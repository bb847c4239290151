"""Resumable sweeps: runs that are missing are driven fleet by fleet, kept as they end, and those that fail isolated."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

from experiments.parallel import WorkersFailedError, processors, workers
from experiments.report.terminal import progress
from experiments.sweep.parts import Part, Parts, Row
from sim.runs import Progress
from sim.stopwatch import Stopwatch
from trackslip.errors import OutputError, RunFailedError, TrackslipError
from trackslip.logs.runlog import RunLog

Outcome = RunLog | BaseException
"""The log of a run, or the error that it failed with."""


class Planned(Protocol):
    """A run of a sweep."""

    @property
    def name(self) -> str:
        """Its name in the results."""

    @property
    def id(self) -> str:
        """Hash of everything its numbers depend on, except code, models and libraries."""

    @property
    def duration(self) -> float:
        """Simulated time [s]."""


RunT = TypeVar("RunT")
PlannedT = TypeVar("PlannedT", bound=Planned)
DrivenT = TypeVar("DrivenT", bound=Planned, contravariant=True)


@dataclass(frozen=True)
class DrivenFleet:
    """Runs that were driven together, with those that failed."""

    part: Part
    """Rows and logs."""
    unfinished: list[RunLog]
    """What was recorded of runs until they failed."""
    duration: float
    """Simulated time of all runs together [s]."""
    stages: dict[str, float]
    """Work by stage [s]."""

    @classmethod
    def of(
        cls,
        runs: Sequence[PlannedT],
        drive: Callable[[Sequence[PlannedT]], Sequence[RunLog]],
        measure: Callable[[Sequence[Outcome]], Iterable[Row]],
        watch: Stopwatch,
        recorded: bool,
    ) -> DrivenFleet:
        """Drive runs, isolating those that fail, and `measure` a row for each; keep what they `recorded` until then."""
        outcomes = drive_isolating(runs, drive)
        rows = list(measure(outcomes))
        with watch.stage("storing"):
            part = Part.of(rows, [one for one in outcomes if isinstance(one, RunLog)])
        unfinished = [log for one in outcomes if recorded and isinstance(one, RunFailedError) for log in one.logs]
        return cls(part, unfinished, sum(run.duration for run in runs), watch.stages)


class Drive(Protocol[DrivenT]):
    """Drives a fleet, in any process; `report` is given in the command's own, and takes simulated seconds."""

    def __call__(self, runs: Sequence[DrivenT], /, report: Progress | None = None) -> DrivenFleet:
        """The fleet, driven."""


def drive_isolating(runs: Sequence[RunT], drive: Callable[[Sequence[RunT]], Sequence[RunLog]]) -> list[Outcome]:
    """Drive runs as one fleet; if it fails, drive its halves, until the runs that fail stand alone."""
    try:
        return list(drive(runs))
    except (Exception, SystemExit) as error:  # a user's controller may raise anything
        if len(runs) == 1:
            return [error]
    middle = len(runs) // 2
    return drive_isolating(runs[:middle], drive) + drive_isolating(runs[middle:], drive)


def failure_text(error: BaseException) -> str:
    """Why a run failed, on one line."""
    said = str(error) if isinstance(error, TrackslipError) else f"{type(error).__name__}: {error}"
    return " ".join(said.split())


def drive_missing(
    runs: Sequence[PlannedT],
    parts: Parts,
    fleets: Callable[[Sequence[PlannedT], int], Sequence[Sequence[PlannedT]]],
    drive: Drive[PlannedT],
    executor: str,
    jobs: int,
    watch: Stopwatch | None = None,
) -> list[RunLog]:
    """Drive the runs that `parts` lacks, and keep them there.

    Args:
        runs: all runs of the sweep.
        parts: the driven ones.
        fleets: divides runs into fleets for a number of workers.
        drive: drives a fleet; must be picklable.
        executor: name of an executor, as in `workers`.
        jobs: number of processes, 0 for one per processor.
        watch: takes the work of all workers together, by stage.

    Returns:
        What was recorded of runs until they failed.
    """
    missing = [run for run in runs if run.id not in parts]
    if not missing:
        return []
    unfinished: list[RunLog] = []
    total, left = (sum(run.duration for run in some) for some in (runs, missing))
    jobs = jobs or processors()
    jobs = min(jobs, len(fleets(missing, jobs)))
    with (
        progress(f"{len(runs)} runs", total, done=total - left) as report,
        workers(executor, jobs) as pool,
    ):
        here = pool.inline
        for fleet in pool.each(partial(drive, report=report) if here else drive, fleets(missing, pool.count)):
            parts.keep(fleet.part)
            report(0.0 if here else fleet.duration)
            unfinished += fleet.unfinished
            if watch is not None:
                watch.add(fleet.stages)
    return unfinished


@contextlib.contextmanager
def resumable(runs: Iterable[Planned], parts: Parts, command: str = "the same command") -> Iterator[None]:
    """Say what was kept of a sweep that is stopped in the block, and which command resumes it."""
    try:
        yield
    except (KeyboardInterrupt, WorkersFailedError, OutputError) as stop:
        ids = [run.id for run in runs]
        driven, said = sum(id in parts for id in ids), str(stop) or "interrupted"
        kept = f" with {driven} of {len(ids)} runs driven; {command} resumes" if driven else ""
        raise type(stop)(said + kept) from None
