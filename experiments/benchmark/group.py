"""Runs that share a reference, driven as one fleet, and their measurements."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.benchmark.latency import step_times
from experiments.benchmark.setup import Setup
from experiments.driving.lookup import reference
from experiments.options.benchmark import Case
from experiments.storage.plain_json import plain
from trackslip.errors import TrackslipError
from trackslip.logs.runlog import RunLog
from trackslip.metrics import expense, tracking_errors

GROUP_SIZE = 32
"""Robots in a fleet: larger fleets hardly gain speed, and smaller ones are shared better between processes."""


TOO_MANY = 3 * GROUP_SIZE
"""Robots of one controller on one reference that are still driven as one fleet."""


@dataclass(frozen=True)
class Outcome:
    """Result of a case."""

    case: Case
    log: RunLog | None = None
    error: str | None = None
    """Why there is no log."""


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
            while len(group) > TOO_MANY:
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
            said = str(error) if isinstance(error, TrackslipError) else f"{type(error).__name__}: {error}"
            return [Outcome(cases[0], error=" ".join(said.split()))]
    middle = len(cases) // 2
    return drive(setup, cases[:middle]) + drive(setup, cases[middle:])


def measure(setup: Setup, outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """One row per case: its names, its errors and expense, or why it failed; and its time per step [ms].

    Time per step is measured for the first of the cases that differ in nothing but their seed.
    """
    top_speed = setup.config.drive.top_speed / setup.world.robot.geometry.sprocket_radius
    timed: set[Case] = set()
    rows = []
    for outcome in outcomes:
        case, log = outcome.case, outcome.log
        row: dict[str, Any] = vars(case) | {"error": outcome.error, "compute_ms": []}
        if log is not None and log.truth is not None:
            path = reference(case.reference)
            row |= plain(tracking_errors(log.time, log.truth.pose, path)) | plain(expense(log, top_speed))
            row["valid_fraction"] = float(log.is_valid.mean())
            if log.icr is not None:
                row |= {"icr_offset": log.icr[-1, 0], "icr_radius_error": log.icr[-1, 1]}
            if replace(case, seed=0) not in timed:
                timed.add(replace(case, seed=0))
                with contextlib.suppress(Exception, SystemExit):  # a user's controller may fail on a single robot
                    row["compute_ms"] = np.round(1e3 * step_times(setup, case, log), 4).tolist()
        rows.append(row)
    return rows
