"""The standing robot: contact loads, sink and lean; creep on slopes that hold it, sliding on those that do not."""

from dataclasses import dataclass

import numpy as np

from experiments.validation.theory import GRAVITY, paper_turns, turning_sprockets
from sim.contact_forces import read_contacts, use_default_contact
from sim.drive.drive import tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground, friction_angle
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.kinematics import Array
from trackslip.skid_theory import Contact

_SETTLE, _WATCH = 1.0, 5.0  # on a slope: settling time of the lean, and duration of the creep measurement after it [s]
_TILTED, _SLIDE = 0.3, 0.3  # beyond the friction angle: the same for acceleration [s]
HEADINGS = (0.0, np.pi / 4, np.pi / 2)
"""Headings of the parked robots: straight uphill, oblique, across the slope [rad]."""
ANGLES = np.radians([1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 50.0, 60.0])
"""Slopes of the parked robots, as far as friction holds [rad]."""
REFERENCE_ANGLE = float(np.radians(10.0))
"""The slope whose creep the summary reports [rad]."""
NEARLY = 0.97
"""Steepest slope of the parked robots, relative to the friction angle [-]."""
SLIDING_HEADINGS = (0.0, np.pi / 2)
"""Headings of the sliding robots; they slide straight down the slope [rad]."""
EXCESS = np.radians([1.0, 2.0, 4.0, 8.0])
"""Excess of the sliding robots' slopes over the friction angle [rad]."""


@dataclass(frozen=True)
class Loads:
    """Normal forces and attitude of the chassis in the 25 steady turns."""

    position: Array  # (K, 2) of the contact points in the robot's frame [m]
    load: Array  # (M, K) relative to the mean [-]
    expected: Array  # (M, K) by theory: weight and momentum of a rigid robot on uniform springs [-]
    sink: Array  # (M,) [m]
    roll: Array  # (M,) [rad]
    pitch: Array  # (M,) [rad]


@dataclass(frozen=True)
class Creep:
    """Creep of robots parked on slopes that hold them."""

    angle: Array  # (H, A) of the slopes, one row per heading [rad]
    speed: Array  # (H, A) [m/s]


@dataclass(frozen=True)
class Slide:
    """Acceleration of robots on slopes that do not hold them."""

    angle: Array  # (2, E) of the slopes, one row per sliding heading [rad]
    acceleration: Array  # (2, E) downhill [m/s^2]
    expected: Array  # (2, E) by Coulomb's law [m/s^2]


def loads(parameters: RobotParameters, ground: Ground, threads: int, default_contact: bool) -> Loads:
    """Measure loads in the paper's 25 turns."""
    robot = load_robot(parameters=parameters, contact_sensors=True)
    if default_contact:
        use_default_contact(robot.model)
    omega = turning_sprockets(parameters, *paper_turns(parameters))
    fleet = Fleet(robot, np.zeros((len(omega), 3)), ground, parameters.radius_error, tireless(), threads)
    fleet.command(omega)
    fleet.advance(2.0)
    contacts = read_contacts(fleet)
    position = contacts.position.mean(axis=0)
    x, y = robot.contact_points.T
    # the model's points in the order of the contacts, matched by distance
    order = np.argmin(np.hypot(position[:, None, 0] - x, position[:, None, 1] - y), axis=1)
    theory = Contact(x[order], y[order], ground.along, ground.across, parameters.centre_of_mass)
    v, u, w = fleet.twist().T
    acceleration = np.stack([-w * (u + w * parameters.com_x), w * (v - w * parameters.com_y)], axis=-1)
    load = contacts.load / contacts.load.mean(axis=1, keepdims=True)
    return Loads(position, load, theory.loads(acceleration / GRAVITY) * len(x), *fleet.attitude().T)


def creep(parameters: RobotParameters, ground: Ground, threads: int) -> Creep:
    """Tilt the ground under parked robots, up to nearly the friction angle, and measure how fast they creep."""
    limit = np.array([[friction_angle((ground.along, ground.across), heading)] for heading in HEADINGS])
    angle = np.minimum(ANGLES, NEARLY * limit)
    fleet = _parked(parameters, ground, np.repeat(HEADINGS, len(ANGLES)), threads)
    _tilt(fleet, ground, angle.ravel())
    fleet.advance(_SETTLE)
    before = fleet.pose()[:, :2]
    fleet.advance(_WATCH)
    return Creep(angle, (np.hypot(*(fleet.pose()[:, :2] - before).T) / _WATCH).reshape(angle.shape))


def slide(parameters: RobotParameters, ground: Ground, threads: int) -> Slide:
    """Tilt the ground beyond the friction angle, in two steps because a sudden tilt makes a robot rock."""
    limit = np.array([[friction_angle((ground.along, ground.across), heading)] for heading in SLIDING_HEADINGS])
    angle = limit + EXCESS
    fleet = _parked(parameters, ground, np.repeat(SLIDING_HEADINGS, len(EXCESS)), threads)
    _tilt(fleet, ground, np.broadcast_to(NEARLY * limit, angle.shape).ravel())
    fleet.advance(_SETTLE)
    _tilt(fleet, ground, angle.ravel())
    fleet.advance(_TILTED)
    before = np.hypot(*fleet.batch.qvel[:, :2].T)
    fleet.advance(_SLIDE)
    acceleration = (np.hypot(*fleet.batch.qvel[:, :2].T) - before) / _SLIDE
    gravity = -fleet.robot.model.opt.gravity[2]
    expected = gravity * (np.sin(angle) - np.cos(angle) * np.tan(limit))
    return Slide(angle, acceleration.reshape(angle.shape), expected)


def _parked(parameters: RobotParameters, ground: Ground, heading: Array, threads: int) -> Fleet:
    start = np.column_stack([np.zeros((len(heading), 2)), heading])
    level = Ground(ground.along, ground.across)
    return Fleet(load_robot(parameters=parameters), start, level, drive=tireless(), threads=threads)


def _tilt(fleet: Fleet, ground: Ground, angle: Array) -> None:
    fleet.set_ground([Ground(ground.along, ground.across, slope=float(a)) for a in angle])


def straight_drift(parameters: RobotParameters, ground: Ground, threads: int) -> float:
    """Sideways drift after 10 m straight on, with equal radius errors of both sprockets [m]."""
    robot = load_robot(parameters=parameters)
    heading = 0.3
    fleet = Fleet(robot, [(0.0, 0.0, heading)], ground, parameters.radius_error, tireless(), threads)
    fleet.command(2 * [0.25 / parameters.sprocket_radius])
    fleet.advance(40.0)
    x, y, _ = fleet.pose()[0]
    return float(abs(y * np.cos(heading) - x * np.sin(heading)))
