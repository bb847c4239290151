"""Speed over the bare engine: every case takes turns with MuJoCo alone, which repeats the motion of the turn.

The machine may be shared and its clock rate may change, so only what was measured side by side is compared: a ratio is
the median of the ratios of turns to those of the bare engine next to them.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from mujoco import batch

from experiments.common.check import Check, at_least
from experiments.common.lookup import locator
from experiments.simulate.closed_loop import start_pose
from experiments.simulate.grid_options import GridConfig
from experiments.simulate.grid_runs import before_scanner, cells_of, drive_grid
from experiments.simulate.options import IDENTIFIED
from experiments.simulate.world import World
from sim.env import PathTrackingVectorEnv, TraverseVectorEnv
from sim.fleet import SETTLING, Fleet
from sim.loop import closed_loop
from sim.path_tracking.config import PERIOD
from sim.pilot import Pilot
from sim.robot.robot import Robot
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.stopwatch import Stopwatch
from sim.terrain import Course, Flat
from trackslip.controllers.named import CONTROLLERS
from trackslip.kinematics import Array, sprocket_speeds
from trackslip.slip.compensation import KNOWN_LAWS, FixedLaw
from trackslip.slip.law_file import load_laws
from trackslip.trajectory.segmented import circle, paper_reference

if TYPE_CHECKING:
    from experiments.bench import Config

CASES = ("bare engine", "fleet", "scanner", "closed loop", "PathTracking-v0", "Traverse-v0")
BARE, FLEET, SCANNER, LOOP, TRACKING, TRAVERSE = CASES
LOOPS, LOCALIZATION, REPRODUCE = "ten closed loops", "localization", "reproduce"
COURSES = {"stairs": 0.33, "random": 0.5}
"""Courses, and the least speed of Traverse-v0 on them over that on level ground."""
_RADIUS, _SPEED = 1.25, 0.15  # of the circle that robots drive [m], [m/s]
_STEADY = 2.0  # time after which the sprockets turn at their set points [s]
_LOOPS = 10  # robots in closed loop whose cost is checked: as many as reproduce drives
_UNDER_WAY = 40  # control periods after which all robots of an environment drive
_FEWEST = 3  # periods in a turn
_CROSSING = 64  # robots whose courses are compared
_SLOWER = {SCANNER: 0.5, LOOP: 0.1, TRACKING: 0.5, TRAVERSE: 0.05}  # shares of the simulated time of a turn
_BACK = np.array([0.5, 1.0, 1.0])  # gains from observed errors to a twist

Turn = Callable[[float], None]
"""Called with 1 after each turn."""


@dataclass(frozen=True)
class SpeedRatio:
    """Speed of a case."""

    case: str
    robots: int
    steps_per_s: float
    """Physics steps per second, all robots together [1/s]."""
    over_bare: float
    """Speed relative to the bare engine in the same motion [-]."""


def measure(config: Config, robot: Robot, turn: Turn) -> tuple[list[SpeedRatio], dict[str, float]]:
    """Speeds of all cases, costs over their physics of ten closed loops, localization and reproduce, and speeds on
    `COURSES` over that on level ground [-].
    """
    speeds = [speed for size in config.sizes for speed in _speeds(config, robot, size, turn)]
    loops = _measured(LOOPS, _closed_loops(robot, _LOOPS, config.threads), 40, config.repeats, turn)
    costs = {LOOPS: 1 / loops.over_bare, LOCALIZATION: _localization(config), REPRODUCE: _reproduction(config, robot)}
    turn(1.0)
    return speeds, costs | _on_courses(config)


def checks_of(speeds: Sequence[SpeedRatio], costs: dict[str, float]) -> list[Check]:
    """The bounds that hold for a part of the cases: of lone robots, and of several."""
    lone, several = {FLEET: 0.9, TRACKING: 0.4}, {FLEET: 0.9, SCANNER: 0.7, TRACKING: 0.75, TRAVERSE: 0.75}
    checks = []
    for one in speeds:
        if least := (lone if one.robots == 1 else several).get(one.case):
            case = f"{one.case}, {one.robots} robot{'s' if one.robots > 1 else ''}"
            checks.append(Check(case, "speed over the bare engine", one.over_bare, at_least(least), "x"))
    for name, most in ((LOOPS, 2.5), (LOCALIZATION, 1.0), (REPRODUCE, 6.0)):
        checks.append(Check(name, "time over its physics", costs[name], most, "x"))
    for name, least in COURSES.items():
        case = f"{TRAVERSE}, {name}, {_CROSSING} robots"
        checks.append(Check(case, "speed over that on level ground", costs[name], at_least(least), "x"))
    return checks


def _speeds(config: Config, robot: Robot, size: int, turn: Turn) -> Iterator[SpeedRatio]:
    """Every case with `size` robots."""
    cases: dict[str, Callable[[], _Case]] = {
        BARE: lambda: _fleet(robot, size, config.threads, BARE),
        FLEET: lambda: _fleet(robot, size, config.threads, FLEET),
        SCANNER: lambda: _fleet(robot, size, config.threads, SCANNER),
        LOOP: lambda: _closed_loops(robot, size, config.threads),
        TRACKING: lambda: _path_tracking(size, config.threads, config.seed),
        TRAVERSE: lambda: _traverse(size, config.threads, config.seed),
    }
    for name, case in cases.items():
        made = case()
        periods = math.ceil(_SLOWER.get(name, 1.0) * config.seconds / (size * made.period) - 1e-9)
        yield _measured(name, made, max(_FEWEST, periods), config.repeats, turn)


@dataclass(frozen=True)
class _Case:
    """Robots that drive, and the bare engine for comparison."""

    robots: int
    period: float  # [s]
    steps: int  # of the engine in a period
    take_turn: Callable[[int], tuple[float, float]]
    """Drive for some periods; returns the times of the simulator and of the bare engine in the same motion [s]."""


def _measured(name: str, case: _Case, periods: int, repeats: int, turn: Turn) -> SpeedRatio:
    """The median speed over some turns, after one that warms up."""
    case.take_turn(_FEWEST)
    turn(1.0)
    turns = []
    for _ in range(repeats):
        turns.append(case.take_turn(periods))
        turn(1.0)
    took, bare = np.transpose(turns)
    rate = case.robots * periods * case.steps / float(np.median(took))
    return SpeedRatio(name, case.robots, rate, float(np.median(np.divide(bare, took))))


def _fleet(robot: Robot, size: int, threads: int, case: str) -> _Case:
    """A fleet that drives on a circle at constant speed, from where that is nearest to the scanner."""
    fleet = Fleet(robot, np.tile(before_scanner(robot), (size, 1)), threads=threads)
    fleet.command(load_laws()["icr_radius"].sprocket_speeds([_SPEED, _SPEED / _RADIUS], robot.geometry))
    fleet.advance(_STEADY)
    feed, bare = ScannerFeed(LaserScanner(), fleet), bare_copy(fleet.batch)
    steps = round(feed.period / robot.model.opt.timestep)

    def scan(periods: int) -> None:
        for _ in range(periods):
            fleet.advance(feed.period)
            feed.measure(feed.true_ranges()[:, None, :])

    def take_turn(periods: int) -> tuple[float, float]:
        acts: dict[str, Callable[[], object]] = {
            BARE: lambda: bare.step(nstep=periods * steps),
            FLEET: lambda: fleet.advance(periods * feed.period),
            SCANNER: lambda: scan(periods),
        }
        return _seconds(acts[case]), _seconds(acts[BARE])

    return _Case(size, feed.period, steps, take_turn)


def _closed_loops(robot: Robot, size: int, threads: int) -> _Case:
    """Robots that localize themselves and follow a circle by the paper's controller."""
    period = LaserScanner().period
    pilot = Pilot(CONTROLLERS["linear"](), range(size), FixedLaw(load_laws()["icr_radius"]))

    def take_turn(periods: int) -> tuple[float, float]:
        path = circle(_RADIUS, _SPEED, periods * period, before_scanner(robot))
        fleet = Fleet(robot, np.tile(path.pose(0.0), (size, 1)), threads=threads)
        motion = SameMotion(fleet)
        loop = fleet, [pilot], path, ScannerFeed(LaserScanner(), fleet), locator("plate", robot)
        took = _seconds(lambda: closed_loop(*loop, progress=motion.note))
        return took - motion.noting, motion.repeat()

    return _Case(size, period, round(period / robot.model.opt.timestep), take_turn)


