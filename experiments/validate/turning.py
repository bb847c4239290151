"""Steady turns over radius, speed, friction, contact length and centre of mass."""

import itertools
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from experiments.validate.theory import (
    GRAVITY,
    SimulatedTurns,
    belt_speeds,
    contact,
    joined,
    mean_twist,
    paper_turns,
    turning_sprockets,
    turns_of,
)
from sim.contact_forces import use_default_contact
from sim.drive.drive import tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.errors import InvalidValueError, RobotWarning
from trackslip.kinematics import Array
from trackslip.skid_theory import steady_twist

RATIOS = (0.7, 0.9, 1.4)
"""Friction across / along, in addition to the ground's own [-]."""
LENGTHS = (0.75, 1.0, 1.25)
"""Contact lengths relative to the robot's [-]."""
CENTRES_OF_MASS = ((0.0, 0.0), (0.05, 0.0), (0.0, 0.1), (-0.05, 0.1))
"""Shifts of the centre of mass: forward / contact length, and left / half gauge [-]."""
_STEADY = 1.5  # time until the robots turn steadily [s]


@dataclass(frozen=True)
class VariedTurns(SimulatedTurns):
    """M turns of a robot and its variants in length and centre of mass."""

    radius: Array  # (M,) commanded [m]
    speed: Array  # (M,) commanded [m/s]
    ratio: Array  # (M,) friction across / along [-]
    length: Array  # (M,) of contact [m]
    centre_of_mass: Array  # (M, 2) forward and left [m]

    def own(self, parameters: RobotParameters) -> np.ndarray:
        """Mask (M,) of the robot's own turns, without variants."""
        off = self.centre_of_mass - [parameters.com_x, parameters.com_y]
        distance = np.hypot(np.hypot(*off.T), self.length - parameters.contact_length)
        return np.asarray(distance <= distance.min() + 1e-9)

    def nearest_ratio(self, ground: Ground) -> float:
        """The friction ratio nearest to a ground's [-]."""
        ratios = np.unique(self.ratio)
        return float(ratios[np.argmin(np.abs(ratios - ground.across / ground.along))])

    def expected_twist(self, parameters: RobotParameters) -> Array:
        """Forward speed [m/s] and yaw rate [rad/s] by theory, (M, 2)."""
        # from the ICRs and the outer track's slip, because an inner track that stands still has no slip
        omega = turning_sprockets(parameters, self.radius, self.speed)
        belts = belt_speeds(parameters, omega)
        yaw_rate = (belts[:, 1] - belts[:, 0]) / (2 * self.expected_half_width)
        outer = parameters.sprocket_radius * omega[:, 1] * (1 - self.expected_slip[:, 1])
        return np.stack([outer - parameters.half_gauge * yaw_rate, yaw_rate], axis=-1)


def turn(
    parameters: RobotParameters, ground: Ground, threads: int, default_contact: bool, progress: Callable[[float], None]
) -> VariedTurns:
    """Turn a robot and its variants on the grid given by the constants above and the paper's radii and speeds.

    `progress` is called with shares that add up to 1.
    """
    robots = list(variants(parameters))
    parts = []
    for variant in robots:
        parts.append(_turn_variant(variant, ground, threads, default_contact))
        progress(1 / len(robots))
    return joined(parts)


def variants(parameters: RobotParameters) -> Iterator[RobotParameters]:
    """The robot with other lengths and centres of mass, without those that would lift part of a track."""
    for length, (forwards, left) in itertools.product(LENGTHS, CENTRES_OF_MASS):
        contact_length = length * parameters.contact_length
        com_x = parameters.com_x + forwards * contact_length
        com_y = parameters.com_y + left * parameters.half_gauge
        try:
            with warnings.catch_warnings(action="ignore", category=RobotWarning):  # the robot's own is enough
                variant = replace(parameters, com_x=0.0, com_y=0.0).with_contact_length(contact_length)
                variant = replace(variant, com_x=com_x, com_y=com_y)
        except InvalidValueError:
            continue
        yield variant


def _turn_variant(parameters: RobotParameters, ground: Ground, threads: int, default_contact: bool) -> VariedTurns:
    robot = load_robot(parameters=parameters)
    if default_contact:
        use_default_contact(robot.model)
    ratios = sorted({*RATIOS, ground.across / ground.along})
    radius, speed = (np.tile(one, len(ratios)) for one in paper_turns(parameters))
    ratio = np.repeat(ratios, len(radius) // len(ratios))
    omega = turning_sprockets(parameters, radius, speed)
    grounds = [Ground(ground.along, ground.along * r) for r in ratio]
    fleet = Fleet(robot, np.zeros((len(omega), 3)), grounds, parameters.radius_error, tireless(), threads)
    fleet.command(omega)
    twist, belts = mean_twist(fleet, _STEADY), belt_speeds(parameters, omega)
    by_ratio = [
        steady_twist(belts[ratio == r], contact(parameters, Ground(ground.along, ground.along * r)), GRAVITY)
        for r in ratios
    ]
    return VariedTurns(
        **vars(turns_of(parameters, omega, twist, np.concatenate(by_ratio))),
        radius=radius,
        speed=speed,
        ratio=ratio,
        length=np.full(len(omega), parameters.contact_length),
        centre_of_mass=np.tile([parameters.com_x, parameters.com_y], (len(omega), 1)),
    )
