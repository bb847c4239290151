"""Driven fleets: how runs that fail are isolated, why they failed, and what was recorded until then."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from experiments.storage.parts import Part
from trackslip.errors import RunFailedError, TrackslipError
from trackslip.logs.runlog import RunLog

RunT = TypeVar("RunT")
Outcome = RunLog | BaseException
"""The log of a run, or the error that it failed with."""


@dataclass(frozen=True)
class DrivenFleet:
    """What became of a fleet."""

    part: Part
    """Rows and logs of its runs."""
    unfinished: list[RunLog]
    """What was recorded of runs that failed, until they did; empty unless recordings are wanted."""
    duration: float
    """Simulated time of all its runs together [s]."""
    stages: Mapping[str, float] = field(default_factory=dict)
    """Work by stage, if it was timed [s]."""


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


def logs_until(outcome: Outcome) -> list[RunLog]:
    """What was recorded of the runs of a fleet until one of them failed; nothing of a run that did not fail."""
    return outcome.logs if isinstance(outcome, RunFailedError) else []