def _path_tracking(size: int, threads: int, seed: int) -> _Case:
    """Robots that follow their references in the environment; a single one in the environment of one robot."""
    references = ("circle", "figure_eight", "slalom", "spiral")
    options: dict[str, Any] = {"reference": references, "action": "twist", "compensation": "icr_radius"}
    env: Any = PathTrackingVectorEnv(size, threads=threads, **options)
    if size == 1:
        env = gymnasium.make("sim:trackslip/PathTracking-v0", **options).unwrapped
    seen = np.atleast_2d(env.reset(seed=seed)[0])
    fleet = env.task.fleet

    def step() -> None:
        nonlocal seen
        twist = seen[:, 3:5] + np.stack([_BACK[0] * seen[:, 0], seen[:, 1:3] @ _BACK[1:]], axis=1)
        actions = np.clip(twist, -1, 1).astype(np.float32)
        seen, _, terminated, truncated, _ = env.step(actions[0] if size == 1 else actions)
        if size == 1 and (terminated or truncated):
            seen = env.reset()[0]
        seen = np.atleast_2d(seen)

    def take_turn(periods: int) -> tuple[float, float]:
        motion, took = SameMotion(fleet), 0.0
        for _ in range(periods):
            took += _seconds(step)
            motion.note(PERIOD)
        return took, motion.repeat()

    take_turn(_UNDER_WAY)
    return _Case(size, PERIOD, round(PERIOD / fleet.robot.model.opt.timestep), take_turn)


