"""The simulated world that a command's options describe: robot, ground, drives, scanner,
obstacles.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

from experiments.common.plain_json import plain
from experiments.simulate.options import PullOptions, Simulation
from sim.engine.simulations import steps_in
from sim.fleet.fleet import Fleet
from sim.ground.ground import Ground, load_ground
from sim.ground.pull import Pull
from sim.motors.motor import Drive
from sim.robot.named import load_parameters
from sim.robot.parameters import RobotParameters
from sim.robot.robot import Robot, load_robot
from sim.scanner.scanner import Obstacles, load_obstacles
from trackslip.kinematics import Array

FileReader = Callable[[str, str | None, str | None], tuple[RobotParameters, Ground, Obstacles]]


def read_files(
    robot: str, ground: str | None, obstacles: str | None
) -> tuple[RobotParameters, Ground, Obstacles]:
    """Read a robot, a ground (None for the robot's own) and obstacles, by their names or files."""
    parameters, own_ground = load_parameters(robot)
    chosen = own_ground if ground is None else load_ground(ground)
    return parameters, chosen, Obstacles() if obstacles is None else load_obstacles(obstacles)


@dataclass(frozen=True)
class Specification:
    """A world with its files read and its names resolved, but no model compiled."""

    parameters: RobotParameters
    ground: Ground
    radius_error: float
    """Relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    obstacles: Obstacles
    pull: Pull = field(metadata={"stored_unless": PullOptions()})

    @classmethod
    def of(cls, config: Simulation) -> "Specification":
        """Read the files that the options name; raises TrackslipError for a file or name that does
        not exist.
        """
        return Specification.read(config, read_files)

    @staticmethod
    def read(config: Simulation, read: FileReader) -> "Specification":
        """Read the files as `of` does, with `read_files` or a cached version of it."""
        parameters, ground, obstacles = read(config.robot, config.ground.source, config.obstacles)
        error = parameters.radius_error if config.radius_error is None else config.radius_error
        return Specification(
            parameters, config.ground.changed(ground), error, obstacles, config.pull
        )


@dataclass(frozen=True)
class World(Specification):
    """A specified world with its model compiled."""

    config: Simulation
    robot: Robot

    @classmethod
    def of(cls, config: Simulation, specification: Specification | None = None) -> Self:
        """Build the world of a command; raises TrackslipError for a file or name that does not
        exist.

        Raises InvalidValueError for a servo period that is not a multiple of the robot's physics
        step.
        """
        if specification is None:
            config.require_load()
        given = specification or Specification.of(config)
        world = cls(**vars(given), config=config, robot=_compiled(given.parameters, config.rrd))
        config.check(world.drive)
        steps_in(
            "drive.period", world.drive.period, "the physics step", world.robot.model.opt.timestep
        )
        return world

    @property
    def drive(self) -> Drive:
        """The robot's drive, with the properties that the options change."""
        return self.config.drive.changed(self.parameters.drive)

    def fleet(self, start: Array, grounds: Sequence[Ground] | None = None) -> Fleet:
        """Robots at the poses `start` (N, 3) [m, m, rad], all on the world's ground, or each on one
        of `grounds`.
        """
        threads = self.config.threads
        ground = grounds or self.ground
        return Fleet(self.robot, start, ground, self.radius_error, self.drive, threads, self.pull)

    def metadata(self, localization: str) -> dict[str, Any]:
        """The metadata of every run simulated in this world."""
        measured = {
            "geometry": self.robot.geometry,
            "plate": self.robot.plate,
            "lrf": {"mount": self.robot.lrf_mount},
            "radius_error": self.radius_error,
            "scanner": self.config.scanner,
            "localization": localization,
        }
        return plain(measured | self.about)

    @property
    def about(self) -> dict[str, Any]:
        """The world's entries in a command's manifest."""
        towed = {"pull": self.pull} if self.pull.force > 0 else {}
        return {
            "seed": self.config.seed,
            "model_sha256": self.robot.digest,
            "ground": self.ground,
            "obstacles": self.obstacles,
            "robot": self.parameters,
            "drive": self.drive,
            **towed,
        }


@functools.lru_cache(maxsize=8)
def _compiled(parameters: RobotParameters, contact_sensors: bool) -> Robot:
    return load_robot(parameters=parameters, contact_sensors=contact_sensors)
