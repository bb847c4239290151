"""A robot on its ground, in the simulator and in theory: steady motion, and loads at its contact
points.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import cdist

from sim.fleet.fleet import Fleet
from sim.ground.ground import Ground
from sim.ground.pull import Pull
from sim.motors.motor import Drive, or_tireless, tireless
from sim.robot.parameters import SINK, RobotParameters
from sim.robot.robot import Robot, load_robot
from sim.runs.run_recorder import read_contacts
from trackslip.kinematics import (
    Array,
    RobotGeometry,
    limit_sprocket_speeds,
    sprocket_speeds,
    track_slip,
)
from trackslip.paper import COMMANDED_RADII, SPEEDS
from trackslip.skid_theory import Contact, Load, steady_twist

GRAVITY: Final = 9.81
"""Acceleration due to gravity [m/s^2]."""


@dataclass(frozen=True)
class Setup:
    """A robot on level ground, and the number of threads that simulate it."""

    parameters: RobotParameters
    ground: Ground
    threads: int = 0

    def robot(self, contact_sensors: bool = False) -> Robot:
        """The robot's model."""
        return load_robot(parameters=self.parameters, contact_sensors=contact_sensors)

    @property
    def drive(self) -> Drive:
        """Motors that never reach their limits, up to the speed at which this robot is checked."""
        return tireless(checked_speed(self.parameters))

    def fleet(
        self, start: ArrayLike, ground: Ground | Sequence[Ground] | None = None, **options: Any
    ) -> Fleet:
        """Copies of the robot at poses (N, 3), by default with motors that never reach their
        limits.
        """
        options = {"robot": self.robot(), "drive": self.drive, "threads": self.threads, **options}
        return Fleet(
            start=start,
            ground=ground or self.ground,
            radius_error=self.parameters.radius_error,
            **options,
        )

    @property
    def sprocket_radius(self) -> Array:
        """Effective radii of the sprockets (2,) [m]."""
        robot = self.parameters
        split = robot.radius_split * np.array([-1.0, 1.0])
        return robot.sprocket_radius * (1 + robot.radius_error + split)


@dataclass(frozen=True)
class Turns:
    """M steady turns, from theory and simulation."""

    omega: Array  # (M, 2) speeds of the sprockets [rad/s]
    belts: Array  # (M, 2) speeds of the belts [m/s]
    twists: Array  # (2, M, 3) from theory and simulation [m/s, m/s, rad/s]
    geometry: RobotGeometry

    @property
    def half_width(self) -> Array:
        """b + D, half the distance between the tracks' ICRs, from theory and simulation (2, M)
        [m].
        """
        difference = self.belts[:, 1] - self.belts[:, 0]
        w = self.twists[..., 2]
        return np.asarray(difference / (2 * w))

    @property
    def slip(self) -> Array:
        """Slips from theory and simulation (2, M, 2) [-]."""
        planar = self.twists[..., [0, 2]]  # without the speed to the left
        slips = [track_slip(self.omega, twist, self.geometry) for twist in planar]
        return np.stack(slips)


def checked_speed(parameters: RobotParameters) -> float:
    """Largest speed of the belts in the checks, at most the robot's top speed [m/s].

    The paper's robot is as fast as its top speed. Radii are scaled with a robot's width b, so that
    speeds are scaled with its root: then v^2 / (g b), the share of inertia in the balance, is that
    of the paper's robot, for which the theory is known to hold.
    """
    shipped = RobotParameters()
    as_inert = Drive.top_speed * math.sqrt(parameters.half_gauge / shipped.half_gauge)
    return min(as_inert, or_tireless(parameters.drive).top_speed)


def speed_scale(parameters: RobotParameters) -> float:
    """Speeds in the checks of a robot over those in the checks of the shipped robot [-]."""
    return checked_speed(parameters) / Drive.top_speed


