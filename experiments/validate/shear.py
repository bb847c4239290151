"""The suite of ground that shears: turns, slip under load, parking, equal bits, and the cost of its computation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from experiments.common.check import Check
from experiments.common.choices import SHIPPED
from experiments.common.page import Plot, Section
from experiments.common.run import Run
from experiments.validate import shear_figures as figures
from experiments.validate.config import Config
from experiments.validate.shear_engine import FEWEST, cost_ratio, differing
from experiments.validate.shear_loads import MODULI, Slips, StopAndGo, creep, pulls, slopes, stop_and_go
from experiments.validate.suite import Findings
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
from sim.drive.drive import tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.named import load_parameters
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from sim.seeds import generator
from trackslip.kinematics import Array
from trackslip.skid_theory import steady_twist

TITLE = "Ground that shears compared with theory"
FIRM = 1e-5
"""Modulus of ground so firm that it should be Coulomb ground [m]."""
ON_THE_SPOT = (0.06, 0.12, 0.24)
"""Speeds of belts that run against each other [m/s]."""
PASSES = 3.0
"""Times that the slower belt carries every element through its contact before a turn is taken as steady."""
_STAGES = 5  # of the measurements of a robot
_INTRO = (
    "Ground that shears gives way before it slides: an element of track that has moved by j over the ground since it "
    "touched down is held by the share 1 − exp(−j / K) of the friction. This page compares the simulator with the "
    "quasi-static balance of the same forces, for shear moduli K from 2 to 25 mm."
)
_LIMITS = (
    "That real ground shears like this. It also sinks, piles up beside the tracks and remembers earlier passes.",
    "Motion that changes faster than an element of track passes through the contact; theory is for steady motion.",
)
_THEORY = "quasi-static theory of ground that shears (trackslip.skid_theory)"
_TURNS, _SPOT, _SLIP, _SLOPE, _FIRM, _CREEP, _COST = 0.005, 0.013, 0.002, 0.001, 0.005, 1.2, 1.5
_WHEELS_COST = 4.0  # their eight points are cheap on Coulomb ground
_STOPS = (0.1, 1.5e-3)  # part of the distance slipped, and [m]


@dataclass(frozen=True)
class ShearTurns(SimulatedTurns):
    """M turns on ground that shears."""

    shear: Array  # (M,) modulus [m]; 0 for Coulomb ground
    radius: Array  # (M,) commanded [m]; 0 on the spot

    @property
    def spins(self) -> np.ndarray:
        """Mask (M,) of turns on the spot."""
        return np.asarray(self.radius == 0)


@dataclass(frozen=True)
class ShearMeasurements:
    """Everything about one robot."""

    robot: str
    """Its name."""
    parameters: RobotParameters
    turns: ShearTurns
    slopes: Slips
    pulls: Slips
    creep: Array  # (K, H) over that on Coulomb ground [-]
    stops: StopAndGo
    differing: dict[str, int]
    """Numbers whose bits differ where none should."""
    cost: float
    """Processor time of a fleet over that on Coulomb ground [-]."""


def shear_suite(config: Config, run: Run) -> Findings:
    """Measure the robot that is given; else the shipped one, and a larger one."""
    parameters, ground = load_parameters(config.robot or SHIPPED)
    robots = subjects(parameters, config.robot is not None)
    ground = Ground(ground.along, ground.across)
    with run.watch.stage("shear"), run.progress("ground that shears", len(robots) * _STAGES, "stages") as done:
        found = [measure(name, one, ground, config, done) for name, one in robots.items()]
    return Findings(
        TITLE,
        [_INTRO],
        [check for one in found for check in checks_of(one)],
        [],
        [Section(f"Robot: {one.robot}", _plots(one)) for one in found],
        _LIMITS,
        {"robots": {one.robot: _summary_of(one) for one in found}},
        {"robots": robots, "ground": ground},
    )


def subjects(parameters: RobotParameters, given: bool) -> dict[str, RobotParameters]:
    """The robots to measure, by name."""
    if given:
        return {"robot": parameters}
    return {"shipped": parameters, "larger": RobotParameters(half_gauge=0.25, contact_length=0.5)}


def measure(name: str, parameters: RobotParameters, ground: Ground, config: Config, done: Any) -> ShearMeasurements:
    """Measure a robot; `done` is called with 1 after each stage."""
    world = parameters, ground, config.threads
    turns = turn(*world)
    done(1.0)
    climbing, pulling = slopes(*world), pulls(*world)
    done(1.0)
    parked, stops = creep(*world), stop_and_go(*world)
    done(1.0)
    bits = differing(parameters, ground, generator(config.seed, "shear bits"))
    done(1.0)
    cost = cost_ratio(load_robot(parameters=parameters))
    done(1.0)
    return ShearMeasurements(name, parameters, turns, climbing, pulling, parked, stops, bits, cost)


def turn(parameters: RobotParameters, ground: Ground, threads: int) -> ShearTurns:
    """Let a robot turn as in the paper, and on the spot, on ground with every modulus."""
    radius, speed = paper_turns(parameters)
    spins = np.outer(np.array(ON_THE_SPOT) / parameters.sprocket_radius, [-1.0, 1.0])
    omega = np.concatenate([turning_sprockets(parameters, radius, speed), spins])
    radius = np.concatenate([radius, np.zeros(len(spins))])
    return joined(
        [_turns(parameters, ground, moduli, omega, radius, threads) for moduli in ((0.0,), (FIRM, *MODULI))]
    )  # ground that does not shear has other pads


def _turns(
    parameters: RobotParameters, ground: Ground, moduli: tuple[float, ...], omega: Array, radius: Array, threads: int
) -> ShearTurns:
    robot = load_robot(parameters=parameters)
    shear, rows = np.repeat(moduli, len(omega)), np.tile(omega, (len(moduli), 1))
    grounds = [Ground(ground.along, ground.across, shear=float(k)) for k in shear]
    fleet = Fleet(robot, np.zeros((len(rows), 3)), grounds, parameters.radius_error, tireless(), threads)
    fleet.command(rows)
    belts, lines = belt_speeds(parameters, rows), contact(parameters, ground)
    twist = mean_twist(fleet, PASSES * parameters.contact_length / float(np.abs(belts).min()))
    expected = np.concatenate([steady_twist(belts[shear == k], lines, GRAVITY, shear=k) for k in moduli])
    turns = turns_of(parameters, rows, twist, expected)
    return ShearTurns(**vars(turns), shear=shear, radius=np.tile(radius, len(moduli)))


def checks_of(found: ShearMeasurements) -> list[Check]:
    """All checks of a robot."""
    turns, checks = found.turns, []

    def check(what: str, value: float, bound: float, unit: str = "1", source: str = _THEORY) -> None:
        checks.append(Check(found.robot, what, float(value), bound, unit, source=source))

    coulomb, straight = turns.half_width[turns.shear == 0], ~turns.spins[turns.shear == 0]
    firm = turns.half_width[turns.shear == FIRM] / coulomb - 1
    check("K = 0.01 mm against Coulomb ground, b + D in turns", np.abs(firm[straight]).max(), _FIRM)
    for k, shear in enumerate(MODULI):
        case, of = f"K = {1e3 * shear:g} mm, ", turns.shear == shear
        check(case + "b + D in 25 turns, relative error", np.abs(turns.icr_error[of & ~turns.spins]).max(), _TURNS)
        check(case + "b + D on the spot, relative error", np.abs(turns.icr_error[of & turns.spins]).max(), _SPOT)
        check(case + "error of slip in 25 turns", np.abs(turns.slip_error[of & ~turns.spins]).max(), _SLIP)
        for what, one, bound in (("on slopes", found.slopes, _SLOPE), ("under pull", found.pulls, _SLIP)):
            check(case + f"error of slip straight ahead {what}", one.error((one.shear == shear) & ~one.turns), bound)
        check(case + "creep parked on 10°, over that on Coulomb ground", found.creep[k].max(), _CREEP)
        way, expected = found.stops.slipped[:, k], found.stops.expected[:, k]
        bound = _STOPS[0] * expected[-1] + _STOPS[1]
        check(case + "stop and go, error of the distance slipped", np.abs(way - expected).max(), float(bound), "m")
    for what, count in found.differing.items():
        check(f"numbers with other bits {what}", count, 0.0, source="the same computation")
    most = _WHEELS_COST if found.parameters.axles else _COST
    check(f"processor time of {FEWEST} robots, over that on Coulomb ground", found.cost, most, source="requirement")
    return checks


def _summary_of(found: ShearMeasurements) -> dict[str, Any]:
    """The numbers behind the checks, and errors without a bound."""
    turns, pulled = found.turns, found.pulls
    names = ("shear", "radius", "half_width", "expected_half_width", "slip", "expected_slip")
    turning = {f"{1e3 * k:g} mm": pulled.error(pulled.turns & (pulled.shear == k)) for k in MODULI}
    return {
        "turns": {name: getattr(turns, name) for name in names},
        "slopes": found.slopes,
        "pulls": pulled,
        "slip_error_turning_under_pull": turning,
    }


def _plots(found: ShearMeasurements) -> tuple[Plot, ...]:
    return (
        Plot(
            f"{found.robot}_turns",
            partial(figures.offsets, found.turns, found.parameters.half_gauge),
            "Turns",
            "D, by which the tracks' ICRs lie farther out than the tracks; lines are theory. On ground that shears it "
            "falls with the radius: the outer parts of a track's contact slide far enough to be held in full only in "
            "tight turns.",
            "",
        ),
        Plot(
            f"{found.robot}_loads",
            partial(figures.slips, found.slopes, found.pulls),
            "Load",
            "Slip straight uphill, and straight ahead with a drawbar; lines are theory.",
            "",
        ),
        Plot(
            f"{found.robot}_stops",
            partial(figures.stops, found.stops),
            "Stop and go",
            "Dotted: distance by which the robot lags behind its belts on a slope, with stops. Lines: the steady slip "
            "of the belts' way, which knows no inertia.",
            "",
        ),
    )
