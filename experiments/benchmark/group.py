"""Runs that share a reference, driven as one fleet, and their measurements."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.benchmark.latency import step_times
from experiments.benchmark.rows import CaseRow, Measures
from experiments.benchmark.setup import Setup
from experiments.driving.failures import failure_text, logs_until
from experiments.driving.lookup import reference
from experiments.options.benchmark import Case
from experiments.storage.plain_json import plain
from trackslip.logs.runlog import RunLog
from trackslip.metrics import expense, tracking_errors

GROUP_SIZE = 32
"""Robots in a fleet: larger fleets hardly gain speed, and smaller ones are shared better between processes."""
MAX_GROUP = 3 * GROUP_SIZE
"""Robots of one controller on one reference that are still driven as one fleet."""


@dataclass(frozen=True)
class Outcome:
    """Result of a case."""

    case: Case
    log: RunLog | None = None
    error: str | None = None
    """Why there is no log."""
    unfinished: Sequence[RunLog] = ()
    """What was recorded of a run that failed, until it did."""


def groups(cases: Sequence[Case]) -> list[tuple[Case, ...]]:
    """Cases by reference, in order: whole controllers, up to about GROUP_SIZE robots per group."""
    paths: dict[str, dict[str, list[Case]]] = {}
    for case in cases:
        paths.setdefault(case.reference, {}).setdefault(case.controller, []).append(case)
    found = []
    for controllers in paths.values():
        group: list[Case] = []
        for same in controllers.values():
            if group and len(group) + len(same) > GROUP_SIZE:
                found.append(tuple(group))
                group = []
            group += same
            while len(group) > MAX_GROUP:
                found.append(tuple(group[:GROUP_SIZE]))
                group = group[GROUP_SIZE:]
        found.append(tuple(group))
    return found


def drive(setup: Setup, cases: Sequence[Case]) -> list[Outcome]:
    """Drive the cases of a group; where a fleet fails, drive its halves, until the runs that fail are isolated."""
    try:
        logs = setup.drive(cases)
        return [Outcome(case, log) for case, log in zip(cases, logs, strict=True)]
    except (Exception, SystemExit) as error:  # a user's controller may raise anything; a failed run becomes a row
        if len(cases) == 1:
            return [Outcome(cases[0], error=failure_text(error), unfinished=logs_until(error))]
    middle = len(cases) // 2
    return drive(setup, cases[:middle]) + drive(setup, cases[middle:])


def measure(setup: Setup, outcomes: Sequence[Outcome]) -> list[CaseRow]:
    """One row per case: its errors and expense, or why it failed; and its times per step.

    Times per step are measured for the first of the cases that differ only in their seeds.
    """
    timed: set[Case] = set()
    rows = []
    for outcome in outcomes:
        case, log = outcome.case, outcome.log
        row = CaseRow(case, outcome.error)
        if log is not None and log.truth is not None:
            row = _measured(setup, case, log)
            if replace(case, seed=0) not in timed:
                timed.add(replace(case, seed=0))
                with contextlib.suppress(Exception, SystemExit):  # a user's controller may fail on a single robot
                    times = np.round(1e3 * step_times(setup, case, log), 4)
                    row = replace(row, compute_ms=tuple(times.tolist()))
        rows.append(row)
    return rows


def _measured(setup: Setup, case: Case, log: RunLog) -> CaseRow:
    assert log.truth is not None
    top_speed = setup.config.drive.top_speed / setup.world.robot.geometry.sprocket_radius
    errors: dict[str, Any] = plain(tracking_errors(log.time, log.truth.pose, reference(case.reference)))
    success = errors.pop("success")
    offset, radius_error = (None, None) if log.icr is None else map(float, log.icr[-1])
    measures = Measures(
        **errors,
        **plain(expense(log, top_speed)),
        valid_fraction=float(log.is_valid.mean()),
        icr_offset=offset,
        icr_radius_error=radius_error,
    )
    return CaseRow(case, measures=measures, success=success)
