"""Ground that shears against theory, for K = 2 to 25 mm, under the shipped robot and a larger one.

Parked robots and equal bits at any number of threads are in tests/sim.
"""

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


def setups(*moduli):
    return {
        name: [Setup(robot, Ground(shear=shear)) for shear in moduli]
        for name, robot in ROBOTS.items()
    }


def largest(pair):
    return float(np.abs(pair[1] - pair[0]).max())


def relative(pair):
    return float(np.abs(pair[1] / pair[0] - 1).max())


def test_turns():
    checks = []
    for name, (coulomb, firm, *shearing) in setups(0.0, FIRM, *MODULI).items():
        omega = paper_turns(coulomb.parameters)[2]
        spins = np.outer([0.06, 0.12, 0.24], [-1.0, 1.0]) / coulomb.sprocket_radius
        half_width = [drive_steadily(setup, omega).half_width[1] for setup in (coulomb, firm)]
        checks.append(
            Check(name, "K = 0.01 mm against Coulomb ground, b + D", relative(half_width), 0.005)
        )
        for setup in shearing:
            case, turns = f"K = {1e3 * setup.ground.shear:g} mm", drive_steadily(setup, omega)
            checks.append(
                Check(name, f"{case}, b + D in 25 turns", relative(turns.half_width), 0.005)
            )
            checks.append(Check(name, f"{case}, slip in 25 turns", largest(turns.slip), 0.002))
            checks.append(
                Check(
                    name,
                    f"{case}, b + D on the spot",
                    relative(drive_steadily(setup, spins).half_width),
                    0.013,
                )
            )
    report("Turns on ground that shears", checks)


def test_loads():
    """Slip straight ahead on slopes and with a drawbar, and in turns with a drawbar, which are
    further off.
    """
    checks = []
    for name, on_grounds in setups(*MODULI).items():
        for setup in on_grounds:
            straight = np.full((1, 2), SPEED) / setup.sprocket_radius
            slopes = [Load(slope) for slope in np.radians([5.0, 10.0, 15.0, 20.0])]
            pulls = [Load(pull=pull, hitch_height=0.1) for pull in (0.05, 0.10, 0.15, 0.20, 0.25)]
            for what, loads, omega, bound in (
                ("on slopes", slopes, straight, 0.001),
                ("with a drawbar", pulls, straight, 0.002),
                ("turning with a drawbar", pulls, straight * [0.75, 1.25], 0.005),
            ):
                error = max(
                    largest(drive_steadily(setup, omega, load, passes=4.5).slip) for load in loads
                )
                checks.append(
                    Check(name, f"K = {1e3 * setup.ground.shear:g} mm, slip {what}", error, bound)
                )
    report("Load on ground that shears", checks)


def test_stop_and_go():
    """Uphill on 10 degrees with stops, a robot lags behind its belts by the steady slip of the way
    that these run.
    """
    checks, cycle, ramp = [], 3.5, [0.0, 0.5, 1.5, 2.0]  # brake, stand, start again, and drive [s]
    for name, on_grounds in setups(*MODULI).items():
        for setup in on_grounds:
            load, p, radius = (
                Load(np.radians(10.0)),
                setup.parameters,
                float(setup.sprocket_radius[0]),
            )
            fleet = setup.fleet(
                np.zeros((1, 3)), Ground(slope=load.slope, shear=setup.ground.shear)
            )
            fleet.command([SPEED / radius] * 2)
            fleet.advance(round(6.0 * p.contact_length / SPEED, 1))
            contact = p.contact_theory(setup.ground.along, setup.ground.across, 100)
            slip = 1 - steady_twist([1.0, 1.0], contact, shear=setup.ground.shear, load=load)[0]
            begin, turned, error, period = (
                fleet.pose()[0, 0],
                fleet.drive.angle[0].mean(),
                0.0,
                5 * fleet.period,
            )
            for k in range(round(4 * cycle / period)):
                speed = SPEED * np.interp((k * period) % cycle, ramp, [1.0, 0.0, 0.0, 1.0])
                fleet.command([speed / radius] * 2)
                fleet.advance(period)
                way = radius * (fleet.drive.angle[0].mean() - turned)
                error = max(error, abs(way - (fleet.pose()[0, 0] - begin) - slip * way))
            bound = 0.1 * slip * way + 1.5e-3
            checks.append(Check(name, f"K = {1e3 * setup.ground.shear:g} mm", error, bound, "m"))
    report("Stop and go on 10°: error of the distance slipped", checks)
