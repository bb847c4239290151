"""Closed-loop runs of a fleet in front of the scanner, with controller and compensation given by
name.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Self

import numpy as np

from experiments.common.lookup import controller, locator
from experiments.common.plain_json import plain
from experiments.simulate.options import ClosedLoopOptions
from experiments.simulate.paths import require_compensation, require_controller
from experiments.simulate.world import World
from sim.common.seeds import generator
from sim.fleet.fleet import RunSetup
from sim.ground.ground import Ground
from sim.runs.loop import MEASURED, Delay, Pilot, Progress, WhenLost, closed_loop
from sim.runs.run_recorder import Description
from sim.runs.stopwatch import Stopwatch
from sim.scanner.feed import ScannerFeed
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.online.compensation import Compensation
from trackslip.trajectory.base import Reference

_MAX_SEED: Final = 2**63


@dataclass(frozen=True)
class Plant:
    """A run's own robot, ground and scanner, instead of the world's."""

    setup: RunSetup
    """Ground, radius error, lag and centre of mass; the run's start replaces that of the
    setup.
    """
    scanner_noise: float
    """Standard deviation of the scanner's ranges [m]."""


@dataclass(frozen=True)
class ClosedLoopRun:
    """A closed-loop run of a fleet."""

    name: str
    key: str
    """Key for the run's random numbers, in addition to `seed`."""
    seed: int
    """Root seed for the run's random numbers."""
    controller: str
    """Name of a controller, as in `lookup.controller`."""
    compensation: str
    """Name of a slip compensation."""
    start: Array
    """Start pose (3,) [m, m, rad]."""
    ground: Ground | None = None
    """The run's own ground; None for the world's."""
    plant: Plant | None = None
    """The run's own robot, ground and scanner; None for the world's robot and scanner on
    `ground`.
    """
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @property
    def controller_seed(self) -> int:
        """The seed for the controller's random numbers."""
        return int(generator(self.seed, f"controller {self.key}").integers(_MAX_SEED))

    def setup(self, world: World) -> RunSetup:
        """The run's setup in a fleet: start, ground and properties of the robot."""
        x, y, phi = map(float, self.start)
        if self.plant is not None:
            return replace(self.plant.setup, start=(x, y, phi))
        return RunSetup((x, y, phi), self.ground or world.ground, world.radius_error)

    def own_metadata(self) -> dict[str, Any]:
        """The metadata that may differ between the runs of a fleet."""
        entries: dict[str, Any] = {
            "controller": self.controller,
            "compensation": self.compensation,
            "start": self.start,
            "seed": self.seed,
        }
        if self.ground is not None:
            entries["ground"] = self.ground
        if self.plant is not None:
            own = self.plant.setup
            entries["ground"] = own.ground
            entries["radius_error"] = own.radius_error
            entries["lag"] = own.lag
            entries["com_offset"] = own.com_offset
            entries["scanner_noise"] = self.plant.scanner_noise
        return plain(entries | dict(self.metadata))


@dataclass(frozen=True)
class Loop:
    """How closed loops get poses and give commands, as in `options.ClosedLoopOptions`."""

    localization: str = "plate"
    """Source of the controllers' poses: plate, line or truth."""
    preview: float = 0.0
    """Time ahead of the present at which controllers are evaluated [s]."""
    command_delay: Delay = 0.0
    """Time until a command takes effect [s], or MEASURED."""
    when_lost: WhenLost = "drive"
    """What robots do without valid poses."""

    @classmethod
    def of(cls, options: ClosedLoopOptions) -> Self:
        """The closed loops that options describe."""
        return cls(
            localization=options.localization,
            preview=options.preview,
            command_delay=options.command_delay,
            when_lost=options.when_lost,
        )


