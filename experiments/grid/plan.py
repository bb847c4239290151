"""The runs of a grid, each with everything that its numbers depend on except code and model."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from experiments.common.choices import SHIPPED
from experiments.common.manifest import digest
from experiments.common.options import Whole, option, with_option
from experiments.grid.axes import ALIASES, axes_of
from experiments.grid.config import Config
from experiments.simulate.grid_options import GridConfig
from experiments.simulate.grid_runs import GridCell, require_motors, require_radius
from experiments.simulate.world import Specification, World, WorldFiles
from sim.drive.drive import Drive
from trackslip.errors import InvalidValueError

_DRIVEN = ("radius", "speed")
_OF_A_RUN = (*_DRIVEN, "seed")  # axes on which the runs of a setting differ
_IN_COMMON = ("scanner", "duration", "localization", "motion", "random_phase")  # options that a fleet shares


@dataclass(frozen=True)
class SweepSetting:
    """Settings shared by runs that differ only in radius, speed and seed."""

    config: GridConfig
    """Its options, with all radii and speeds."""
    specification: Specification
    kept: bool
    """Keep all ranges of the scans in the logs."""

    @functools.cached_property
    def drive(self) -> Drive:
        """The robot's drive, with the properties that the options change."""
        return self.config.drive.changed(self.specification.parameters.drive)

    @functools.cached_property
    def id(self) -> str:
        """Hash of all that the numbers of a run depend on, besides radius, speed and seed."""
        return digest([self._in_common, self.specification])

    @functools.cached_property
    def world_key(self) -> str:
        """Key of the random numbers in worlds other than `reproduce`'s, whose scans a default grid repeats."""
        world = _world_digest(self)
        return "" if world == _shipped_world_digest() else f" {world}"

    @functools.cached_property
    def fleet(self) -> str:
        """Hash of what the runs of a fleet share; robots on ground that shears have other pads."""
        world = self.specification
        shape = replace(world.parameters, radius_error=0.0)
        return digest([self._in_common, shape, world.obstacles, world.pull, world.ground.largest_shear > 0])

    @property
    def _in_common(self) -> dict[str, Any]:
        return {name: getattr(self.config, name) for name in _IN_COMMON} | {"drive": self.drive}


def _world_digest(setting: SweepSetting) -> str:
    return digest([setting.drive, setting.config.scanner, setting.specification])


@functools.cache
def _shipped_world_digest() -> str:
    """Of the shipped robot, ground and scanner, in which a grid meets the scans of `reproduce`."""
    return _world_digest(SweepSetting(GridConfig(), Specification.of(GridConfig()), kept=False))


@dataclass(frozen=True)
class PlannedRun:
    """One run of a grid."""

    cell: GridCell
    """Its command, and the key of its random numbers.

    They follow from what is measured (seed, radius, speed and world), not from how the measurements are evaluated: runs
    that differ only in their method of localization or motion share their scans.
    """
    axes: Mapping[str, Any]
    """Values of the axes, by name."""
    seed: int
    setting: SweepSetting
    id: str
    """Hash of what the run is and of how much of it is recorded, however it was requested."""

    @property
    def name(self) -> str:
        """Its radius and speed, and every axis on which it differs from the options."""
        return self.cell.name

    @property
    def fleet(self) -> str:
        """See Planned."""
        return self.setting.fleet

    @property
    def duration(self) -> float:
        """Simulated time [s]."""
        return self.setting.config.duration

    def world(self, threads: int) -> World:
        """Its compiled world, for a fleet on that many worker threads."""
        radii, speeds = (self.cell.radius,), (self.cell.speed,)
        own = replace(self.setting.config, radii=radii, speeds=speeds, seed=self.seed, threads=threads)
        return World.of(own, self.setting.specification)

    @property
    def grid(self) -> tuple[tuple[str, Any], ...]:
        """The axes other than radius and speed: the grid that the run belongs to."""
        return tuple((name, value) for name, value in self.axes.items() if name not in _DRIVEN)


def plan(config: Config) -> list[PlannedRun]:
    """Every run; raises TrackslipError for invalid values, before anything is driven."""
    axes = axes_of(config)
    Whole().check("seed", axes.get("seed", ()))
    base = GridConfig(**{f.name: getattr(config, f.name) for f in dataclasses.fields(GridConfig)})
    base = replace(base, radii=axes["radius"], speeds=axes["speed"])
    files = WorldFiles()
    given = files.specification(base)
    usual = {name: _usual(base, given, name) for name in axes if name not in _DRIVEN}
    settings: dict[tuple[Any, ...], SweepSetting] = {}
    runs = []
    for values in itertools.product(*axes.values()):
        taken = dict(zip(axes, values, strict=True))
        shared = tuple(value for name, value in taken.items() if name not in _OF_A_RUN)
        if shared not in settings:
            settings[shared] = _setting(base, taken, files, config.bag)
        runs.append(_run(taken, usual, settings[shared]))
    narrowest = min((one.specification.parameters for one in settings.values()), key=lambda one: one.half_gauge)
    for radius in axes["radius"]:  # a radius too tight for only some of the robots is a run that fails
        require_radius(radius, narrowest.geometry)
    driven = list(itertools.product(axes["radius"], axes["speed"]))
    require_motors(driven, ((one.specification, one.drive) for one in settings.values()))
    return runs


def _run(taken: Mapping[str, Any], usual: Mapping[str, Any], setting: SweepSetting) -> PlannedRun:
    radius, speed, seed = taken["radius"], taken["speed"], taken.get("seed", setting.config.seed)
    unusual = [f"{name}={taken[name]}" for name, value in usual.items() if value != taken[name]]
    id = digest([setting.id, (radius,), (speed,), seed, (setting.config.rrd, setting.kept)])
    plain = GridCell.at(radius, speed)
    name, key = " ".join([plain.name, *sorted(unusual)]), plain.key + setting.world_key
    return PlannedRun(GridCell(name, key, radius, speed, {"id": id}), taken, seed, setting, id)


def _setting(base: GridConfig, taken: Mapping[str, Any], files: WorldFiles, kept: bool) -> SweepSetting:
    """The options and the world of a run, with its own robot and ratio of friction."""
    config = base
    for name, value in taken.items():
        if name not in (*_OF_A_RUN, "friction_ratio") and not name.startswith("robot."):
            config = with_option(config, ALIASES.get(name, name), value)
    given = files.specification(config)
    changed = {name.removeprefix("robot."): value for name, value in taken.items() if name.startswith("robot.")}
    try:
        parameters = replace(given.parameters, **changed)
    except InvalidValueError as error:
        raise InvalidValueError(f"robot.{error.field}", error.value, error.allowed) from error
    ground = given.ground
    if "friction_ratio" in taken:
        ground = replace(ground, across=taken["friction_ratio"] * ground.along)
    setting = SweepSetting(config, replace(given, parameters=parameters, ground=ground), kept)
    config.check(setting.drive)
    return setting


def _usual(base: GridConfig, given: Specification, axis: str) -> Any:
    """The value of an axis without the sweep."""
    room, _, name = ALIASES.get(axis, axis).rpartition(".")
    match room, name:
        case _, "friction_ratio":
            return None
        case "ground", "source":
            return base.ground.source or ("stone" if base.robot == SHIPPED else None)
        case "ground", _:
            return getattr(given.ground, name)
        case "robot", _:
            return getattr(given.parameters, name)
        case _, "radius_error":
            return given.radius_error
        case "drive" | "drive.motor", _:
            return option(base.drive.changed(given.parameters.drive), ALIASES.get(axis, axis).partition(".")[2])
    return option(base, axis)
