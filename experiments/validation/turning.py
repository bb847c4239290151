"""Steady turns against theory: slip and ICRs over radius, speed, friction, contact length and centre of mass."""

import contextlib
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from sim.drive.drive import Drive, tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.instruments import use_default_contact
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array, limit_sprocket_speeds, sprocket_speeds, track_slip
from trackslip.paper import COMMANDED_RADII, SPEEDS
from trackslip.skid_theory import line_contact, steady_twist

RATIOS = (0.7, 0.9, 1.4)
"""Friction across / along, in addition to the ground's own [-]."""
LENGTHS = (0.75, 1.0, 1.25)
"""Contact lengths relative to the robot's [-]."""
CENTRES_OF_MASS = ((0.0, 0.0), (0.05, 0.0), (0.0, 0.1), (-0.05, 0.1))
"""Shifts of the centre of mass: forward / contact length, and left / half gauge [-]."""
STEADY = 1.5
"""Time until the robots turn steadily [s]."""
WATCH = 0.5
"""Time over which their twists are then averaged, because MuJoCo's default contact shakes [s]."""
_SHIPPED = RobotParameters()


@dataclass(frozen=True)
class Turns:
    """M steady turns, simulated and by theory."""

    radius: Array  # (M,) commanded [m]
    speed: Array  # (M,) commanded [m/s]
    ratio: Array  # (M,) friction across / along [-]
    length: Array  # (M,) of contact [m]
    centre_of_mass: Array  # (M, 2) forward and left [m]
    half_width: Array  # (M,) b + D, half the distance between the tracks' ICRs [m]
    expected_half_width: Array  # (M,) by theory [m]
    slip: Array  # (M, 2) [-]
    expected_slip: Array  # (M, 2) by theory [-]
    lateral: Array  # (M,) lateral speed [m/s]
    expected_lateral: Array  # (M,) by theory [m/s]

    @property
    def icr_error(self) -> Array:
        """Relative error of b + D, (M,) [-]."""
        return self.half_width / self.expected_half_width - 1

    @property
    def slip_error(self) -> Array:
        """Error of the slip, (M, 2) [-]."""
        return self.slip - self.expected_slip


def turn(
    parameters: RobotParameters, ground: Ground, threads: int, default_contact: bool, progress: Callable[[float], None]
) -> Turns:
    """Turn a robot and its variants in length and centre of mass on the grid given by the constants above.

    The radii are the paper's, scaled with the robot's width. `progress` is called with shares that add up to 1.
    """
    robots = list(variants(parameters))
    parts = []
    for variant in robots:
        parts.append(_turn_variant(variant, ground, threads, default_contact))
        progress(1 / len(robots))
    return Turns(*(np.concatenate(columns) for columns in zip(*(vars(part).values() for part in parts), strict=True)))


def variants(parameters: RobotParameters) -> Iterator[RobotParameters]:
    """The robot with other lengths and centres of mass, without those that would lift part of a track."""
    for length, (forwards, left) in itertools.product(LENGTHS, CENTRES_OF_MASS):
        contact_length = length * parameters.contact_length
        com_x = parameters.com_x + forwards * contact_length
        com_y = parameters.com_y + left * parameters.half_gauge
        with contextlib.suppress(InvalidValueError):
            yield replace(parameters, contact_length=contact_length, com_x=com_x, com_y=com_y)


def _turn_variant(parameters: RobotParameters, ground: Ground, threads: int, default_contact: bool) -> Turns:
    robot = load_robot(parameters=parameters)
    if default_contact:
        use_default_contact(robot.model)
    along, ratios = ground.along, sorted({*RATIOS, ground.across / ground.along})
    radii = np.array(COMMANDED_RADII) * parameters.half_gauge / _SHIPPED.half_gauge
    ratio, radius, speed = np.array(list(itertools.product(ratios, radii, SPEEDS))).T
    commanded = sprocket_speeds(np.stack([speed, speed / radius], axis=-1), 0.0, robot.geometry)
    omega = limit_sprocket_speeds(commanded, Drive().top_speed / robot.geometry.sprocket_radius)
    grounds = [Ground(along, along * r) for r in ratio]
    fleet = Fleet(robot, np.zeros((len(omega), 3)), grounds, parameters.radius_error, tireless(), threads)
    fleet.command(omega)
    fleet.advance(STEADY)
    twists = []
    for _ in range(round(WATCH / fleet.period)):
        fleet.advance(fleet.period)
        twists.append(fleet.twist())
    belts = omega * parameters.sprocket_radius * (1 + parameters.radius_error)
    twist, expected = np.mean(twists, axis=0), _theory(parameters, along, ratio, belts)
    spread = belts[:, 1] - belts[:, 0]
    return Turns(
        radius=radius,
        speed=speed,
        ratio=ratio,
        length=np.full(len(omega), parameters.contact_length),
        centre_of_mass=np.tile([parameters.com_x, parameters.com_y], (len(omega), 1)),
        half_width=spread / (2 * twist[:, 2]),
        expected_half_width=spread / (2 * expected[:, 2]),
        slip=track_slip(omega, twist[:, [0, 2]], robot.geometry),
        expected_slip=track_slip(omega, expected[:, [0, 2]], robot.geometry),
        lateral=twist[:, 1],
        expected_lateral=expected[:, 1],
    )


def _theory(parameters: RobotParameters, along: float, ratio: Array, belts: Array) -> Array:
    """Twists (M, 3) by theory, of line contacts loaded by weight and momentum."""
    centre = (parameters.com_x, parameters.com_y, parameters.com_height)
    twist = np.empty((len(ratio), 3))
    for value in np.unique(ratio):
        size = parameters.half_gauge, parameters.contact_length / 2
        contact = line_contact(*size, along, along * value, centre, points=100)
        rows = ratio == value
        twist[rows] = steady_twist(belts[rows], contact, 9.81)
    return twist
