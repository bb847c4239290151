"""What a validation of ground that shears measures, and the checks of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.measuring.check import Check
from experiments.validation.shear.cost import FEWEST, MOST, cost
from experiments.validation.shear.exactness import differing
from experiments.validation.shear.loads import Slips, StopAndGo, creep, pulls, slopes, stop_and_go
from experiments.validation.shear.turning import FIRM, MODULI, Turns, turn
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from sim.seeds import generator
from trackslip.kinematics import Array

STAGES = 5
"""Steps of progress for a robot."""
_TURNS, _SPOT, _SLIP, _SLOPE, _FIRM = 0.005, 0.013, 0.002, 0.001, 0.005
_CREEP = 1.2
_SECONDS, _COMPARED = 16.0, 20  # simulated by all robots to compare the cost [s], and how often
_STOPS = (0.1, 1.5e-3)  # part of the distance slipped, and [m]


@dataclass(frozen=True)
class ShearFindings:
    """Everything about one robot."""

    robot: str
    """Its name."""
    parameters: RobotParameters
    ground: Ground
    """Its friction."""
    turns: Turns
    slopes: Slips
    pulls: Slips
    creep: Array  # (K, H) over that on Coulomb ground [-]
    stops: StopAndGo
    differing: dict[str, int]
    """Numbers whose bits differ where none should."""
    cost: float
    """Processor time of a fleet over that on Coulomb ground [-]."""


def subjects(parameters: RobotParameters, given: bool) -> dict[str, RobotParameters]:
    """The robots to measure, by name: the one that is `given`; else the shipped one, and a larger one."""
    if given:
        return {"robot": parameters}
    return {"shipped": parameters, "larger": RobotParameters(half_gauge=0.25, contact_length=0.5)}


def measure(
    name: str, parameters: RobotParameters, ground: Ground, seed: int, threads: int, done: Callable[[float], None]
) -> ShearFindings:
    """Measure a robot; `done` is called with 1 after each of STAGES."""
    world = parameters, ground, threads
    turns = turn(*world)
    done(1.0)
    climbing, pulling = slopes(*world), pulls(*world)
    done(1.0)
    parked, stops = creep(*world), stop_and_go(*world)
    done(1.0)
    bits = differing(parameters, ground, generator(seed, "shear bits"))
    done(1.0)
    time = cost(load_robot(parameters=parameters), FEWEST, 1, _SECONDS, _COMPARED).cost_ratio
    done(1.0)
    return ShearFindings(name, parameters, ground, turns, climbing, pulling, parked, stops, bits, time)


def summary_of(found: ShearFindings) -> dict[str, Any]:
    """The numbers behind the checks, and errors without a bound."""
    pulled = found.pulls
    turning = {
        f"{1e3 * k:g} mm": float(np.abs(pulled.slip - pulled.expected)[pulled.turns & (pulled.shear == k)].max())
        for k in MODULI
    }
    return {"turns": found.turns, "slopes": found.slopes, "pulls": pulled, "slip_error_turning_under_pull": turning}


def checks_of(found: ShearFindings) -> list[Check]:
    """Everything that a robot has to reach."""
    turns, checks = found.turns, []

    def check(what: str, value: float, bound: float, unit: str = "1") -> None:
        checks.append(Check(found.robot, what, float(value), bound, unit))

    coulomb = turns.half_width[turns.shear == 0]
    firm = turns.half_width[turns.shear == FIRM] / coulomb - 1
    check(
        "K = 0.01 mm against Coulomb ground, b + D in turns", np.abs(firm[~turns.spins[turns.shear == 0]]).max(), _FIRM
    )
    for k, shear in enumerate(MODULI):
        case, of = f"K = {1e3 * shear:g} mm, ", turns.shear == shear
        check(case + "b + D in 25 turns, relative error", np.abs(turns.error[of & ~turns.spins]).max(), _TURNS)
        check(case + "b + D on the spot, relative error", np.abs(turns.error[of & turns.spins]).max(), _SPOT)
        slip = (turns.slip - turns.expected_slip)[of & ~turns.spins]
        check(case + "error of slip in 25 turns", np.abs(slip).max(), _SLIP)
        for what, one, bound in (("on slopes", found.slopes, _SLOPE), ("under pull", found.pulls, _SLIP)):
            rows = (one.shear == shear) & ~one.turns
            check(case + f"error of slip straight ahead {what}", np.abs(one.slip - one.expected)[rows].max(), bound)
        check(case + "creep parked on 10°, over that on Coulomb ground", found.creep[k].max(), _CREEP)
        way, expected = found.stops.slipped[:, k], found.stops.expected[:, k]
        bound = _STOPS[0] * expected[-1] + _STOPS[1]
        check(case + "stop and go, error of the distance slipped", np.abs(way - expected).max(), float(bound), "m")
    for what, count in found.differing.items():
        check(f"numbers with other bits {what}", count, 0.0)
    check(f"processor time of {FEWEST} robots, over that on Coulomb ground", found.cost, MOST)
    return checks
