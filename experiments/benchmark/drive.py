"""How a benchmark's cases are driven and measured, fleet by fleet."""

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Final

import numpy as np

from experiments.benchmark.cases import FACTORS, BenchmarkCase, plant_ranges
from experiments.benchmark.gains import Gains
from experiments.common.choices import WITHOUT_LAWS
from experiments.common.lookup import compensation, controller, policy_path, user_modules
from experiments.common.manifest import content, digest
from experiments.common.results import SUMMARY_FILE
from experiments.common.sweep import Row
from experiments.simulate.closed_loop import (
    ClosedLoopRun,
    Loop,
    Plant,
    drive_closed_loops,
    require_able,
)
from experiments.simulate.options import ClosedLoopOptions, Equipment, Simulation
from experiments.simulate.world import World
from sim.common.seeds import generator
from sim.ground.ground import Ground, load_ground
from sim.runs.loop import Progress
from sim.runs.stopwatch import Stopwatch
from trackslip.controllers.base import Controller
from trackslip.errors import InvalidValueError, require
from trackslip.laws.file import SHIPPED
from trackslip.logs.runlog import RunLog
from trackslip.metrics import TRANSIENT, expense, tracking_errors
from trackslip.online.compensation import Compensation
from trackslip.trajectory.drivable import require_drivable
from trackslip.trajectory.turns import turns_of

_NOISE: Final = (0.5, 2.0)  # range of the factor on the scanner's noise [-]
_SPACING: Final = 0.05  # time between points on the path where ground patches may lie [s]