def require_able(
    runs: Sequence[ClosedLoopRun],
    world: World,
    path: Reference,
    compensation: Callable[[str], Compensation],
) -> None:
    """Raise InvalidValueError if the path turns on the spot, and the controller or law of a run
    can't; `compensation` makes a compensation from its name.
    """
    limits = world.robot.geometry, world.drive.top_speed, world.config.scanner.period
    for name in dict.fromkeys(run.controller for run in runs):
        require_controller(path, name, controller(name, *limits))
    for name in dict.fromkeys(run.compensation for run in runs):
        slip = compensation(name)
        slip.reset(path.pose([0.0]))
        require_compensation(path, name, slip.law())


def drive_closed_loops(
    runs: Sequence[ClosedLoopRun],
    world: World,
    path: Reference,
    loop: Loop,
    compensation: Callable[[str], Compensation],
    progress: Progress = lambda seconds: None,
    kept: bool = False,
    watch: Stopwatch | None = None,
) -> list[RunLog]:
    """Drive all runs along one path as one fleet.

    Args:
        runs: the N runs.
        world: robot, scanner, drives, and the ground of runs without their own.
        path: the reference.
        loop: how the robots get poses and commands.
        compensation: makes a compensation from its name.
        progress: called with the simulated seconds since the last call, counted once for the whole
            fleet.
        kept: whether the logs keep all ranges in the scans.
        watch: stopwatch for the control steps of the first run with each controller and
            compensation, by the run's name. This run has these objects for itself, as on a robot;
            so have all runs if their commands are late by the measured times.

    Raises:
        TrackslipError: for an unknown controller or compensation, or when a robot tips over or a
            controller fails.
    """
    setups = [run.setup(world) for run in runs]
    shearing = [k for k, setup in enumerate(setups) if setup.ground.largest_shear > 0]
    firm = [k for k in range(len(runs)) if k not in shearing]
    # robots on shearing ground have other pads, and a run must not depend on its fleet
    if shearing and firm:
        logs: dict[int, RunLog] = {}
        for part, report in ((firm, progress), (shearing, lambda seconds: None)):
            some = [runs[k] for k in part]
            driven = drive_closed_loops(some, world, path, loop, compensation, report, kept, watch)
            logs |= zip(part, driven, strict=True)
        return [logs[k] for k in range(len(runs))]
    limits = world.robot.geometry, world.drive.top_speed, world.config.scanner.period
    driven_by: dict[tuple[str, str], list[int]] = {}
    for k, run in enumerate(runs):
        driven_by.setdefault((run.controller, run.compensation), []).append(k)
    starts = np.array([run.start for run in runs])
    pilots = []
    for (name, law), robots in driven_by.items():
        for steered in _steered_together(robots, loop, watch):
            slip = compensation(law)
            slip.reset(starts[steered])
            half_gauge = slip.law().effective_half_gauge(world.robot.geometry)
            seeds = [runs[k].controller_seed for k in steered]
            made = controller(name, *limits, half_gauge)
            pilots.append(Pilot(made, steered, slip, loop.preview, loop.when_lost, seeds))
    fleet = world.fleet(starts, [setup.ground for setup in setups])
    if any(run.plant is not None for run in runs):
        fleet.restart(np.arange(len(runs)), setups)
    scanner = world.config.scanner
    noise = [scanner.noise if run.plant is None else run.plant.scanner_noise for run in runs]
    random = [generator(run.seed, run.key) for run in runs]
    feed = ScannerFeed(scanner, fleet, random, world.obstacles, kept, noise)
    common = world.metadata(loop.localization)
    descriptions = [Description(run.name, common | run.own_metadata()) for run in runs]
    method = None if loop.localization == "truth" else locator(loop.localization, world.robot)
    return closed_loop(
        fleet, pilots, path, feed, method, descriptions, progress, watch, loop.command_delay
    )


def _steered_together(robots: list[int], loop: Loop, watch: Stopwatch | None) -> list[list[int]]:
    """Robots with the same controller and compensation, in groups that share both objects."""
    if loop.command_delay == MEASURED:
        return [[robot] for robot in robots]
    if watch is None or len(robots) == 1:
        return [robots]
    return [robots[:1], robots[1:]]
