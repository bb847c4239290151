"""Steady turns, simulated and by quasi-static theory (`trackslip.skid_theory`)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from sim.drive.drive import tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from trackslip.kinematics import Array, limit_sprocket_speeds, sprocket_speeds, track_slip
from trackslip.paper import COMMANDED_RADII, SPEEDS
from trackslip.skid_theory import Contact

WATCH = 0.5
"""Time over which twists are averaged, because MuJoCo's default contact shakes [s]."""
GRAVITY = 9.81
"""[m/s^2]"""
_POINTS = 100  # of a line of contact


@dataclass(frozen=True)
class SimulatedTurns:
    """M steady turns, simulated and by theory."""

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


Arrays = TypeVar("Arrays")


def joined(parts: Sequence[Arrays]) -> Arrays:
    """Dataclasses of arrays as one, row after row."""
    return type(parts[0])(
        *(np.concatenate(columns) for columns in zip(*(vars(p).values() for p in parts), strict=True))
    )


def paper_turns(parameters: RobotParameters) -> tuple[Array, Array]:
    """Commanded radii [m] and speeds [m/s] of the paper's 25 turns, (25,) each; radii are scaled with the width."""
    radii = np.array(COMMANDED_RADII) * parameters.half_gauge / RobotParameters().half_gauge
    radius, speed = np.array(list(itertools.product(radii, SPEEDS))).T
    return radius, speed


def turning_sprockets(parameters: RobotParameters, radius: Array, speed: Array) -> Array:
    """Sprocket speeds (M, 2) that would drive turns (M,) without slip, as far as the drives allow [rad/s]."""
    omega = sprocket_speeds(np.stack([speed, speed / radius], axis=-1), 0.0, parameters.geometry)
    return limit_sprocket_speeds(omega, tireless().top_speed / parameters.sprocket_radius)


def belt_speeds(parameters: RobotParameters, omega: Array) -> Array:
    """Speeds of the belts (..., 2) at sprocket speeds (..., 2), radius error included [m/s]."""
    return omega * parameters.sprocket_radius * (1 + parameters.radius_error)


def contact(parameters: RobotParameters, ground: Ground) -> Contact:
    """The contact of the robot with the ground, for theory."""
    return parameters.contact_theory(ground.along, ground.across, _POINTS)


def mean_twist(fleet: Fleet, settle: float) -> Array:
    """Mean twists (N, 3) of a fleet over WATCH, after it has driven for `settle` [s]."""
    fleet.advance(round(settle / fleet.period) * fleet.period)
    twists = []
    for _ in range(round(WATCH / fleet.period)):
        fleet.advance(fleet.period)
        twists.append(fleet.twist())
    return np.asarray(np.mean(twists, axis=0))


def turns_of(parameters: RobotParameters, omega: Array, twist: Array, expected: Array) -> SimulatedTurns:
    """Turns with sprocket speeds (M, 2) [rad/s] from twists (M, 3), simulated and by theory."""
    belts = belt_speeds(parameters, omega)
    spread = belts[:, 1] - belts[:, 0]
    return SimulatedTurns(
        half_width=spread / (2 * twist[:, 2]),
        expected_half_width=spread / (2 * expected[:, 2]),
        slip=track_slip(omega, twist[:, [0, 2]], parameters.geometry),
        expected_slip=track_slip(omega, expected[:, [0, 2]], parameters.geometry),
        lateral=twist[:, 1],
        expected_lateral=expected[:, 1],
    )
