"""Slip under load on ground that shears: slopes, drawbar pull, creep of parked robots, stop and go."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from experiments.validate.theory import GRAVITY, contact, mean_twist
from sim.drive.drive import tireless
from sim.drive.pull import Pull
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from trackslip.kinematics import Array, track_slip
from trackslip.skid_theory import Load, steady_twist

MODULI = (0.002, 0.005, 0.010, 0.025)
"""Shear moduli [m]."""
SLOPES = np.radians([5.0, 10.0, 15.0, 20.0])
"""Slopes that are climbed straight [rad]."""
PULLS = (0.05, 0.10, 0.15, 0.20, 0.25)
"""Drawbar pulls over the weight [-]."""
HITCH = 0.1
"""Height of the hitch [m]."""
SPEED = 0.12
"""Of the belts [m/s]."""
CREEP_SLOPE = float(np.radians(10.0))
"""The slope on which robots are parked, and drive with stops [rad]."""
HEADINGS = (0.0, np.pi / 4, np.pi / 2)
"""Headings of the parked robots: straight uphill, oblique, across the slope [rad]."""
_PARKED = 5.0  # [s]
_PASSES, _STEADY_PASSES = 4.5, 6.0  # of every element through its contact before slip is watched, and stops begin
_CYCLES, _GO, _STOP, _RAMP = 4, 2.0, 1.5, 0.5  # of stop and go: number, and times of each [s]
_TURN = (0.75, 1.25)  # speeds of the belts of a robot that turns under pull, over the mean


@dataclass(frozen=True)
class Slips:
    """Slips of M robots under load, simulated and by theory."""

    shear: Array  # (M,) modulus [m]
    load: Array  # (M,) slope [rad] or pull over the weight [-]
    turns: np.ndarray  # (M,) whether the robot turns
    slip: Array  # (M, 2) [-]
    expected: Array  # (M, 2) by theory [-]

    def error(self, rows: np.ndarray) -> float:
        """The largest error of some rows (M,) bool [-]."""
        return float(np.abs(self.slip - self.expected)[rows].max())


@dataclass(frozen=True)
class StopAndGo:
    """Distance slipped on a slope by a robot on each of MODULI that stops and goes, after as much driving as it takes
    to be steady."""

    time: Array  # (T,) [s]
    slipped: Array  # (T, 4) [m]
    expected: Array  # (T, 4) by theory, which knows no inertia: the steady slip of what the belts run [m]


def slopes(parameters: RobotParameters, ground: Ground, threads: int) -> Slips:
    """Climb every slope on ground with every modulus."""
    slope, shear = np.array(list(itertools.product(SLOPES, MODULI))).T
    grounds = [
        Ground(ground.along, ground.across, float(s), 0.0, shear=float(k)) for s, k in zip(slope, shear, strict=True)
    ]
    speeds = np.full((len(slope), 2), SPEED)
    loads = [Load(float(s)) for s in slope]
    slip, expected = _slips(parameters, ground, grounds, speeds, loads, Pull(), threads)
    return Slips(shear, slope, np.zeros(len(slope), bool), slip, expected)


def pulls(parameters: RobotParameters, ground: Ground, threads: int) -> Slips:
    """Pull straight ahead and in a turn, with every force, on ground with every modulus."""
    shear, turning = np.repeat(MODULI, 2), np.tile([False, True], len(MODULI))
    grounds = [Ground(ground.along, ground.across, shear=float(k)) for k in shear]
    speeds = SPEED * np.where(turning[:, None], _TURN, 1.0)
    found = []
    for share in PULLS:
        pull = Pull(share * parameters.mass * 9.81, HITCH)
        loads = [Load(pull=share, hitch_height=HITCH)] * len(shear)
        found.append(_slips(parameters, ground, grounds, speeds, loads, pull, threads))
    slip, expected = (np.concatenate(parts) for parts in zip(*found, strict=True))
    count = len(PULLS)
    return Slips(np.tile(shear, count), np.repeat(PULLS, len(shear)), np.tile(turning, count), slip, expected)


def _slips(
    parameters: RobotParameters,
    ground: Ground,
    grounds: list[Ground],
    speeds: Array,
    loads: list[Load],
    pull: Pull,
    threads: int,
) -> tuple[Array, Array]:
    """Slips (M, 2) of robots whose belts run at `speeds` (M, 2) [m/s], simulated and by theory."""
    robot, error = load_robot(parameters=parameters), parameters.radius_error
    omega = speeds / (parameters.sprocket_radius * (1 + error))
    fleet = Fleet(robot, np.zeros((len(grounds), 3)), grounds, error, tireless(), threads, pull)
    fleet.command(omega)
    twist, lines = (
        mean_twist(fleet, _PASSES * parameters.contact_length / float(speeds.min())),
        contact(parameters, ground),
    )
    cases = zip(speeds, grounds, loads, strict=True)
    expected = np.stack([steady_twist(belts, lines, GRAVITY, one.shear, load) for belts, one, load in cases])
    slip, by_theory = (track_slip(omega, part[:, [0, 2]], robot.geometry) for part in (twist, expected))
    return slip, by_theory


def creep(parameters: RobotParameters, ground: Ground, threads: int) -> Array:
    """Creep (4, H) of robots parked on CREEP_SLOPE with every modulus and HEADINGS, over that on Coulomb ground [-]."""
    crept = {}
    for moduli in ((0.0,), MODULI):
        shear, heading = np.array(list(itertools.product(moduli, HEADINGS))).T
        grounds = [Ground(ground.along, ground.across, CREEP_SLOPE, 0.0, shear=float(k)) for k in shear]
        start = np.column_stack([np.zeros((len(heading), 2)), heading])
        fleet = Fleet(load_robot(parameters=parameters), start, grounds, drive=tireless(), threads=threads)
        fleet.advance(_PARKED)
        crept[moduli] = np.hypot(*fleet.pose()[:, :2].T).reshape(len(moduli), -1)
    return crept[MODULI] / crept[0.0,]


def stop_and_go(parameters: RobotParameters, ground: Ground, threads: int) -> StopAndGo:
    """Drive uphill with stops on ground with every modulus."""
    robot, steady = load_robot(parameters=parameters), _STEADY_PASSES * parameters.contact_length / SPEED
    grounds = [Ground(ground.along, ground.across, CREEP_SLOPE, 0.0, shear=k) for k in MODULI]
    fleet = Fleet(robot, np.zeros((len(MODULI), 3)), grounds, parameters.radius_error, tireless(), threads)
    radius = parameters.sprocket_radius * (1 + parameters.radius_error)
    fleet.command([SPEED / radius] * 2)
    fleet.advance(round(steady, 1))
    lines, load = contact(parameters, ground), Load(CREEP_SLOPE)
    slip = np.array([1 - steady_twist([1.0, 1.0], lines, shear=k, load=load)[0] for k in MODULI])
    period, cycle = 5 * fleet.period, _STOP + _GO
    begin, turned = fleet.pose()[:, 0], fleet.drive.angle.mean(axis=1)
    time, slipped, expected = [0.0], [np.zeros(len(MODULI))], [np.zeros(len(MODULI))]
    for k in range(round(_CYCLES * cycle / period)):
        phase = (k * period) % cycle  # brake, stand, start again, drive
        speed = np.interp(phase, [0.0, _RAMP, _STOP, _STOP + _RAMP], [1.0, 0.0, 0.0, 1.0])
        fleet.command([SPEED * speed / radius] * 2)
        fleet.advance(period)
        way = radius * (fleet.drive.angle.mean(axis=1) - turned)
        time.append((k + 1) * period)
        slipped.append(way - (fleet.pose()[:, 0] - begin))
        expected.append(slip * way)
    return StopAndGo(np.array(time), np.array(slipped), np.array(expected))