def paper_turns(parameters: RobotParameters) -> tuple[Array, Array, Array]:
    """Radii [m], scaled with the robot's width, and speeds [m/s], scaled by `speed_scale`, of the
    paper's turns (25,), and the sprocket speeds (25, 2) that command them, within the limit
    [rad/s].
    """
    radii = np.array(COMMANDED_RADII) * parameters.half_gauge / RobotParameters().half_gauge
    speeds = np.array(SPEEDS) * speed_scale(parameters)
    radius, speed = np.array(list(itertools.product(radii, speeds))).T
    twist = np.stack([speed, speed / radius], axis=-1)
    omega = sprocket_speeds(twist, 0.0, parameters.geometry)
    limit = checked_speed(parameters) / parameters.sprocket_radius
    return radius, speed, limit_sprocket_speeds(omega, limit)


def drive_steadily(
    setup: Setup, omega: Array, load: Load | None = None, passes: float = 3.0
) -> Turns:
    """Drive at sprocket speeds (M, 2) [rad/s] until motion is steady, under a load that has uphill
    straight ahead.

    On shearing ground, this takes until the elements of the slowest belt have passed through
    contact `passes` times.
    """
    load = load or Load()
    robot = setup.parameters
    belts = omega * setup.sprocket_radius
    ground = replace(setup.ground, slope=load.slope)
    pull = Pull(load.pull * robot.mass * GRAVITY, load.hitch_height)
    fleet = setup.fleet(np.zeros((len(omega), 3)), ground, pull=pull)
    fleet.command(omega)

    # until motion is steady
    settle = 1.5
    if ground.shear:
        slowest = float(np.abs(belts).min())
        settle = passes * robot.contact_length / slowest
    fleet.advance(round(settle / fleet.period) * fleet.period)

    # a mean, because contact with MuJoCo's default parameters shakes
    twists = []
    for _ in range(round(0.5 / fleet.period)):
        fleet.advance(fleet.period)
        twists.append(fleet.twist())
    simulated = np.mean(twists, axis=0)

    contact = robot.contact_theory(ground.along, ground.across, 100)
    expected = steady_twist(belts, contact, GRAVITY, ground.shear, load)
    return Turns(omega, belts, np.stack([expected, simulated]), robot.geometry)


def measure_loads(setup: Setup, omega: Array) -> tuple[Array, Array]:
    """Loads at K contact points in turns, relative to their mean (2, M, K) [-], and the chassis'
    sink [m], roll and pitch (2, M, 3) [rad], in theory (a rigid robot on equal springs) and
    simulated, at sprocket speeds (M, 2) [rad/s].

    The centre of mass at (x_c, y_c) moves with u to the left and turns with w about the origin, so
    that its acceleration has the components -w (u + w x_c) ahead and w (v - w y_c) to the left.
    Springs that sink by SINK under the mean load sink by SINK times the relative load; the chassis
    is the plane through them, z = sink - roll y + pitch x.
    """
    robot = setup.parameters
    fleet = setup.fleet(np.zeros((len(omega), 3)), robot=setup.robot(contact_sensors=True))
    fleet.command(omega)
    fleet.advance(2.0)

    # the model's contact points, in the order of the sensors
    contacts = read_contacts(fleet)
    measured_at = contacts.position.mean(axis=0)
    nearest = cdist(measured_at, fleet.robot.contact_points).argmin(axis=1)
    x, y = fleet.robot.contact_points[nearest].T
    count = len(x)

    # loads and attitude in theory
    v, u, w = fleet.twist().T
    ahead = -w * (u + w * robot.com_x)
    left = w * (v - w * robot.com_y)
    acceleration = np.stack([ahead, left], axis=-1)
    theory = Contact(x, y, setup.ground.along, setup.ground.across, robot.centre_of_mass)
    expected = theory.loads(acceleration / GRAVITY) * count
    plane = np.column_stack([np.ones(count), -y, x])
    solution, *_ = np.linalg.lstsq(plane, SINK * expected.T)
    expected_attitude = solution.T

    weight = fleet.robot.mass * GRAVITY
    load = contacts.load * count / weight
    loads = np.stack([expected, load])
    attitudes = np.stack([expected_attitude, fleet.attitude()])
    return loads, attitudes
