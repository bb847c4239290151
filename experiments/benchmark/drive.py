"""Driving and measuring a fleet of a benchmark: errors, expense, and the time that a step of one robot takes."""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from experiments.benchmark.cases import BenchmarkCase
from experiments.benchmark.gains import Gains
from experiments.benchmark.plants import draw_plant
from experiments.common.lookup import compensation, controller, reference
from experiments.common.results import RUNS_FILE
from experiments.common.sweep import Row
from experiments.recorder import record_all
from experiments.simulate.closed_loop import ClosedLoopRun, Plant, drive_closed_loops
from experiments.simulate.options import ClosedLoopOptions, Equipment, Simulation
from experiments.simulate.world import World
from sim.ground.ground import Ground
from sim.ground.named import load_ground
from sim.loop import Progress
from sim.stopwatch import Stopwatch
from trackslip.controllers.base import Controller, SensesSprockets
from trackslip.errors import InvalidValueError
from trackslip.kinematics import limit_sprocket_speeds
from trackslip.localization.base import PoseEstimate
from trackslip.logs.logfile import read_runs
from trackslip.logs.runlog import RunLog
from trackslip.metrics import expense, tracking_errors
from trackslip.slip.compensation import Compensation

_STEPS = 200  # number timed, from the start of the run


@dataclass(frozen=True)
class ClosedLoops:
    """Closed-loop runs by the names of what drives them."""

    config: ClosedLoopOptions
    plants: str = "nominal"
    """"nominal", the robot that the laws were identified on, or "drawn" around it."""
    gains: Gains = field(default_factory=Gains)
    """Gains of the controllers."""
    timed: int | None = None
    """Seed of the runs whose control steps are timed."""
    sizes: ClassVar[tuple[int, int]] = (32, 32)
    """Larger fleets hardly gain speed, and smaller ones are shared better between processes."""

    @property
    def world(self) -> World:
        """Robot, scanner and drives; raises TrackslipError for a file or name that does not exist."""
        return _world(self.config)

    @property
    def top_speed(self) -> float:
        """Top speed of the sprockets [rad/s]."""
        return self.world.drive.top_speed / self.world.robot.geometry.sprocket_radius

    def specification(self, case: BenchmarkCase) -> str:
        """The controller of a case with its tuned arguments."""
        return self.gains.specification(case.controller, case.compensation)

    def plant(self, case: BenchmarkCase) -> Plant | None:
        """The plant of a case; None for the nominal one."""
        if self.plants == "nominal":
            return None
        return draw_plant(self.world, case.reference, self.ground(case.ground), case.seed, case.key)

    def ground(self, name: str) -> Ground:
        """A ground by name or from a file; `robot` is the ground in the robot's file."""
        return self.world.ground if name == "robot" else load_ground(name)

    def controller(self, name: str) -> Controller:
        """A new controller by name."""
        world = self.world
        return controller(name, world.robot.geometry, world.drive.top_speed, self.config.scanner.period)

    def compensation(self, name: str) -> Compensation:
        """A new compensation by name."""
        return compensation(name, self.world.robot.geometry, self.config.laws)

    def check(self, cases: Sequence[BenchmarkCase]) -> None:
        """Raise TrackslipError for unknown names, gains and plants that aren't allowed, before anything is driven."""
        look_ups: tuple[tuple[Callable[[str], object], str, Iterable[str]], ...] = (
            (self.controller, "controller", (case.controller for case in cases)),
            (self.controller, "controller", map(self.specification, cases)),
            (self.compensation, "compensation", (case.compensation for case in cases)),
            (reference, "reference", (case.reference for case in cases)),
            (self.ground, "ground", (case.ground for case in cases)),
        )
        for look_up, factor, names in look_ups:
            for name in dict.fromkeys(names):
                try:
                    look_up(name)
                except InvalidValueError as error:
                    option = f"{factor}s" if error.field == factor else error.field
                    raise InvalidValueError(option, error.value, error.allowed) from error
        try:
            self.plant(cases[0])
        except InvalidValueError as error:
            raise InvalidValueError(f"{error.field} of drawn plants", error.value, error.allowed) from error

    def drive(self, runs: Sequence[BenchmarkCase], watch: Stopwatch, progress: Progress | None) -> list[RunLog]:
        """Drive cases that share a reference, as one fleet."""
        loops = [
            ClosedLoopRun(
                name=case.name,
                key=f"benchmark {case.key}",
                seed=case.seed,
                controller=self.specification(case),
                compensation=case.compensation,
                start=case.start_pose(),
                ground=None if self.plants == "drawn" else self.ground(case.ground),
                plant=self.plant(case),
                metadata={"reference": case.reference, "ground_name": case.ground, "start": case.start},
            )
            for case in runs
        ]
        path, config = reference(runs[0].reference), self.config
        progress = progress or (lambda seconds: None)
        return drive_closed_loops(
            loops, self.world, path, config.localization, self.compensation, config.preview, progress
        )

    def measure(self, run: BenchmarkCase, log: RunLog) -> Row:
        """Errors, expense and, for the seed `timed`, times of steps."""
        assert log.truth is not None
        errors = tracking_errors(log.time, log.truth.pose, reference(run.reference))
        row = vars(errors) | vars(expense(log, self.top_speed)) | {"valid_fraction": float(log.is_valid.mean())}
        if log.icr is not None:
            row["icr_offset"], row["icr_radius_error"] = map(float, log.icr[-1])
        if run.seed == self.timed:
            with contextlib.suppress(Exception, SystemExit):  # a user's controller may fail on a single robot
                row["compute_ms"] = np.round(1e3 * np.array(self._step_times(run, log)), 4)
        return row

    def _step_times(self, case: BenchmarkCase, log: RunLog) -> list[float]:
        """Times [s] from pose to set points, at the poses of a run, measured with a separate controller."""
        pilot, law = self.controller(self.specification(case)), self.compensation(case.compensation)
        path, geometry, top_speed = reference(case.reference), self.world.robot.geometry, self.top_speed
        covariance = np.zeros((len(log.time), 3, 3)) if log.covariance is None else log.covariance
        pilot.reset()
        law.reset(log.pose[:1])
        period = float(log.time[1] - log.time[0])
        times = []
        for k in range(min(_STEPS, len(log.time))):
            row = slice(k, k + 1)
            estimate = PoseEstimate(log.pose[row].copy(), covariance[row], log.is_valid[row])
            began = time.perf_counter()
            if k > 0:
                law.observe(log.omega[row], period, estimate)
            if isinstance(pilot, SensesSprockets):
                pilot.sense(log.omega[row])
            twist = pilot.twist(float(log.time[k]), estimate.pose, path)
            limit_sprocket_speeds(law.law().sprocket_speeds(twist, geometry), top_speed)
            times.append(time.perf_counter() - began)
        return times[1:]  # the first call prepares what the others use


@functools.lru_cache(maxsize=1)
def _world(config: Equipment) -> World:
    equipment = (config.robot, config.radius_error, config.drive, config.scanner, config.obstacles, config.pull)
    return World.of(Simulation(*equipment, threads=1))


def record_comparisons(folder: Path, cases: Sequence[BenchmarkCase], unfinished: Sequence[RunLog] = ()) -> None:
    """For each reference, ground and start, compare all controllers and compensations with the first seed.

    Runs that failed are recorded one by one, as far as they went.
    """
    logs = {log.run: log for log in read_runs(folder / RUNS_FILE)} if (folder / RUNS_FILE).exists() else {}
    compared: dict[str, list[RunLog]] = {}
    for case in cases:
        if case.seed == cases[0].seed and case.name in logs:
            name = f"{case.key} {Path(case.ground).stem} {case.start} seed {case.seed}"
            compared.setdefault(name, []).append(logs[case.name])
    order = [case.name for case in cases]
    record_all(folder, sorted(unfinished, key=lambda log: order.index(log.run)), compared)
