"""Plants of a benchmark: robots, grounds and scanners that differ from those the laws were identified on."""

from dataclasses import replace

import numpy as np

from experiments.common.lookup import reference
from experiments.simulate.closed_loop import Plant
from experiments.simulate.world import World
from sim.drive.drive import Drive
from sim.ground.ground import Ground
from sim.path_tracking.randomization import Randomization
from sim.robot.parameters import RobotParameters
from sim.seeds import generator

_NOISE = (0.5, 2.0)  # range of the factor on the scanner's noise [-]
_SPACING = 0.05  # of the points of a path that patches may lie on [s]


def plant_ranges(robot: RobotParameters, drive: Drive) -> Randomization:
    """The ranges, around a robot and its drive, from which every property is drawn uniformly and on its own.

    Raises InvalidValueError for a robot so near the limits that it could not stand, or be simulated.
    """
    nominal, lag, shift = robot.radius_error, drive.lag, 0.1 * robot.half_gauge
    ranges = Randomization(
        friction_ratio=(0.8, 1.25),
        radius_error=(nominal - 0.03, nominal + 0.03),
        com_x=(-shift, shift),
        com_y=(-shift, shift),
        lag=(0.5 * lag, min(2.0 * lag, 1.0)),
        patches=(0, 2),
        patch_size=(0.3, 1.0),
        patch_friction=(0.5, 1.0),
    )
    ranges.require_standing(robot)
    return ranges


def draw_plant(world: World, name: str, ground: Ground, seed: int, key: str) -> Plant:
    """The plant of a run on the reference called `name`, the same for every controller and compensation."""
    rng, path = generator(seed, f"plant {key}"), reference(name)
    poses = path.pose(np.arange(0.0, path.duration, _SPACING))
    robot = replace(world.parameters, radius_error=world.radius_error)
    setting = plant_ranges(robot, world.drive).setting(rng, robot, world.drive, ground, poses)
    return Plant(setting, world.config.scanner.noise * float(rng.uniform(*_NOISE)))
