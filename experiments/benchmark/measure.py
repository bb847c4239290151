"""From driven runs to rows: their errors, their expense, and the time that one step of one robot takes."""

import contextlib
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.benchmark.rows import CaseRow, Measures
from experiments.benchmark.setup import Setup
from experiments.driving.lookup import reference
from experiments.options.benchmark import Case
from experiments.storage.plain_json import plain
from experiments.sweep.engine import Outcome, failure_text
from trackslip.controllers.base import SensesSprockets
from trackslip.kinematics import Array, limit_sprocket_speeds
from trackslip.localization.base import PoseEstimate
from trackslip.logs.runlog import RunLog
from trackslip.metrics import expense, tracking_errors

_STEPS = 200  # number timed, from the start of the run


def measure(setup: Setup, cases: Sequence[Case], outcomes: Sequence[Outcome]) -> list[CaseRow]:
    """One row per case: its errors and expense, or why it failed; and its times per step.

    Times per step are measured for the first of the cases that differ only in their seeds.
    """
    timed: set[Case] = set()
    rows = []
    for case, outcome in zip(cases, outcomes, strict=True):
        if not isinstance(outcome, RunLog):
            rows.append(CaseRow(case, failure_text(outcome)))
            continue
        row, alike = _measured(setup, case, outcome), replace(case, seed=0)
        if alike not in timed:
            timed.add(alike)
            with contextlib.suppress(Exception, SystemExit):  # a user's controller may fail on a single robot
                times = np.round(1e3 * _step_times(setup, case, outcome), 4)
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


def _step_times(setup: Setup, case: Case, log: RunLog) -> Array:
    """Times (K,) [s] from pose to sprocket set points, at the poses of a run, measured with a controller of its own."""
    geometry, limit = setup.world.robot.geometry, setup.config.drive.top_speed
    path, pilot = reference(case.reference), setup.controller(case.controller)
    compensation = setup.compensation(case.compensation)
    covariance = np.zeros((len(log.time), 3, 3)) if log.covariance is None else log.covariance
    pilot.reset()
    compensation.reset(log.pose[:1])
    period = float(log.time[1] - log.time[0])
    times = []
    for k in range(min(_STEPS, len(log.time))):
        row = slice(k, k + 1)
        estimate = PoseEstimate(log.pose[row].copy(), covariance[row], log.is_valid[row])
        began = time.perf_counter()
        if k > 0:
            compensation.observe(log.omega[row], period, estimate)
        if isinstance(pilot, SensesSprockets):
            pilot.sense(log.omega[row])
        twist = pilot.twist(float(log.time[k]), estimate.pose, path)
        limit_sprocket_speeds(compensation.law().sprocket_speeds(twist, geometry), limit / geometry.sprocket_radius)
        times.append(time.perf_counter() - began)
    return np.array(times[1:])  # the first call prepares what the others use
