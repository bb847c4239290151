"""The simulated world that a command's options describe: robot, ground, drives, scanner, obstacles."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from experiments.common.plain_json import plain
from experiments.simulate.options import Simulation
from sim.drive.drive import Drive
from sim.drive.pull import Pull
from sim.fleet import Fleet, substeps
from sim.ground.ground import Ground
from sim.ground.named import load_ground
from sim.robot.named import load_parameters
from sim.robot.parameters import RobotParameters
from sim.robot.robot import Robot, load_robot
from sim.scanner.feed import ScannerFeed
from sim.scanner.obstacles import Obstacles, load_obstacles
from trackslip.kinematics import Array


@dataclass(frozen=True)
class Specification:
    """A world with its files read and its names resolved, but no model compiled."""

    parameters: RobotParameters
    ground: Ground
    radius_error: float
    """Relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    obstacles: Obstacles
    pull: Pull = field(metadata={"stored_unless": Pull()})

    @classmethod
    def of(cls, config: Simulation) -> "Specification":
        """Read the files that the options name; raises TrackslipError for a file or name that does not exist."""
        return WorldFiles().specification(config)


class WorldFiles:
    """Robots, grounds and obstacles by name or file; each file is read once."""

    def __init__(self) -> None:
        self._robot = functools.cache(load_parameters)
        self._ground = functools.cache(load_ground)
        self._obstacles = functools.cache(load_obstacles)

    def specification(self, config: Simulation) -> Specification:
        """The world that the options name; raises TrackslipError for a file or name that does not exist."""
        parameters, ground = self._robot(config.robot)
        if config.ground.source is not None:
            ground = self._ground(config.ground.source)
        obstacles = Obstacles() if config.obstacles is None else self._obstacles(config.obstacles)
        error = parameters.radius_error if config.radius_error is None else config.radius_error
        return Specification(parameters, config.ground.changed(ground), error, obstacles, config.pull.pull())


@dataclass(frozen=True)
class World(Specification):
    """A specified world with its model compiled."""

    config: Simulation
    robot: Robot

    @classmethod
    def of(cls, config: Simulation, specification: Specification | None = None) -> Self:
        """Build the world of a command; raises TrackslipError for a file or name that does not exist.

        Raises InvalidValueError for a servo period that is not a multiple of the robot's physics step.
        """
        given = specification or Specification.of(config)
        world = cls(**vars(given), config=config, robot=_compiled(given.parameters, config.rrd))
        config.check(world.drive)
        substeps(world.drive, world.robot)
        return world

    @property
    def drive(self) -> Drive:
        """The robot's drive, with the properties that the options change."""
        return self.config.drive.changed(self.parameters.drive)

    def fleet(self, start: Array, grounds: Sequence[Ground] | None = None) -> Fleet:
        """Robots at the poses `start` (N, 3) [m, m, rad], all on the world's ground, or each on one of `grounds`."""
        threads, ground = self.config.threads, grounds or self.ground
        return Fleet(self.robot, start, ground, self.radius_error, self.drive, threads, self.pull)

    def feed(
        self,
        fleet: Fleet,
        generators: Sequence[np.random.Generator],
        kept: bool = False,
        noise: ArrayLike | None = None,
    ) -> ScannerFeed:
        """The scanner in front of a fleet, with one random number generator per robot; the others: see ScannerFeed."""
        return ScannerFeed(self.config.scanner, fleet, generators, self.obstacles, kept, noise)

    def metadata(self, localization: str) -> dict[str, Any]:
        """The metadata of every run simulated in this world."""
        return plain(
            {
                "geometry": self.robot.geometry,
                "robot": self.parameters,
                "plate": self.robot.plate,
                "lrf": {"mount": self.robot.lrf_mount},
                "ground": self.ground,
                "radius_error": self.radius_error,
                **self._towed,
                "drive": self.drive,
                "scanner": self.config.scanner,
                "obstacles": self.obstacles,
                "localization": localization,
                "seed": self.config.seed,
                "model_sha256": self.robot.digest,
            }
        )

    @property
    def about(self) -> dict[str, Any]:
        """The world's entries in the manifest of a command."""
        more = {"ground": self.ground, "obstacles": self.obstacles, "robot": self.parameters, "drive": self.drive}
        return {"seed": self.config.seed, "model_sha256": self.robot.digest, **more, **self._towed}

    @property
    def _towed(self) -> dict[str, Pull]:
        """The pull by name, if there is one."""
        return {"pull": self.pull} if self.pull.force > 0 else {}


@functools.lru_cache(maxsize=8)
def _compiled(parameters: RobotParameters, contact_sensors: bool) -> Robot:
    return load_robot(parameters=parameters, contact_sensors=contact_sensors)
