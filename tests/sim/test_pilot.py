import numpy as np
import pytest

from sim.fleet import Fleet
from sim.pilot import Pilot
from sim.run_recorder import RunRecorder
from trackslip.controllers.dynamic_feedback import DynamicFeedback
from trackslip.controllers.error_feedback import Feedforward, LinearTimeVarying
from trackslip.kinematics import advance
from trackslip.laws.icr import ConstantIcr
from trackslip.online.compensation import FixedLaw, OnlineIcr
from trackslip.trajectory.segmented import paper_reference

START = np.array([[0.0, 0.0, 1.5], [0.05, 0.0, 1.6], [0.0, 0.1, 1.4], [-0.05, 0.1, 1.7]])
ROWS, PERIOD = 5, 0.05


@pytest.fixture(scope="module")
def fleet(robot):
    return Fleet(robot, START)


def commands(fleet, pilots, robots=range(4)):
    """Set points (T, R, 2) that pilots of the fleet give to some robots, which creep forwards."""
    record = RunRecorder(fleet, ROWS, PERIOD, None)
    record.pose[:] = START + np.arange(ROWS)[:, None, None] * [0.0, 0.004, 0.0]
    record.omega[:] = 1.0
    omega = np.zeros((ROWS, 4, 2))
    for pilot in pilots:
        pilot.begin(record)
        for k in range(ROWS):
            law = pilot.law(record, k)
            twist = pilot.twist(record, k, law, paper_reference())
            omega[k, pilot.robots] = law.sprocket_speeds(twist, fleet.robot.geometry)
    return omega[:, list(robots)]


@pytest.mark.parametrize("controller", [LinearTimeVarying, DynamicFeedback, Feedforward])
def test_a_pilot_of_many_robots_is_as_many_pilots_to_the_bit(fleet, controller):
    geometry = fleet.robot.geometry
    law = ConstantIcr(0.03, geometry.half_gauge, 0.006)
    for make in (lambda: FixedLaw(law), lambda: OnlineIcr(geometry, law)):
        together = commands(fleet, [Pilot(controller(), range(4), make(), 0.02)])
        alone = commands(fleet, [Pilot(controller(), [k], make(), 0.02) for k in range(4)])
        np.testing.assert_array_equal(together, alone)


def test_a_preview_looks_ahead_of_the_motion_and_the_reference(fleet):
    geometry, controller, reference = fleet.robot.geometry, LinearTimeVarying(), paper_reference()
    law = ConstantIcr(0.03, geometry.half_gauge, 0.006)
    found = commands(fleet, [Pilot(controller, range(4), FixedLaw(law), 0.1)])
    ahead = advance(START, law.twist(np.ones((4, 2)), geometry), 0.1)
    expected = law.sprocket_speeds(controller.twist(0.1, ahead, reference), geometry)
    np.testing.assert_allclose(found[0], expected, rtol=1e-12)
