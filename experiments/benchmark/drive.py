"""Driving and measuring a fleet of a benchmark: errors, expense, and the time that a step of one robot takes."""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from experiments.benchmark.cases import Case
from experiments.benchmark.rows import CaseRow
from experiments.driving.closed_loop import ClosedLoopRun, drive_closed_loops
from experiments.driving.lookup import compensation, controller, reference
from experiments.driving.world import World
from experiments.options.world import Simulation
from experiments.recording import record_all
from experiments.storage.plain_json import plain
from experiments.storage.results import RUNS_FILE
from experiments.sweep.engine import DrivenFleet, Outcome, failure_text
from experiments.sweep.parts import Row
from sim.ground.ground import Ground
from sim.ground.named import load_ground
from sim.runs import Progress
from sim.stopwatch import Stopwatch
from trackslip.controllers.base import Controller, SensesSprockets
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array, limit_sprocket_speeds
from trackslip.localization.base import PoseEstimate
from trackslip.logs.logfile import read_runs
from trackslip.logs.runlog import RunLog
from trackslip.metrics import expense, tracking_errors
from trackslip.slip.compensation import Compensation

if TYPE_CHECKING:
    from experiments.commands.benchmark import Config

_STEPS = 200  # number timed, from the start of the run


@dataclass(frozen=True)
class Setup:
    """A benchmark's names resolved to objects, in its world."""

    config: Config
    world: World

    @classmethod
    def of(cls, config: Config) -> Self:
        """The setup of a configuration; raises TrackslipError for a file or name that does not exist."""
        equipment = (config.robot, config.radius_error, config.drive, config.scanner, config.obstacles, config.pull)
        return cls(config, World.of(Simulation(*equipment, threads=1)))

    def check(self, cases: Sequence[Case]) -> None:
        """Raise TrackslipError for an unknown name, before anything is driven."""
        look_ups: dict[str, Callable[[str], object]] = {
            "controller": self.controller,
            "compensation": self.compensation,
            "reference": reference,
            "ground": self.ground,
        }
        for factor, look_up in look_ups.items():
            for name in dict.fromkeys(getattr(case, factor) for case in cases):
                try:
                    look_up(name)
                except InvalidValueError as error:
                    if error.field == factor:  # the options' names are plural
                        raise InvalidValueError(f"{factor}s", error.value, error.allowed) from error
                    raise

    def ground(self, name: str) -> Ground:
        """A ground by name or from a file; `robot` is the ground in the robot's file."""
        return self.world.ground if name == "robot" else load_ground(name)

    def controller(self, name: str) -> Controller:
        """A new controller by name."""
        return controller(name, self.world.robot.geometry, self.config.drive.top_speed)

    def compensation(self, name: str) -> Compensation:
        """A new compensation by name."""
        return compensation(name, self.world.robot.geometry, self.config.laws)

    def drive(self, cases: Sequence[Case], progress: Progress = lambda seconds: None) -> list[RunLog]:
        """Drive cases that share a reference, as one fleet."""
        runs = [
            ClosedLoopRun(
                name=case.name,
                key=f"benchmark {case.key}",
                seed=case.seed,
                controller=case.controller,
                compensation=case.compensation,
                start=case.start_pose(),
                ground=self.ground(case.ground),
                metadata={"reference": case.reference, "ground_name": case.ground, "start": case.start},
            )
            for case in cases
        ]
        path, config = reference(cases[0].reference), self.config
        return drive_closed_loops(
            runs, self.world, path, config.localization, self.compensation, config.preview, progress
        )

    def measure(self, cases: Sequence[Case], outcomes: Sequence[Outcome]) -> Iterator[CaseRow]:
        """One row per case: its errors and expense, or why it failed; and its times per step.

        Times per step are measured for the first of the cases that differ only in their seeds.
        """
        timed: set[Case] = set()
        for case, outcome in zip(cases, outcomes, strict=True):
            if not isinstance(outcome, RunLog):
                yield CaseRow(case, failure_text(outcome))
                continue
            row, alike = self._measured(case, outcome), replace(case, seed=0, id="")
            if alike not in timed:
                timed.add(alike)
                with contextlib.suppress(Exception, SystemExit):  # a user's controller may fail on a single robot
                    times = np.round(1e3 * self._step_times(case, outcome), 4)
                    row = replace(row, compute_ms=tuple(times.tolist()))
            yield row

    def _measured(self, case: Case, log: RunLog) -> CaseRow:
        assert log.truth is not None
        top_speed = self.config.drive.top_speed / self.world.robot.geometry.sprocket_radius
        errors = plain(tracking_errors(log.time, log.truth.pose, reference(case.reference)))
        success = errors.pop("success")
        offset, radius_error = (None, None) if log.icr is None else map(float, log.icr[-1])
        more = {
            "valid_fraction": float(log.is_valid.mean()),
            "icr_offset": offset,
            "icr_radius_error": radius_error,
        }
        return CaseRow(case, measures=errors | plain(expense(log, top_speed)) | more, success=success)

    def _step_times(self, case: Case, log: RunLog) -> Array:
        """Times (K,) [s] from pose to set points, at the poses of a run, measured with a controller of its own."""
        geometry, limit = self.world.robot.geometry, self.config.drive.top_speed
        path, pilot = reference(case.reference), self.controller(case.controller)
        compensation = self.compensation(case.compensation)
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


def drive_group(cases: Sequence[Case], config: Config, report: Progress | None = None) -> DrivenFleet:
    """Drive and measure a fleet."""
    setup, advance = _setup(config), report or (lambda seconds: None)

    def drive(some: Sequence[Case]) -> list[RunLog]:
        return setup.drive(some, lambda seconds: advance(seconds * len(some)))

    def rows(outcomes: Sequence[Outcome]) -> Iterator[Row]:
        return (row.to_part() for row in setup.measure(cases, outcomes))

    return DrivenFleet.of(cases, drive, rows, Stopwatch(), config.rrd)


def record_comparisons(folder: Path, cases: Sequence[Case], unfinished: Sequence[RunLog]) -> None:
    """For each reference, ground and start, compare all controllers and compensations with the first seed.

    Runs that failed are recorded one by one, as far as they went.
    """
    logs = {log.run: log for log in read_runs(folder / RUNS_FILE)} if (folder / RUNS_FILE).exists() else {}
    compared: dict[str, list[RunLog]] = {}
    for case in cases:
        if case.seed == cases[0].seed and case.name in logs:
            name = f"{Path(case.reference).stem} {Path(case.ground).stem} {case.start} seed {case.seed}"
            compared.setdefault(name, []).append(logs[case.name])
    order = [case.name for case in cases]
    record_all(folder, sorted(unfinished, key=lambda log: order.index(log.run)), compared)


@functools.lru_cache(maxsize=1)
def _setup(config: Config) -> Setup:
    return Setup.of(config)
