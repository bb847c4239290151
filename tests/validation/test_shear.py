"""Ground that shears against theory, for K = 2 to 25 mm, under the shipped robot and a larger one.

Parked robots and equal bits at any number of threads are in tests/sim.
"""

from typing import NamedTuple

import numpy as np
import pytest
from trials import report

from experiments.common.check import Check
from experiments.validate.measurements import Setup, drive_steadily, paper_turns
from sim import Ground, RobotParameters
from trackslip.skid_theory import Load, steady_twist

pytestmark = pytest.mark.slow
MODULI = (0.002, 0.005, 0.010, 0.025)
FIRM = 1e-5  # ground so firm that it should be Coulomb ground [m]
SPEED = 0.12  # of the belts [m/s]
ROBOTS = {
    "shipped": RobotParameters(),
    "larger": RobotParameters(half_gauge=0.25, contact_length=0.5),
}


def setups(robot, moduli):
    return [Setup(robot, Ground(shear=shear)) for shear in moduli]


def modulus_text(setup):
    return f"K = {1e3 * setup.ground.shear:g} mm"


def largest_error(pair):
    expected, found = pair
    return float(np.abs(found - expected).max())


def largest_relative_error(pair):
    expected, found = pair
    return float(np.abs(found / expected - 1).max())


def test_turns():
    checks = []
    for name, robot in ROBOTS.items():
        coulomb, firm, *shearing = setups(robot, (0.0, FIRM, *MODULI))
        _, _, omega = paper_turns(robot)
        spins = np.outer([0.06, 0.12, 0.24], [-1.0, 1.0]) / coulomb.sprocket_radius
        half_width = [drive_steadily(setup, omega).half_width[1] for setup in (coulomb, firm)]
        error = largest_relative_error(half_width)
        checks.append(Check(name, "K = 0.01 mm against Coulomb ground, b + D", error, 0.005))
        for setup in shearing:
            case = modulus_text(setup)
            turns = drive_steadily(setup, omega)
            width_error = largest_relative_error(turns.half_width)
            checks.append(Check(name, f"{case}, b + D in 25 turns", width_error, 0.005))
            slip_error = largest_error(turns.slip)
            checks.append(Check(name, f"{case}, slip in 25 turns", slip_error, 0.002))
            spin_error = largest_relative_error(drive_steadily(setup, spins).half_width)
            checks.append(Check(name, f"{case}, b + D on the spot", spin_error, 0.013))
    report("Turns on ground that shears", checks)


class Loaded(NamedTuple):
    """Drives under loads, by speeds of the belts, and the bound of the error of slip."""

    what: str
    loads: list[Load]
    speeds: tuple[float, float]
    bound: float


SLOPES = [Load(slope) for slope in np.radians([5.0, 10.0, 15.0, 20.0])]
PULLS = [Load(pull=pull, hitch_height=0.1) for pull in (0.05, 0.10, 0.15, 0.20, 0.25)]
LOADED = (
    Loaded("on slopes", SLOPES, (SPEED, SPEED), bound=0.001),
    Loaded("with a drawbar", PULLS, (SPEED, SPEED), bound=0.002),
    Loaded("turning with a drawbar", PULLS, (0.75 * SPEED, 1.25 * SPEED), bound=0.005),
)


def test_loads():
    """Slip straight ahead on slopes and with a drawbar, and in turns with a drawbar, which are
    further off.
    """
    checks = []
    for name, robot in ROBOTS.items():
        for setup in setups(robot, MODULI):
            for what, loads, speeds, bound in LOADED:
                omega = np.array([speeds]) / setup.sprocket_radius
                turns = [drive_steadily(setup, omega, load, passes=4.5) for load in loads]
                error = max(largest_error(each.slip) for each in turns)
                checks.append(Check(name, f"{modulus_text(setup)}, slip {what}", error, bound))
    report("Load on ground that shears", checks)


CYCLE = 3.5  # of stop and go [s]
TIMES = (0.0, 0.5, 1.5, 2.0)  # in a cycle: brake, stand, start again, and drive [s]
SHARES = (1.0, 0.0, 0.0, 1.0)  # of SPEED, at TIMES


def test_stop_and_go():
    """Uphill on 10 degrees with stops, a robot lags behind its belts by the steady slip of the way
    that these run.
    """
    load = Load(np.radians(10.0))
    checks = []
    for name, robot in ROBOTS.items():
        for setup in setups(robot, MODULI):
            radius = float(setup.sprocket_radius[0])
            shear = setup.ground.shear
            contact = robot.contact_theory(setup.ground.along, setup.ground.across, 100)
            slip = 1 - steady_twist([1.0, 1.0], contact, shear=shear, load=load)[0]

            fleet = setup.fleet(np.zeros((1, 3)), Ground(slope=load.slope, shear=shear))
            fleet.command([SPEED / radius] * 2)
            fleet.advance(round(6.0 * robot.contact_length / SPEED, 1))
            begin = fleet.pose()[0, 0]
            turned = fleet.drive.angle[0].mean()
            error = 0.0
            period = 5 * fleet.period
            for k in range(round(4 * CYCLE / period)):
                speed = SPEED * np.interp((k * period) % CYCLE, TIMES, SHARES)
                fleet.command([speed / radius] * 2)
                fleet.advance(period)
                way_of_belts = radius * (fleet.drive.angle[0].mean() - turned)
                way = fleet.pose()[0, 0] - begin
                error = max(error, abs(way_of_belts - way - slip * way_of_belts))
            bound = 0.1 * slip * way_of_belts + 1.5e-3
            checks.append(Check(name, modulus_text(setup), error, bound, "m"))
    report("Stop and go on 10°: error of the distance slipped", checks)
