"""The runs of a grid, each with everything that determines its numbers except code and model."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from experiments.common.manifest import digest
from experiments.common.options import with_option
from experiments.grid.axes import axes_of, of_file, option_name
from experiments.grid.config import Config
from experiments.simulate.grid_runs import GridCell, require_radius
from experiments.simulate.world import FileReader, Specification, World, read_files
from trackslip.errors import InvalidValueError, SettingsFileError

# options that a fleet shares
_IN_COMMON: Final = ("scanner", "duration", "localization", "motion", "random_phase")


@dataclass(frozen=True)
class Setting:
    """Everything shared by the runs of one grid, which differ only in radius and speed."""

    axes: Mapping[str, Any]
    """The grid's values on the other axes of the sweep, by name."""
    config: Config
    specification: Specification
    id: str
    """Hash of everything that a run's numbers depend on, except radius, speed and seed."""
    fleet: str
    """Hash of everything that a fleet's runs share, including whether the ground shears, which
    changes the pads.
    """
    scans: str
    """Hash of everything that the scans depend on, except radius, speed and seed."""


@dataclass(frozen=True)
class PlannedRun:
    """A planned run of a grid."""

    cell: GridCell
    """The run's command, and the key for its random numbers.

    Random numbers depend on the measurement (seed, radius, speed, world), not on its evaluation:
    runs that differ only in their localization or motion method share their scans.
    """
    axes: Mapping[str, Any]
    """Values of all axes, by name."""
    setting: Setting
    id: str
    """Hash of the run's setting, radius, speed, seed and recording, regardless of how the run was
    requested.
    """

    @property
    def name(self) -> str:
        """The run's radius and speed, and its values on the other axes."""
        return self.cell.name

    @property
    def fleet(self) -> str:
        """Key shared by runs that can be driven together."""
        return self.setting.fleet

    @property
    def duration(self) -> float:
        """Simulated time [s]."""
        return self.setting.config.duration

    def world(self, threads: int) -> World:
        """The run's compiled world, for a fleet on `threads` worker threads."""
        own = replace(
            self.setting.config,
            radii=(self.cell.radius,),
            speeds=(self.cell.speed,),
            threads=threads,
        )
        return World.of(own, self.setting.specification)


def plan(config: Config) -> list[PlannedRun]:
    """All runs of a grid or sweep; raises TrackslipError for invalid values, before any run is
    driven.
    """
    in_file = of_file(config)
    try:
        return _planned(config)
    except InvalidValueError as error:
        fields = {option_name(axis) or axis.removeprefix("robot.") for axis in in_file}
        if "friction_ratio" in in_file:
            fields.add("across")
        if error.field in fields | set(in_file):
            raise SettingsFileError(f"{config.sweep}: {error}") from error
        raise


def _planned(config: Config) -> list[PlannedRun]:
    axes = axes_of(config)
    radii = axes.pop("radius")
    speeds = axes.pop("speed")
    base = replace(config, radii=radii, speeds=speeds)
    read = functools.cache(read_files)
    grids = [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
    settings = [_setting(grid, base, read) for grid in grids]
    robots = [setting.specification.parameters for setting in settings]
    narrowest = min(robots, key=lambda robot: robot.half_gauge)
    # if a radius is too small for only some of the robots, just those runs fail
    for radius in radii:
        require_radius(radius, narrowest.geometry)
    commands = list(itertools.product(radii, speeds))
    return [_run(setting, radius, speed) for setting in settings for radius, speed in commands]


def _setting(axes: Mapping[str, Any], config: Config, read: FileReader) -> Setting:
    """The setting of a grid: options and world, changed to the grid's values on the axes."""
    for axis, value in axes.items():
        if name := option_name(axis):
            config = with_option(config, name, value)
    if "pull.force" not in axes:
        config.require_load()
    world = Specification.read(config, read)
    prefix = "robot."
    of_robot = [axis for axis in axes if axis.startswith(prefix)]
    changed = {axis.removeprefix(prefix): axes[axis] for axis in of_robot}
    robot = replace(world.parameters, **changed)
    ground = world.ground
    if "friction_ratio" in axes:
        ground = replace(ground, across=axes["friction_ratio"] * ground.along)
    world = replace(world, parameters=robot, ground=ground)
    drive = config.drive.changed(robot.drive)
    config.check(drive)
    shared = {name: getattr(config, name) for name in _IN_COMMON}
    shared["drive"] = drive
    shape = replace(robot, radius_error=0.0)
    shears = ground.largest_shear > 0
    return Setting(
        axes=axes,
        config=config,
        specification=world,
        id=digest([shared, world]),
        fleet=digest([shared, shape, world.obstacles, world.pull, shears]),
        scans=digest([drive, config.scanner, world]),
    )


@functools.cache
def _shipped_scans() -> str:
    return _setting({}, Config(), read_files).scans


def _run(setting: Setting, radius: float, speed: float) -> PlannedRun:
    config = setting.config
    command = GridCell.at(radius, speed)
    id = digest([setting.id, (radius,), (speed,), config.seed, (config.rrd, config.bag)])
    values = sorted(f"{axis}={value}" for axis, value in setting.axes.items())
    name = " ".join([command.name, *values])
    # a grid in the shipped world has the same scans as `reproduce`
    is_shipped = setting.scans == _shipped_scans()
    key = command.key if is_shipped else f"{command.key} {setting.scans}"
    axes = {**setting.axes, "radius": radius, "speed": speed}
    return PlannedRun(GridCell(name, key, radius, speed, {"id": id}), axes, setting, id)