@dataclass(frozen=True)
class ClosedLoops:
    """Closed-loop runs, with controllers, compensations, references and grounds given by name."""

    config: ClosedLoopOptions
    plants: str = "nominal"
    """"nominal" for the robot that the laws were identified with, or "drawn" for random robots
    around it.
    """
    gains: Gains = field(default_factory=Gains)
    """Gains for the controllers."""
    sizes: ClassVar[tuple[int, int]] = (400, 400)
    """Fleet sizes: a path's runs form one fleet, as localization and controllers cost little more
    in a large fleet.
    """

    @property
    def world(self) -> World:
        """Robot, scanner and drives; raises TrackslipError for a file or name that does not
        exist.
        """
        return _world(self.config)

    def plant(self, case: BenchmarkCase) -> Plant | None:
        """The plant for a case, the same for all controllers and compensations; None for the
        nominal plant.
        """
        if self.plants == "nominal":
            return None
        world = self.world
        path = case.path
        rng = generator(case.seed, f"plant {case.key}")
        robot = replace(world.parameters, radius_error=world.radius_error, drive=world.drive)
        poses = path.pose(np.arange(0.0, path.duration, _SPACING))
        ground = self.ground(case.ground)
        setup = plant_ranges(robot).setup(rng, robot, ground, poses)
        return Plant(setup, world.config.scanner.noise * float(rng.uniform(*_NOISE)))

    def ground(self, name: str) -> Ground:
        """A ground by name or from a file; `robot` is the ground in the robot's file."""
        return self.world.ground if name == "robot" else load_ground(name)

    def controller(self, name: str) -> Controller:
        """A new controller by name."""
        world = self.world
        period = self.config.scanner.period
        return controller(name, world.robot.geometry, world.drive.top_speed, period)

    def compensation(self, name: str) -> Compensation:
        """A new compensation by name."""
        return compensation(name, self.world.robot.geometry, self.config.laws)

    def check(self, cases: Sequence[BenchmarkCase]) -> None:
        """Raise TrackslipError for unknown names, and for gains or plants that aren't allowed,
        before driving.
        """
        self.config.check(self.world.drive)
        if self.config.laws and {case.compensation for case in cases} <= set(WITHOUT_LAWS):
            allowed = f"left out for the compensations {', '.join(WITHOUT_LAWS)}"
            raise InvalidValueError("laws", self.config.laws, allowed)
        specifications = [self._specification(case) for case in cases]
        controllers = [*(case.controller for case in cases), *specifications]
        look_ups: tuple[tuple[Callable[[str], object], Iterable[str]], ...] = (
            (self.controller, controllers),
            (self.compensation, (case.compensation for case in cases)),
            (cases[0].plan.path, (case.reference for case in cases)),
            (self.ground, (case.ground for case in cases)),
        )
        try:
            for look_up, names in look_ups:
                for name in dict.fromkeys(names):
                    look_up(name)
        except InvalidValueError as error:
            option = f"{error.field}s" if error.field in FACTORS else error.field
            raise InvalidValueError(option, error.value, error.allowed) from error
        for name in dict.fromkeys(case.reference for case in cases):
            duration = cases[0].plan.path(name).duration
            allowed = f"a path of more than {TRANSIENT:g} s, from which on errors count"
            require(duration > TRANSIENT, "references", f"{name} of {duration:.1f} s", allowed)
        self._require_able(cases)
        for case in {(case.reference, case.compensation): case for case in cases}.values():
            self._require_drivable(case)
        try:
            self.plant(cases[0])
        except InvalidValueError as error:
            raise InvalidValueError(
                f"{error.field} of drawn plants", error.value, error.allowed
            ) from error

    def _require_drivable(self, case: BenchmarkCase) -> None:
        """Raise InvalidValueError for a path that is too fast for the robot with a compensation."""
        slip = self.compensation(case.compensation)
        slip.reset(case.path.pose([0.0]))
        geometry = self.world.robot.geometry
        top_speed = self.world.drive.top_speed
        require_drivable("references", case.reference, case.path, slip.law(), geometry, top_speed)

    def _require_able(self, cases: Sequence[BenchmarkCase]) -> None:
        """Raise InvalidValueError if a path turns on the spot, and a controller or law can't."""
        by_path: dict[str, list[BenchmarkCase]] = {}
        for case in cases:
            by_path.setdefault(case.reference, []).append(case)
        for group in by_path.values():
            path = group[0].path
            if turns_of(path):
                runs = [self._loop(case) for case in group]
                require_able(runs, self.world, path, self.compensation)

    def files(self, cases: Sequence[BenchmarkCase]) -> dict[str, str | None]:
        """SHA-256 of files with laws, policies, user modules, paths and grounds, by name; None if
        there is no file.
        """
        laws = self.config.laws or SHIPPED
        laws_file = laws / SUMMARY_FILE if laws.is_dir() else laws
        names = {str(laws_file), *user_modules()}
        for case in cases:
            names |= {case.reference, case.ground}
            policy = policy_path(case.controller)
            if policy:
                names.add(str(policy))
        return {name: content(Path(name)) for name in sorted(names)}

    def identified(self, cases: Sequence[BenchmarkCase]) -> list[BenchmarkCase]:
        """The cases with their ids; the modules of a user's controllers must already be
        imported.
        """
        config = self.config
        world = self.world
        robot = [
            world.parameters,
            world.ground,
            world.radius_error,
            world.robot.digest,
            world.drive,
        ]
        loop = vars(Loop.of(config)).values()
        room = [world.obstacles, world.pull, config.scanner, *loop]
        common = digest([robot, room, self.files(cases), self.plants])
        identified = []
        for case in cases:
            id = digest([common, case.axes, self._specification(case), case.plan])
            identified.append(replace(case, id=id))
        return identified

    def _specification(self, case: BenchmarkCase) -> str:
        """The case's controller with its gains."""
        return self.gains.specification(case.controller, case.compensation)

    def drive(
        self, runs: Sequence[BenchmarkCase], watch: Stopwatch, progress: Progress | None
    ) -> list[RunLog]:
        """Drive cases that share a reference as one fleet."""
        return drive_closed_loops(
            [self._loop(case) for case in runs],
            self.world,
            runs[0].path,
            Loop.of(self.config),
            self.compensation,
            progress or (lambda seconds: None),
            watch=watch,
        )

    def _loop(self, case: BenchmarkCase) -> ClosedLoopRun:
        """The closed-loop run of a case."""
        return ClosedLoopRun(
            name=case.name,
            key=f"benchmark {case.key}",
            seed=case.seed,
            controller=self._specification(case),
            compensation=case.compensation,
            start=case.start_pose(),
            ground=None if self.plants == "drawn" else self.ground(case.ground),
            plant=self.plant(case),
            metadata={
                **case.plan.metadata(case.reference),
                "ground_name": case.ground,
                "start": case.start,
            },
        )

    def measure(self, run: BenchmarkCase, log: RunLog) -> Row:
        """Errors and expense of a run, by column."""
        assert log.truth is not None
        errors = tracking_errors(log.time, log.truth.pose, run.path)
        top_speed = self.world.drive.top_speed / self.world.robot.geometry.sprocket_radius
        effort = expense(log, top_speed)
        row: Row = {
            **vars(errors),
            **vars(effort),
            "saturation": effort.saturation_s / float(log.time[-1] - log.time[0]),
            "valid_fraction": float(log.is_valid.mean()),
        }
        if log.icr is not None:
            offset, radius_error = log.icr[-1]
            row["icr_offset"] = float(offset)
            row["icr_radius_error"] = float(radius_error)
        return row


@functools.lru_cache(maxsize=1)
def _world(config: Equipment) -> World:
    simulation = Simulation(
        robot=config.robot,
        radius_error=config.radius_error,
        drive=config.drive,
        scanner=config.scanner,
        obstacles=config.obstacles,
        pull=config.pull,
        threads=1,
    )
    return World.of(simulation)
