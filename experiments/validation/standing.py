"""How the robot stands: load of its pads, sink, lean; does it creep on a slope, and slide as it should?"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from sim.drive.drive import tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground, friction_angle
from sim.instruments import read_contacts, use_default_contact
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.kinematics import Array, limit_sprocket_speeds, sprocket_speeds
from trackslip.paper import COMMANDED_RADII, SPEEDS
from trackslip.skid_theory import Contact

_SETTLE, _WATCH = 1.0, 5.0  # on a slope: time that the lean takes to settle, and in which creep is measured, then [s]
_TILTED, _SLIDE = 0.3, 0.3  # beyond the friction angle: the same for the acceleration [s]
HEADINGS = (0.0, np.pi / 4, np.pi / 2)
"""Of the robots that creep: straight uphill, oblique, across the slope [rad]."""
ANGLES = np.radians([1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 50.0, 60.0])
"""Of the slopes on which robots creep, as far as friction holds [rad]."""
REFERENCE_ANGLE = float(np.radians(10.0))
"""The one that a summary tells of [rad]."""
NEARLY = 0.97
"""The steepest slope that robots creep on, relative to the friction angle."""
SLIDING_HEADINGS = (0.0, np.pi / 2)
"""Of the robots that slide, straight down [rad]."""
EXCESS = np.radians([1.0, 2.0, 4.0, 8.0])
"""Of the slopes on which robots slide, over the friction angle [rad]."""


@dataclass(frozen=True)
class Loads:
    """Normal forces in the 25 steady turns, and how the chassis lies."""

    position: Array  # (K, 2) of the points of contact, in the robot's frame, where all touch the ground [m]
    load: Array  # (M, K) relative to their mean [-]
    expected: Array  # (M, K) by theory: rigid robots on even springs, weight and momentum [-]
    sink: Array  # (M,) [m]
    roll: Array  # (M,) [rad]
    pitch: Array  # (M,) [rad]


@dataclass(frozen=True)
class Creep:
    """Robots parked on slopes that hold them."""

    angle: Array  # (H, A) of the slopes, for each of HEADINGS [rad]
    speed: Array  # (H, A) at which the robots creep [m/s]


@dataclass(frozen=True)
class Slide:
    """Robots on slopes that don't hold them."""

    angle: Array  # (2, E) of the slopes, for each of SLIDING_HEADINGS [rad]
    acceleration: Array  # (2, E) downhill [m/s^2]
    expected: Array  # (2, E) by Coulomb's law [m/s^2]


def loads(parameters: RobotParameters, ground: Ground, threads: int, default_contact: bool) -> Loads:
    """Loads in the paper's 25 turns."""
    robot = load_robot(parameters=parameters, contact_sensors=True)
    if default_contact:
        use_default_contact(robot)
    radii = np.array(COMMANDED_RADII) * parameters.half_gauge / RobotParameters().half_gauge
    radius, speed = np.array(list(itertools.product(radii, SPEEDS))).T
    fleet = Fleet(robot, np.zeros((len(radius), 3)), ground, parameters.radius_error, tireless(), threads)
    omega = sprocket_speeds(np.stack([speed, speed / radius], axis=-1), 0.0, robot.geometry)
    fleet.command(limit_sprocket_speeds(omega, fleet.drive.limit))
    fleet.advance(2.0)
    contacts = read_contacts(fleet)
    position = contacts.position.mean(axis=0)
    centre = (parameters.com_x, parameters.com_y, parameters.com_height)
    x, y = robot.contact_points.T
    # the same points in the order of the contacts: each beside the nearest
    order = np.argmin(np.hypot(position[:, None, 0] - x, position[:, None, 1] - y), axis=1)
    theory = Contact(x[order], y[order], ground.along, ground.across, centre)
    v, u, w = fleet.twist().T
    acceleration = np.stack([-w * (u + w * parameters.com_x), w * (v - w * parameters.com_y)], axis=-1)
    return Loads(
        position=position,
        load=contacts.load / contacts.load.mean(axis=1, keepdims=True),
        expected=theory.loads(acceleration / 9.81) * len(x),
        sink=fleet.attitude()[:, 0],
        roll=fleet.attitude()[:, 1],
        pitch=fleet.attitude()[:, 2],
    )


def creep(parameters: RobotParameters, ground: Ground, threads: int) -> Creep:
    """Tilt the ground under parked robots, up to nearly the friction angle, and see how fast they creep."""
    limit = np.array([[friction_angle((ground.along, ground.across), heading)] for heading in HEADINGS])
    angle = np.minimum(ANGLES, NEARLY * limit)
    fleet = _parked(parameters, ground, np.repeat(HEADINGS, len(ANGLES)), threads)
    _tilt(fleet, ground, angle.ravel())
    fleet.advance(_SETTLE)
    before = fleet.pose()[:, :2]
    fleet.advance(_WATCH)
    return Creep(angle, (np.hypot(*(fleet.pose()[:, :2] - before).T) / _WATCH).reshape(angle.shape))


def slide(parameters: RobotParameters, ground: Ground, threads: int) -> Slide:
    """Tilt the ground beyond the friction angle; almost that far first, for a sudden tilt makes a robot rock."""
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
    return Fleet(load_robot(parameters=parameters), start, level, threads=threads)


def _tilt(fleet: Fleet, ground: Ground, angle: Array) -> None:
    fleet.set_ground([Ground(ground.along, ground.across, slope=float(a)) for a in angle])


def straight_drift(parameters: RobotParameters, ground: Ground, threads: int) -> float:
    """How far a robot that drives straight on is to the side after 10 m, with its radius errors equal [m]."""
    robot = load_robot(parameters=parameters)
    heading = 0.3
    fleet = Fleet(robot, [(0.0, 0.0, heading)], ground, parameters.radius_error, tireless(), threads)
    fleet.command(2 * [0.25 / parameters.sprocket_radius])
    fleet.advance(40.0)
    x, y, _ = fleet.pose()[0]
    return float(abs(y * np.cos(heading) - x * np.sin(heading)))
