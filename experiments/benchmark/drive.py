"""Driving and measuring a fleet of a benchmark: errors, expense, and the time that a step of one robot takes."""

import contextlib
import functools
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from experiments.benchmark.cases import BenchmarkCase, draw_plant
from experiments.benchmark.gains import Gains
from experiments.common.lookup import compensation, controller, policy_path, reference, user_modules
from experiments.common.manifest import content, digest
from experiments.common.results import SUMMARY_FILE
from experiments.common.sweep import Row
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
from trackslip.logs.runlog import RunLog
from trackslip.metrics import expense, tracking_errors
from trackslip.slip.compensation import Compensation
from trackslip.slip.law_file import SHIPPED

_TIMED_STEPS = 200  # from the start of the run


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
        look_ups: tuple[tuple[str, Callable[[str], object], Iterable[str]], ...] = (
            ("controller", self.controller, (case.controller for case in cases)),
            ("controller", self.controller, map(self.specification, cases)),
            ("compensation", self.compensation, (case.compensation for case in cases)),
            ("reference", reference, (case.reference for case in cases)),
            ("ground", self.ground, (case.ground for case in cases)),
        )
        for factor, look_up, names in look_ups:
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

    def identified(self, cases: Sequence[BenchmarkCase]) -> list[BenchmarkCase]:
        """The cases with their ids, for which a user's controllers must have been imported."""
        config, world = self.config, self.world
        laws = config.laws or SHIPPED
        names = {name for case in cases for name in (case.reference, case.ground)}
        names |= {str(path) for case in cases if (path := policy_path(case.controller))}
        names |= {str(laws / SUMMARY_FILE if laws.is_dir() else laws), *user_modules()}
        files = {name: content(Path(name)) for name in sorted(names)}
        robot = [world.parameters, world.ground, world.radius_error, world.robot.digest, world.drive]
        room = [world.obstacles, world.pull, config.scanner, config.localization, config.preview]
        common = digest([robot, room, files, self.plants, self.timed])
        return [replace(case, id=digest([common, case.axes, self.specification(case)])) for case in cases]

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
        for k in range(min(_TIMED_STEPS, len(log.time))):
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
