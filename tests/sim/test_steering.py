from dataclasses import dataclass

import numpy as np
import pytest

from sim.fleet import Fleet
from sim.run_recorder import RunRecorder
from sim.steering import Pilot, Steering
from trackslip.controllers.dynamic_feedback import DynamicFeedback
from trackslip.controllers.feedforward import Feedforward
from trackslip.controllers.linear import LinearTimeVarying
from trackslip.slip.compensation import FixedLaw, OnlineIcr
from trackslip.slip.icr import ConstantIcr
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
    steering = Steering(pilots, fleet.pose(), record, paper_reference(), fleet.robot.geometry)
    return np.stack([steering.omega(k, PERIOD).copy() for k in range(ROWS)])[:, list(robots)]


@pytest.mark.parametrize("controller", [LinearTimeVarying, DynamicFeedback, Feedforward])
def test_company_changes_no_bits(fleet, controller):
    b = fleet.robot.geometry.half_gauge
    laws = [ConstantIcr(0.03, b), ConstantIcr(0.05, b, 0.006)]

    def compensation(k):
        return OnlineIcr(fleet.robot.geometry, laws[0]) if k == 3 else FixedLaw(laws[k % 2])

    together = commands(fleet, [Pilot(controller(), [k], compensation(k), 0.02 * (k == 2)) for k in range(4)])
    for k in range(4):
        others = [i for i in range(4) if i != k]
        pilots = [Pilot(controller(), [k], compensation(k), 0.02 * (k == 2)), Pilot(Feedforward(), others)]
        np.testing.assert_array_equal(commands(fleet, pilots, [k]), together[:, [k]])


@dataclass(frozen=True)
class Counting:
    """A user's controller, equal to any other of its kind, that stands still and counts its calls."""

    calls: list

    def reset(self):
        self.calls.append("reset")

    def twist(self, time, pose, reference):
        self.calls.append(len(pose))
        return np.zeros((len(pose), 2))

    def __eq__(self, other):
        return isinstance(other, Counting)

    __hash__ = None


def test_a_users_controllers_are_called_one_by_one(fleet):
    first, second = Counting([]), Counting([])
    commands(fleet, [Pilot(first, [0, 2]), Pilot(second, [1]), Pilot(Feedforward(), [3])])
    assert first.calls == ["reset", *[2] * ROWS]
    assert second.calls == ["reset", *[1] * ROWS]


def test_a_subclass_of_a_controller_is_a_users_controller(fleet):
    class Halved(Feedforward):
        def __init__(self, share):
            object.__setattr__(self, "share", share)

        def twist(self, time, pose, reference):
            return self.share * super().twist(time, pose, reference)

    whole, half = Halved(1.0), Halved(0.5)
    assert whole == half  # by the fields of the class above it
    found = commands(fleet, [Pilot(whole, [0]), Pilot(half, [1]), Pilot(Feedforward(), [2, 3])])
    np.testing.assert_allclose(found[:, 1], found[:, 0] / 2)
    np.testing.assert_array_equal(found[:, 0], found[:, 2])
    assert np.abs(found[-1]).min() > 0
