"""The standing robot: contact loads, sink and lean; creep on slopes that hold it, sliding on those that do not."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from experiments.validate.theory import GRAVITY, paper_turns, turning_sprockets
from sim.contact_forces import read_contacts, use_default_contact
from sim.drive.drive import tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground, friction_angle
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.kinematics import Array
from trackslip.skid_theory import Contact

_TILT, _STEPS = 1.0, 50  # duration [s] and steps of a tilt: a robot on sudden slopes rocks and may tip over
_SETTLE, _WATCH = 1.0, 5.0  # on a slope: settling time of the lean, and duration of the creep measurement after it [s]
_SLIDE, _FASTEST = 0.6, 0.4  # beyond the friction angle: longest time [s] and highest speed [m/s] of the sliding
_MARGIN = np.radians(4.0)  # over the friction angle: a robot that tips over there may tip over as it slides [rad]
_UPRIGHT = np.cos(0.1)  # of the lean of a robot that stands on its tracks [-]
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
    speed: Array  # (H, A) [m/s]; NaN where the robot tips over


@dataclass(frozen=True)
class Slide:
    """Acceleration of robots on slopes that do not hold them."""

    angle: Array  # (2, E) of the slopes, one row per sliding heading [rad]
    acceleration: Array  # (2, E) of the centre of mass, downhill [m/s^2]; NaN where the robot tips over first
    expected: Array  # (2, E) by Coulomb's law [m/s^2]

    @property
    def tips(self) -> NDArray[np.bool_]:
        """True (2, E) where the robot tips over before it slides."""
        return np.asarray(np.isnan(self.acceleration))


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
    load = contacts.load * len(x) / (robot.mass * GRAVITY)
    return Loads(position, load, theory.loads(acceleration / GRAVITY) * len(x), *fleet.attitude().T)


def creep(parameters: RobotParameters, ground: Ground, threads: int) -> Creep:
    """Tilt the ground under parked robots, up to nearly the friction angle, and measure how fast they creep."""
    limit = np.array([[friction_angle((ground.along, ground.across), heading)] for heading in HEADINGS])
    angle = np.minimum(ANGLES, NEARLY * limit)
    fleet = _parked(parameters, ground, np.repeat(HEADINGS, len(ANGLES)), threads)
    _tilt(fleet, _slopes(ground, angle))
    before = fleet.pose()[:, :2]
    fleet.advance(_WATCH)
    speed = np.hypot(*(fleet.pose()[:, :2] - before).T) / _WATCH
    return Creep(angle, np.where(_stands(fleet), speed, np.nan).reshape(angle.shape))


def slide(parameters: RobotParameters, ground: Ground, threads: int) -> Slide:
    """Tilt the ground beyond the friction angle, where Coulomb's law gives the acceleration.

    Only robots that don't tip over on slopes steeper still, held by more friction, are measured; for these, the slopes
    begin at nearly the friction angle, where the loads are those of sliding.
    """
    limit = np.array([[friction_angle((ground.along, ground.across), heading)] for heading in SLIDING_HEADINGS])
    angle = limit + EXCESS
    nearly, steeper = (np.broadcast_to(start, angle.shape) for start in (NEARLY * limit, limit + _MARGIN))
    fleet = _parked(parameters, ground, np.repeat(SLIDING_HEADINGS, len(EXCESS)), threads)
    velocity = fleet.batch.bind("cvel")[:, fleet.robot.model.body("chassis").id, 3:5]  # of the centre of mass, live
    _tilt(fleet, _slopes(ground, steeper, np.tan(steeper) / np.tan(nearly)))
    fleet.set_ground(_slopes(ground, nearly))
    fleet.advance(_SETTLE)
    stands = _stands(fleet).reshape(angle.shape)
    fleet.set_ground(_slopes(ground, angle))
    time, speed = fleet.period * np.arange(round(_SLIDE / fleet.period) + 1), [np.zeros(fleet.size)]
    for _ in time[1:]:
        fleet.advance(fleet.period)
        speed.append(np.hypot(*velocity.T))
    expected = GRAVITY * (np.sin(angle) - np.cos(angle) * np.tan(limit))
    end = np.minimum(_SLIDE, _FASTEST / expected)
    gained = [np.diff(np.interp([t / 2, t], time, row)) for t, row in zip(end.flat, np.transpose(speed), strict=True)]
    return Slide(angle, np.where(stands, np.reshape(gained, angle.shape) / (end / 2), np.nan), expected)


def _parked(parameters: RobotParameters, ground: Ground, heading: Array, threads: int) -> Fleet:
    start = np.column_stack([np.zeros((len(heading), 2)), heading])
    level = Ground(ground.along, ground.across)
    return Fleet(load_robot(parameters=parameters), start, level, drive=tireless(), threads=threads)


def _slopes(ground: Ground, angle: Array, grip: ArrayLike = 1.0) -> list[Ground]:
    """Grounds of the slopes `angle` [rad] with `grip` times the friction."""
    pairs = np.broadcast(angle, grip)
    return [Ground(float(k) * ground.along, float(k) * ground.across, slope=float(a)) for a, k in pairs]


def _tilt(fleet: Fleet, grounds: list[Ground]) -> None:
    """Tilt the ground gradually to `grounds` and let the robots' lean settle."""
    for share in np.linspace(1 / _STEPS, 1.0, _STEPS).tolist():
        fleet.set_ground([replace(ground, slope=share * ground.slope) for ground in grounds])
        fleet.advance(_TILT / _STEPS)
    fleet.advance(_SETTLE)


def _stands(fleet: Fleet) -> NDArray[np.bool_]:
    """True for the robots (N,) that have not tipped over."""
    return fleet.upright() > _UPRIGHT


def straight_drift(parameters: RobotParameters, ground: Ground, threads: int) -> float:
    """Sideways drift after 10 m straight on, with equal radius errors of both sprockets [m]."""
    robot = load_robot(parameters=parameters)
    heading = 0.3
    fleet = Fleet(robot, [(0.0, 0.0, heading)], ground, parameters.radius_error, tireless(), threads)
    fleet.command(2 * [0.25 / parameters.sprocket_radius])
    fleet.advance(40.0)
    x, y, _ = fleet.pose()[0]
    return float(abs(y * np.cos(heading) - x * np.sin(heading)))
