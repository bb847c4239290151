"""Open-loop runs in front of the scanner: the paper's grid of radii and speeds, and any other set
of cells.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Self, cast

import numpy as np

from experiments.common.lookup import locator
from experiments.simulate.grid_options import GridConfig
from experiments.simulate.world import World
from sim.common.seeds import generator
from sim.fleet.fleet import Fleet
from sim.robot.robot import Robot
from sim.runs.loop import Progress, open_loop
from sim.runs.run_recorder import Description
from sim.runs.stopwatch import Stopwatch
from sim.scanner.feed import ScannerFeed
from trackslip import se2
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array, RobotGeometry, sprocket_speeds
from trackslip.logs.runlog import RunLog

CLEARANCE: Final = 1.5
"""Distance from the scanner to the nearest point of each circle [m]."""
# approximate ratio of the radius driven to the radius commanded
_DRIVEN_OVER_COMMANDED: Final = 1.3


@dataclass(frozen=True)
class GridCell:
    """A run of a grid."""

    name: str
    key: str
    """Key for the run's random numbers, in addition to the root seed."""
    radius: float
    """Radius of the no-slip command [m]."""
    speed: float
    """Speed of the no-slip command [m/s]."""
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def at(cls, radius: float, speed: float) -> Self:
        """A run defined only by its radius [m] and speed [m/s]."""
        name = f"radius={radius!r} speed={speed!r}"
        return cls(name, name, radius, speed)


def cells_of(config: GridConfig) -> list[GridCell]:
    """One cell per radius and speed, radius by radius."""
    return [
        GridCell.at(radius, speed)
        for radius, speed in itertools.product(config.radii, config.speeds)
    ]


def drive_grid(config: GridConfig, world: World, watch: Stopwatch | None = None) -> list[RunLog]:
    """Drive every radius at every speed as one fleet; see `drive_cells`."""
    cells = cells_of(config)
    return drive_cells(cells, [world] * len(cells), watch=watch)


def drive_cells(
    cells: Sequence[GridCell],
    worlds: Sequence[World],
    progress: Progress = lambda seconds: None,
    watch: Stopwatch | None = None,
    kept: bool = False,
) -> list[RunLog]:
    """Drive the cells as one fleet, each in its own world; the worlds may differ only in ground,
    radius error and seed.

    `progress` is called with the simulated seconds since the last call, counted once for the whole
    fleet; `watch` accumulates the time spent in each stage; with `kept`, the logs keep all ranges
    in the scans.

    Raises InvalidValueError for a radius too small for the robot, TrackslipError when a robot tips
    over.
    """
    world = worlds[0]
    config = cast(GridConfig, world.config)
    robot = world.robot
    for cell in cells:
        require_radius(cell.radius, robot.geometry)
    pairs = list(zip(cells, worlds, strict=True))
    start = np.tile(before_scanner(robot), (len(cells), 1))
    if config.random_phase:
        for k, (cell, own) in enumerate(pairs):
            random = generator(own.config.seed, f"phase {cell.key}")
            start[k] = on_circle(robot, cell.radius, random.uniform(0, 2 * np.pi))
    grounds = [own.ground for own in worlds]
    errors = np.array([own.radius_error for own in worlds])
    fleet = Fleet(robot, start, grounds, errors, world.drive, config.threads, world.pull)
    noise = [generator(own.config.seed, f"grid {cell.key}") for cell, own in pairs]
    feed = ScannerFeed(config.scanner, fleet, noise, world.obstacles, kept)
    twist = np.array([(cell.speed, cell.speed / cell.radius) for cell in cells])
    omega = sprocket_speeds(twist, 0.0, robot.geometry)
    descriptions = []
    for cell, own in pairs:
        command = {"radius": cell.radius, "speed": cell.speed}
        metadata = {**command, **cell.metadata, **own.metadata(config.localization)}
        descriptions.append(Description(cell.name, metadata))
    method = locator(config.localization, robot)
    return open_loop(fleet, omega, config.duration, feed, method, descriptions, progress, watch)


def require_radius(radius: float, geometry: RobotGeometry) -> None:
    """Raise InvalidValueError for a radius [m] too small for the robot."""
    if radius <= geometry.half_gauge:
        allowed = (
            f"greater than the half gauge, {geometry.half_gauge:g} m: else the inner track "
            "must stand or reverse"
        )
        raise InvalidValueError("radii", radius, allowed)


def before_scanner(robot: Robot) -> Array:
    """The pose (3,) [m, m, rad] at CLEARANCE from the scanner where a left turn is closest to the
    scanner.
    """
    return se2.compose(robot.lrf_mount, [CLEARANCE, 0.0, -np.pi / 2])


def on_circle(robot: Robot, radius: float, phase: float) -> Array:
    """The pose (3,) [m, m, rad] at `phase` [rad] on a circle in front of the scanner.

    The circle is a left turn commanded with `radius` [m], and widened by slip. It is placed so that
    a robot on it comes no closer to the scanner than CLEARANCE.
    """
    driven = _DRIVEN_OVER_COMMANDED * radius
    centre = se2.compose(robot.lrf_mount, [CLEARANCE + driven, 0.0, phase - np.pi / 2])
    return se2.compose(centre, [0.0, -driven, 0.0])
