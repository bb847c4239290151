"""The runs of a sweep, each with everything that its numbers depend on except code and model."""

import dataclasses
import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from experiments.driving.grid_runs import Cell, require_radius
from experiments.driving.world import Specification, World
from experiments.options.grid import GridConfig, SweepConfig
from experiments.storage.manifest import digest
from experiments.sweep.axes import axes_of
from experiments.sweep.options import ALIASES, option, with_option
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry

_MIN_FLEET, _MAX_FLEET = 64, 128
"""Robots in a fleet: smaller fleets are slow; larger ones hardly gain, and lose more when a worker is stopped."""
_EACH = 4
"""Minimum number of fleets per worker, so that all end at about the same time, unless fleets would be too small."""
_DRIVEN = ("radius", "speed")


@dataclass(frozen=True)
class Run:
    """One run of a sweep."""

    name: str
    """Its radius and speed, and every axis on which it differs from the options."""
    axes: Mapping[str, Any]
    """Values of the axes, by name."""
    config: GridConfig
    """Its options, with one radius and one speed."""
    specification: Specification

    @functools.cached_property
    def id(self) -> str:
        """Hash of what the run is and of how much of it is recorded, however it was requested."""
        setting = digest([_in_common(self.config), self.specification])
        return digest([setting, self.config.radii, self.config.speeds, self.config.seed, self.config.rrd])

    @property
    def cell(self) -> Cell:
        """What to drive.

        Its random numbers follow from what is measured (seed, radius, speed and world), not from how the measurements
        are evaluated: runs that differ only in their method of localization or motion share their scans.
        """
        radius, speed = self.config.radii[0], self.config.speeds[0]
        key, world = Cell.at(radius, speed).key, _world_digest(self.config, self.specification)
        if world != _shipped_world_digest():
            key += f" {world}"
        return Cell(self.name, key, radius, speed, {"id": self.id})

    def world(self, threads: int) -> World:
        """Its compiled world, for a fleet on that many worker threads."""
        return World.of(replace(self.config, threads=threads), self.specification)

    @functools.cached_property
    def fleet(self) -> str:
        """Hash of what the runs of a fleet share."""
        shape = replace(self.specification.parameters, radius_error=0.0)
        return digest([shape, self.specification.obstacles, _in_common(self.config)])

    @property
    def grid(self) -> tuple[tuple[str, Any], ...]:
        """The axes other than radius and speed: the grid that the run belongs to."""
        return tuple((name, value) for name, value in self.axes.items() if name not in _DRIVEN)


def _world_digest(config: GridConfig, specification: Specification) -> str:
    return digest([config.drive, config.scanner, specification])


@functools.cache
def _shipped_world_digest() -> str:
    """Of the shipped robot, ground and scanner, in which a grid meets the scans of `reproduce`."""
    return _world_digest(GridConfig(), Specification.of(GridConfig()))


def _in_common(config: GridConfig) -> dict[str, Any]:
    """Options that the runs of a fleet share."""
    names = ("drive", "scanner", "duration", "localization", "motion", "random_phase")
    return {name: getattr(config, name) for name in names}


def plan(config: SweepConfig) -> list[Run]:
    """Every run; raises TrackslipError for invalid values, before anything is driven."""
    axes = axes_of(config)
    base = GridConfig(**{f.name: getattr(config, f.name) for f in dataclasses.fields(GridConfig)})
    usual = {name: _usual(base, name) for name in axes if name not in _DRIVEN}
    runs = []
    for values in itertools.product(*axes.values()):
        taken = dict(zip(axes, values, strict=True))
        own = _config(base, taken)
        unusual = [f"{name}={taken[name]}" for name, value in usual.items() if value != taken[name]]
        name = " ".join([Cell.at(taken["radius"], taken["speed"]).name, *sorted(unusual)])
        runs.append(Run(name, taken, own, _specification(own, taken)))
    narrowest = min((run.specification.parameters for run in runs), key=lambda parameters: parameters.half_gauge)
    for radius in axes["radius"]:  # a radius too tight for only some of the robots is a run that fails
        require_radius(radius, RobotGeometry(narrowest.half_gauge, narrowest.sprocket_radius))
    return runs


def fleets(runs: Sequence[Run], workers: int) -> list[tuple[Run, ...]]:
    """Runs that can be driven as one fleet, sized for that many workers, in order."""
    size = min(max(_MIN_FLEET, -(-len(runs) // (_EACH * workers))), _MAX_FLEET)
    alike: dict[str, list[Run]] = {}
    for run in runs:
        alike.setdefault(run.fleet, []).append(run)
    found = []
    for same in alike.values():
        count = -(-len(same) // size)
        ends = [round(len(same) * k / count) for k in range(count + 1)]
        found += [tuple(same[a:b]) for a, b in itertools.pairwise(ends)]
    return found


def _config(base: GridConfig, taken: Mapping[str, Any]) -> GridConfig:
    config = replace(base, radii=(taken["radius"],), speeds=(taken["speed"],))
    for name, value in taken.items():
        if name not in (*_DRIVEN, "friction_ratio") and not name.startswith("robot."):
            config = with_option(config, ALIASES.get(name, name), value)
    return config


def _specification(config: GridConfig, taken: Mapping[str, Any]) -> Specification:
    """The world of a run: that of its options, with its own robot and ratio of friction."""
    given = Specification.of(config)
    changed = {name.removeprefix("robot."): value for name, value in taken.items() if name.startswith("robot.")}
    try:
        parameters = replace(given.parameters, **changed)
    except InvalidValueError as error:
        raise InvalidValueError(f"robot.{error.field}", error.value, error.allowed) from error
    ground = given.ground
    if "friction_ratio" in taken:
        ground = replace(ground, across=taken["friction_ratio"] * ground.along)
    return replace(given, parameters=parameters, ground=ground)


def _usual(base: GridConfig, axis: str) -> Any:
    """The value of an axis without the sweep."""
    given, (room, _, name) = Specification.of(base), ALIASES.get(axis, axis).rpartition(".")
    match room, name:
        case _, "friction_ratio":
            return None
        case "ground", "source":
            return base.ground.source or ("stone" if base.robot is None else None)
        case "ground", _:
            return getattr(given.ground, name)
        case "robot", _:
            return getattr(given.parameters, name)
        case _, "radius_error":
            return given.radius_error
    return option(base, axis)
