"""A fleet drives the same at any number of threads, in steps of any length, in any company, and after any past."""

import numpy as np
import pytest

from sim.drive.drive import Drive
from sim.fleet import Fleet, Setting
from sim.ground.ground import Change, Ground, Patch

PATCHED = Ground(patches=(Patch((0.02, 0.3), (0.0, 1.0), 0.2, 0.2),), changes=(Change(0.21, 0.4, 0.5),))
COULOMB = [Ground(), Ground(0.9, 1.1, slope=0.2, uphill=2.0), PATCHED, Ground(0.15, 0.15)]
SHEARING = [
    Ground(shear=0.005, slope=0.1, uphill=0.4),
    Ground(shear=0.01, patches=(Patch((0.1, 0.4), (-1, 1), 0.5, 0.6), Patch((0.3, 0.5), (-1, 1), 0.7, 0.8, 0.002))),
    Ground(shear=0.025, changes=(Change(0.2, 0.6, 0.7), Change(0.4, 0.5, 0.6, 0.001))),
    Ground(0.15, 0.15),
]


def known(fleet, rows=slice(None)):
    """Everything that a fleet knows of some of its robots."""
    drive, shear = fleet.drive, fleet.shear
    of_drive = drive.omega, drive.angle, drive.torque, drive.energy, drive.saturated_time
    of_ground = () if shear is None else (shear.displacement, shear.share)
    of_bodies = fleet.pose(), fleet.twist(), fleet.mean_traction, fleet.attitude(), fleet.friction(), fleet.batch.state
    return [np.array(values)[rows] for values in (*of_drive, *of_ground, *of_bodies)]


def assert_same(some, others):
    for one, other in zip(some, others, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "late", [{}, pytest.param({"delay": 0.033}, marks=pytest.mark.slow), {"delay": 0.01, "droop": 0.03}]
)
@pytest.mark.parametrize("grounds", [COULOMB, SHEARING], ids=["Coulomb", "shear"])
def test_strong_and_weak_robots_on_any_ground(robot, grounds, late):
    """Commands change, some turn through pi, and some motors are too weak; cut up in any way."""
    commands = np.array([[2.0, 3.0], [3.0, -1.0], [3.0, 3.0], [0.5, 1.0]])
    start = np.array([[0.1 * k, 0.0, 3.0 + 0.2 * k] for k in range(4)])

    def drive(rows, threads, steps):
        weak, shears = Drive(torque_limit=3.0, **late), grounds is SHEARING
        fleet = Fleet(robot, start[rows], [grounds[k] for k in rows], 0.01, weak, threads, shears=shears)
        for sign in (1.0, -0.7, 0.7):  # at last the belts are at their set points to the last bit
            fleet.command(sign * commands[rows])
            for step in steps:
                fleet.advance(step)
        return known(fleet)

    together = drive(range(4), 2, [0.3])
    saturated = together[4].max(axis=1)
    assert saturated.max() > 0.05  # some are too weak
    for threads, steps in ((1, [0.3]), (2, [0.01] * 30), (2, [0.15, 0.01, 0.14])):
        assert_same(together, drive(range(4), threads, steps))
    for k in range(4):
        assert_same([values[k : k + 1] for values in together], drive([k], 1, [0.05] * 6))


OMEGA = np.array([[2.0, 3.0], [-5.0, 5.0], [4.0, 1.0]])


@pytest.mark.parametrize(
    "setting",
    [
        Setting((0.3, -0.2, 7.0)),
        Setting((0.0, 0.0, 1.0), PATCHED, radius_error=0.03, lag=0.11),
        Setting((0.0, 0.0, 1.0), Ground(slope=0.15, uphill=0.4), weight=(0.03, -0.02)),
        Setting((0.3, -0.2, 1.0), SHEARING[0], radius_error=0.02, weight=(0.02, -0.01)),
    ],
)
def test_a_robot_begun_anew_is_the_same_in_any_company_and_after_any_past(robot, setting):
    shears = setting.ground.shear > 0
    grounds = SHEARING[:3] if shears else [Ground(), Ground(), PATCHED]
    alone = Fleet(robot, np.zeros((1, 3)), threads=1, shears=shears)
    company, unchanged = (Fleet(robot, np.zeros((3, 3)), grounds, threads=2, shears=shears) for _ in range(2))
    for fleet in (company, unchanged):
        fleet.command(OMEGA)
        fleet.advance(0.7)
    alone.restart([0], [setting])
    company.restart([1], [setting])
    for _ in range(15):
        for fleet, omega in ((alone, OMEGA[1:2]), (company, OMEGA), (unchanged, OMEGA)):
            fleet.command(omega)
            fleet.advance(0.1)
    assert_same(known(alone, 0), known(company, 1))
    assert_same(known(unchanged, [0, 2]), known(company, [0, 2]))
