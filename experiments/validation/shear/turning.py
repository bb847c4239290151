"""Steady turns, and turning on the spot, on ground that shears."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from sim.drive.drive import tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.kinematics import Array, limit_sprocket_speeds, sprocket_speeds, track_slip
from trackslip.paper import COMMANDED_RADII, SPEEDS
from trackslip.skid_theory import line_contact, steady_twist

MODULI = (0.002, 0.005, 0.010, 0.025)
"""Shear moduli [m]."""
FIRM = 1e-5
"""Modulus of ground so firm that it should be Coulomb ground [m]."""
ON_THE_SPOT = (0.06, 0.12, 0.24)
"""Speeds of belts that run against each other [m/s]."""
PASSES = 3.0
"""Times that the slower belt carries every element through its contact before a turn is taken as steady."""
WATCH = 0.5
"""Time over which twists are then averaged [s]."""


@dataclass(frozen=True)
class Turns:
    """M steady turns, simulated and by theory."""

    shear: Array  # (M,) modulus [m]; 0 for Coulomb ground
    radius: Array  # (M,) commanded [m]; 0 on the spot
    half_width: Array  # (M,) b + D [m]
    expected_half_width: Array  # (M,) by theory [m]
    slip: Array  # (M, 2) [-]
    expected_slip: Array  # (M, 2) by theory [-]

    @property
    def error(self) -> Array:
        """Relative error of b + D, (M,) [-]."""
        return self.half_width / self.expected_half_width - 1

    @property
    def spins(self) -> np.ndarray:
        """Whether the robot turns on the spot (M,)."""
        return self.radius == 0


def turn(parameters: RobotParameters, ground: Ground, threads: int) -> Turns:
    """Let a robot turn with the paper's radii, scaled with its width, and on the spot, on ground with every modulus."""
    robot = load_robot(parameters=parameters)
    radii = np.array(COMMANDED_RADII) * parameters.half_gauge / RobotParameters().half_gauge
    radius, speed = np.array(list(itertools.product(radii, SPEEDS))).T
    omega = sprocket_speeds(np.stack([speed, speed / radius], axis=-1), 0.0, robot.geometry)
    spins = np.outer(np.array(ON_THE_SPOT) / parameters.sprocket_radius, [-1.0, 1.0])
    omega = np.concatenate([limit_sprocket_speeds(omega, tireless().top_speed / parameters.sprocket_radius), spins])
    radius = np.concatenate([radius, np.zeros(len(spins))])
    parts = [
        _turns(parameters, ground, moduli, omega, radius, threads) for moduli in ((0.0,), (FIRM, *MODULI))
    ]  # ground that does not shear has other pads
    return Turns(*(np.concatenate(columns) for columns in zip(*(vars(part).values() for part in parts), strict=True)))


def _turns(
    parameters: RobotParameters, ground: Ground, moduli: tuple[float, ...], omega: Array, radius: Array, threads: int
) -> Turns:
    robot = load_robot(parameters=parameters)
    shear, rows = np.repeat(moduli, len(omega)), np.tile(omega, (len(moduli), 1))
    grounds = [Ground(ground.along, ground.across, shear=float(k)) for k in shear]
    fleet = Fleet(robot, np.zeros((len(rows), 3)), grounds, parameters.radius_error, tireless(), threads)
    fleet.command(rows)
    belts = rows * parameters.sprocket_radius * (1 + parameters.radius_error)
    twist = watched(fleet, PASSES * parameters.contact_length / float(np.abs(belts).min()))
    centre = (parameters.com_x, parameters.com_y, parameters.com_height)
    contact = line_contact(
        parameters.half_gauge, parameters.contact_length / 2, ground.along, ground.across, centre, points=100
    )
    expected = np.concatenate([steady_twist(belts[shear == k], contact, 9.81, shear=k) for k in moduli])
    spread = belts[:, 1] - belts[:, 0]
    return Turns(
        shear=shear,
        radius=np.tile(radius, len(moduli)),
        half_width=spread / (2 * twist[:, 2]),
        expected_half_width=spread / (2 * expected[:, 2]),
        slip=track_slip(rows, twist[:, [0, 2]], robot.geometry),
        expected_slip=track_slip(rows, expected[:, [0, 2]], robot.geometry),
    )


def watched(fleet: Fleet, settle: float) -> Array:
    """Mean twists (N, 3) of a fleet over WATCH, after it has driven for `settle` [s]."""
    fleet.advance(round(settle / fleet.period) * fleet.period)
    twists = []
    for _ in range(round(WATCH / fleet.period)):
        fleet.advance(fleet.period)
        twists.append(fleet.twist())
    return np.mean(twists, axis=0)