def _traverse(size: int, threads: int, seed: int) -> _Case:
    """Robots that cross courses under the scripted controller; the bare engine has their belts and flippers."""
    env = TraverseVectorEnv(size, threads=threads, action="correction")
    env.reset(seed=seed)
    still = np.zeros(env.action_space.shape or (), np.float32)
    world = env.task.world
    steps = round(world.period / world.tracked.model.opt.timestep)

    def take_turn(periods: int) -> tuple[float, float]:
        bare = bare_copy(world.batch)
        surface = bare.expand("geom_surfacevel")
        took, motion = 0.0, []
        for _ in range(periods):
            took += _seconds(lambda: env.step(still))
            motion.append((world.batch.expand("geom_surfacevel").copy(), world.batch.ctrl.copy()))
        began = perf_counter()
        for belts, motors in motion:
            surface[:], bare.ctrl[:] = belts, motors
            bare.step(nstep=steps)
        return took, perf_counter() - began

    take_turn(_UNDER_WAY // 2)
    return _Case(size, world.period, steps, take_turn)


def _on_courses(config: Config) -> dict[str, float]:
    """Speeds of Traverse-v0 on `COURSES` over that on level ground: medians of the ratios of turns side by side [-]."""
    envs = {}
    for course in (Course((Flat(6.0),)), *COURSES):
        env = TraverseVectorEnv(_CROSSING, threads=config.threads, action="correction", course=course)
        env.reset(seed=config.seed)
        envs[course] = env

    def turn(env: TraverseVectorEnv, periods: int) -> float:
        still = np.zeros(env.action_space.shape or (), np.float32)
        return _seconds(lambda: [env.step(still) for _ in range(periods)])

    for env in envs.values():
        turn(env, _UNDER_WAY // 2)
    took = np.array([[turn(env, _FEWEST) for env in envs.values()] for _ in range(config.repeats)])
    ratios: Array = np.median(took[:, :1] / took[:, 1:], axis=0)
    return dict(zip(COURSES, ratios.tolist(), strict=True))


def bare_copy(source: batch.Batch, threads: int = 0) -> batch.Batch:
    """The same simulations in the same state, stepped by MuJoCo alone, on as many threads or a given number."""
    copy = batch.Batch(source.model, source.nsim, nthread=threads or source.nthread)
    for name in batch.MODEL_FIELDS:
        if source.expanded(name) is not None:
            copy.expand(name)[:] = source.expand(name)
    copy.state[:] = source.state
    return copy


class SameMotion:
    """The bare engine in exactly the motion of a fleet: its belts change their speeds in every servo period, too.

    Belts at constant speeds would be cheaper physics: as long as nothing changes, the solver starts from its solution.
    """

    def __init__(self, fleet: Fleet) -> None:
        """Begin with the fleet's present state."""
        self._fleet = fleet
        self.bare = bare_copy(fleet.batch)
        """The bare engine's simulations."""
        self._drive = fleet.drive.of(np.arange(fleet.size))
        self._speeds: list[Array] = []  # of the pads' surfaces (P, N, pads) [m/s]
        self.noting = 0.0
        """Time that noting has taken [s]."""

    def note(self, duration: float) -> None:
        """Note what the fleet has done for the last `duration` by its present set points."""
        began, robot = perf_counter(), self._fleet.robot
        self._drive.command(self._fleet.drive.set_point)
        mean = self._drive.forecast(round(duration / self._fleet.period)).mean  # (P, N, 2)
        self._speeds.append((-self._drive.radius * mean).take(robot.pad_side, axis=-1) * robot.pad_sign)
        self._drive = self._fleet.drive.of(np.arange(self._fleet.size))
        self.noting += perf_counter() - began

    def repeat(self) -> float:
        """Do all of it; the time that this takes [s]."""
        surface = self.bare.expand("geom_surfacevel")[:, self._fleet.robot.pads, 2]  # live
        speeds = np.concatenate(self._speeds)
        steps = round(self._fleet.period / self._fleet.robot.model.opt.timestep)
        began = perf_counter()
        for of_period in speeds:
            surface[:] = of_period
            self.bare.step(nstep=steps)
        return perf_counter() - began


def _localization(config: Config) -> float:
    """Time of localizing the paper's 25 runs relative to their physics [-]."""
    grid, watch = GridConfig(seed=config.seed, threads=config.threads), Stopwatch()
    world = World.of(grid)
    drive_grid(grid, world, watch=watch)
    return watch.stages["localization"] / _grid_physics(world, grid, config.threads)


def _grid_physics(world: World, grid: GridConfig, threads: int) -> float:
    """Time of the bare engine for the grid's runs [s]."""
    robot, cells = world.robot, cells_of(grid)
    fleet = Fleet(robot, np.tile(before_scanner(robot), (len(cells), 1)), threads=threads)
    twist: Array = np.array([(cell.speed, cell.speed / cell.radius) for cell in cells])
    fleet.command(sprocket_speeds(twist, 0.0, robot.geometry))
    fleet.advance(_STEADY)
    bare = bare_copy(fleet.batch)
    return _seconds(lambda: bare.step(nstep=round((SETTLING + grid.duration) / robot.model.opt.timestep)))


def _reproduction(config: Config, robot: Robot) -> float:
    """Time of `trackslip reproduce`, start of Python included, relative to its physics on as many processors [-]."""
    threads = min(2, os.cpu_count() or 1)
    grid, path, laws = GridConfig(threads=threads), paper_reference(), {**KNOWN_LAWS, **load_laws()}
    runs = [(name, laws[law]) for name in ("feedforward", "linear") for law in (*KNOWN_LAWS, *IDENTIFIED)]
    fleet = Fleet(robot, [start_pose(name, "paper", path) for name, _ in runs], threads=threads)
    pilots = [Pilot(CONTROLLERS[name](), [k], FixedLaw(law)) for k, (name, law) in enumerate(runs)]
    motion, feed = SameMotion(fleet), ScannerFeed(LaserScanner(), fleet)
    closed_loop(fleet, pilots, path, feed, locator("plate", robot), progress=motion.note)
    bare = motion.repeat() + _grid_physics(World.of(grid), grid, threads)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    command = [sys.executable, "-m", "experiments", "reproduce", "--seed", str(config.seed), "--threads", str(threads)]
    with tempfile.TemporaryDirectory() as out:
        command += ["--out", f"{out}/out"]
        return _seconds(lambda: subprocess.run(command, check=True, capture_output=True, env=environment)) / bare


def _seconds(act: Callable[[], object]) -> float:
    """Time that a call takes [s]."""
    began = perf_counter()
    act()
    return perf_counter() - began
