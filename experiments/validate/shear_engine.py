"""Bits and computing time of fleets on ground that shears."""

from __future__ import annotations

from time import process_time

import numpy as np

from sim.drive.drive import Drive
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import Robot, load_robot
from trackslip.kinematics import Array

FEWEST = 32
"""Number of robots from which on the cost is bounded."""
_MODULI = (0.002, 0.005, 0.010, 0.025)
_DRIVEN, _HOLD = 3.0, 0.5  # random commands [s]
_WEAK = 0.009  # torque limit over weight, which turning on the spot exceeds [m]
_SECONDS, _COMPARED = 16.0, 20  # simulated by all robots to compare the cost [s], and how often
_MODULUS = 0.01  # [m]
_PERIOD = 0.05  # time between two scans [s]
_STEADY = 2.0  # time after which the belts run steadily [s]


def cost_ratio(robot: Robot) -> float:
    """Processor time of FEWEST robots over that on Coulomb ground, on one thread: the median of turns [-]."""
    fleets = [Fleet(robot, np.zeros((FEWEST, 3)), Ground(shear=shear), threads=1) for shear in (0.0, _MODULUS)]
    for fleet in fleets:
        fleet.command([2.0, 3.0])
        fleet.advance(_STEADY)
    took = np.array([[_time(fleet) for fleet in fleets] for _ in range(1 + _COMPARED)])[1:]  # the first warms up
    return float(np.median(took[:, 1] / took[:, 0]))


def _time(fleet: Fleet) -> float:
    """Processor time of one turn [s]."""
    began = process_time()
    for _ in range(round(_SECONDS / FEWEST / _PERIOD)):
        fleet.advance(_PERIOD)
    return process_time() - began


def differing(parameters: RobotParameters, ground: Ground, generator: np.random.Generator) -> dict[str, int]:
    """Numbers of a fleet's state that differ where none should, by what differs; some motors are too weak."""
    robot = load_robot(parameters=parameters)
    limit = _WEAK * parameters.mass * 9.81 + Drive().motor.friction
    grounds = [Ground(ground.along, ground.across, 0.05, float(k), shear=k) for k in _MODULI]
    omega = generator.uniform(-5.0, 5.0, (round(_DRIVEN / _HOLD), len(grounds), 2))
    state = {}
    for name, threads, drive, rows, pieces in (
        ("strong", 1, Drive(), slice(None), 1),
        ("threads", 2, Drive(), slice(None), 1),
        ("alone", 1, Drive(), slice(1), 1),
        ("weak", 1, Drive(torque_limit=limit), slice(None), 1),
        ("weak alone", 2, Drive(torque_limit=limit), slice(1), 1),
        ("weak in pieces", 1, Drive(torque_limit=limit), slice(None), round(_HOLD / Drive.period)),
    ):
        fleet = Fleet(robot, np.zeros((len(grounds[rows]), 3)), grounds[rows], drive=drive, threads=threads)
        for command in omega[:, rows]:
            fleet.command(command)
            for _ in range(pieces):
                fleet.advance(_HOLD / pieces)
        state[name] = _state(fleet)

    def count(one: str, other: str) -> int:
        rows = min(len(state[one]), len(state[other]))
        return int((state[one][:rows] != state[other][:rows]).sum())

    return {
        "at another number of threads": count("strong", "threads"),
        "of a robot alone": count("strong", "alone") + count("weak", "weak alone"),
        "where weak motors are driven again": count("weak", "weak in pieces"),
    }


def _state(fleet: Fleet) -> Array:
    parts = [fleet.batch.state, fleet.drive.omega]
    if fleet.shear is not None:
        parts += [fleet.shear.displacement.reshape(fleet.size, -1), fleet.shear.share]
    return np.concatenate(parts, axis=1)
