import re

import numpy as np
import pytest

from sim.fleet import Fleet
from sim.loop import closed_loop, open_loop
from sim.pilot import Pilot
from sim.robot.robot import load_robot
from sim.run_recorder import Description
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from trackslip.controllers.error_feedback import Feedforward, LinearTimeVarying
from trackslip.errors import InvalidValueError, RunFailedError
from trackslip.laws.icr import ConstantIcr
from trackslip.localization.plate import PlateLocator
from trackslip.metrics import tracking_errors
from trackslip.online.compensation import FixedLaw, OnlineIcr
from trackslip.skid_theory import line_contact, steady_twist
from trackslip.trajectory.segmented import Segment, SegmentedReference

START = np.array([[-1.5, 0.0, 0.0]] * 2)
OMEGA = np.array([[2.0, 3.0], [3.0, 4.0]])


def set_up(robot, start):
    fleet = Fleet(robot, start)
    return fleet, ScannerFeed(LaserScanner(), fleet)


def names(n):
    return [Description(f"run {k}", {"number": k}) for k in range(n)]


def test_open_loop_logs_what_happened(robot):
    fleet, feed = set_up(robot, START)
    seconds = []
    logs = open_loop(fleet, OMEGA, 5.0, feed, PlateLocator(robot.plate), names(2), seconds.append)
    assert sum(seconds) == pytest.approx(5.0)
    for k, log in enumerate(logs):
        assert log.run == f"run {k}"
        assert log.metadata == {"number": k}
        np.testing.assert_allclose(log.time, np.arange(101) * 0.05)
        np.testing.assert_allclose(log.command, np.tile(OMEGA[k], (101, 1)))
        np.testing.assert_allclose(log.omega[20:], np.tile(OMEGA[k], (81, 1)), atol=2e-3)
        error = (log.pose - log.truth.pose)[log.is_valid]
        assert np.abs(error[:, :2]).max() < 0.02
        assert np.sqrt(np.mean(error[:, :2] ** 2)) < 0.004
        # the true pose is the integral of the true twist
        turn = np.trapezoid(log.truth.twist[:, 2], log.time)
        assert turn == pytest.approx(log.truth.pose[-1, 2], rel=1e-3)
        assert np.all(log.truth.torque[20:, 1] > 0)


def test_tractions_and_pad_forces_are_means_since_the_row_before(robot):
    """Together their impulses are the momentum that a robot gains."""
    fleet = Fleet(load_robot(contact_sensors=True), [[0.0, 0.0, 0.0]])
    (log,) = open_loop(fleet, np.array([[3.0, 3.0]]), 0.5, period=0.05)
    gained = robot.mass * log.truth.twist[-1, 0]
    assert log.truth.traction[1:].sum() * 0.05 == pytest.approx(gained, rel=0.003)
    assert log.truth.contact[1:, :, 0].sum() * 0.05 == pytest.approx(gained, rel=0.003)
    np.testing.assert_allclose(log.truth.contact[1:, :, 2].sum(axis=1), robot.mass * 9.81, rtol=0.01)


def short_path():
    return SegmentedReference(
        (0.0, 0.0, np.pi / 2),
        [Segment(2.0, 0.0, 0.15), Segment(6.0, 0.15, 0.15, 0.8), Segment(2.0, 0.15, 0.0)],
    )


def theoretical_law(robot):
    """A constant ICR from theory alone: nothing identified."""
    contact = line_contact(robot.geometry.half_gauge, robot.parameters.contact_length / 2, 0.70, 0.775)
    yaw_rate = steady_twist([0.1, 0.14], contact)[2]
    half_gauge = robot.geometry.half_gauge
    return ConstantIcr(0.04 / (2 * yaw_rate) - half_gauge, half_gauge, 0.0067)


@pytest.mark.parametrize("controller", [Feedforward(), LinearTimeVarying()])
def test_the_right_law_keeps_the_robot_on_the_path(robot, controller):
    reference = short_path()
    start = np.tile(reference.pose(0.0), (2, 1))
    fleet, feed = set_up(robot, start)
    pilots = [Pilot(controller, [0]), Pilot(controller, [1], FixedLaw(theoretical_law(robot)))]
    plain, compensated = (
        tracking_errors(log.time, log.truth.pose, reference)
        for log in closed_loop(fleet, pilots, reference, feed, PlateLocator(robot.plate), names(2))
    )
    assert compensated.rms_position < 0.012
    assert compensated.rms_position < plain.rms_position / 1.5
    assert compensated.final_position < plain.final_position or plain.final_position < 0.01


def test_the_icrs_are_learnt_on_the_way_and_logged(robot):
    reference, law, geometry = short_path(), theoretical_law(robot), robot.geometry
    fleet, feed = set_up(robot, np.tile(reference.pose(0.0), (2, 1)))
    none = ConstantIcr(0.0, geometry.half_gauge)
    pilots = [
        Pilot(LinearTimeVarying(), [0], OnlineIcr(geometry, none)),
        Pilot(LinearTimeVarying(), [1], FixedLaw(law)),
    ]
    learnt, fixed = closed_loop(fleet, pilots, reference, feed, PlateLocator(robot.plate))
    assert abs(learnt.icr[0, 0]) < 1e-3
    assert learnt.icr[-1, 0] == pytest.approx(law.offset, rel=0.3)
    np.testing.assert_array_equal(fixed.icr, np.tile([law.offset, law.radius_error], (len(fixed.time), 1)))


def test_closed_loop_ends_with_the_reference_and_logs_its_twist(robot):
    reference = short_path()
    fleet, feed = set_up(robot, reference.pose([0.0]))
    log = closed_loop(fleet, [Pilot(Feedforward(), [0])], reference, feed, None, names(1))[0]
    assert log.time[-1] == pytest.approx(reference.duration)
    np.testing.assert_array_equal(log.twist_command, reference.twist(log.time))
    np.testing.assert_array_equal(log.pose, log.truth.pose)
    # it brakes at 0.075 m/s^2, late by the servo's lag of 50 ms and a scan's hold of at most 50 ms
    assert np.abs(log.truth.twist[-1]).max() < 0.075 * 0.1


def test_runs_that_make_no_sense_are_refused(robot):
    fleet, feed = set_up(robot, START)
    for robots in ([0], [0, 0], [0, 2]):
        with pytest.raises(InvalidValueError, match="pilots"):
            closed_loop(fleet, [Pilot(Feedforward(), robots)], short_path(), feed)
    with pytest.raises(InvalidValueError, match=r"duration = 0\.01: must be at least the time between two scans"):
        open_loop(fleet, OMEGA, 0.01, feed)
    with pytest.raises(InvalidValueError, match="descriptions = '1 descriptions': must be 2, one per robot"):
        open_loop(fleet, OMEGA, 1.0, descriptions=names(1))


class FailsAfter(Feedforward):
    """Feedforward that raises after a time [s]."""

    def __init__(self, after):
        self._after = after

    def twist(self, time, pose, reference):
        if time > self._after:
            raise RuntimeError("out of order")
        return super().twist(time, pose, reference)


@pytest.mark.parametrize("detail", [False, True])
def test_a_controller_that_fails_leaves_the_rows_before(robot, detail):
    robot = load_robot(contact_sensors=True) if detail else robot
    reference = short_path()
    start = np.tile(reference.pose(0.0), (2, 1))
    fleet, feed = set_up(robot, start)
    pilots = [Pilot(Feedforward(), [0]), Pilot(FailsAfter(0.99), [1])]
    with pytest.raises(RunFailedError, match=r"^run 'run 1': its controller fails at 1 s \(RuntimeError") as failure:
        closed_loop(fleet, pilots, reference, feed, PlateLocator(robot.plate), names(2))
    fleet, feed = set_up(robot, start)
    pilots = [Pilot(Feedforward(), [0]), Pilot(FailsAfter(np.inf), [1])]
    whole = closed_loop(fleet, pilots, reference, feed, PlateLocator(robot.plate), names(2))
    for log, expected in zip(failure.value.logs, whole, strict=True):
        assert len(log.time) == 20
        assert log.metadata == {"number": expected.metadata["number"], "failure": str(failure.value)}
        np.testing.assert_allclose(log.pose, expected.pose[:20], atol=1e-6)  # robot 0 is located afterwards, in blocks
        np.testing.assert_array_equal(log.command, expected.command[:20])
        np.testing.assert_array_equal(log.twist_command, expected.twist_command[:20])
        assert (log.scans is not None) == detail
        if detail:
            np.testing.assert_array_equal(log.scans.full, expected.scans.full[:20])
            np.testing.assert_array_equal(log.scans.cluster.count, expected.scans.cluster.count[:20])


class Returns(Feedforward):
    """A controller that always returns the same."""

    def __init__(self, twist):
        self._twist = np.array(twist)

    def twist(self, time, pose, reference):
        return self._twist


class NotFiniteAfter(SegmentedReference):
    """A reference whose twist is NaN after 0.07 s."""

    def twist(self, time):
        return np.where(np.asarray(time)[..., None] > 0.07, np.nan, super().twist(time))


@pytest.mark.parametrize(
    ("controller", "reference", "message", "rows"),
    [
        (Returns([[np.nan, 0.0]]), SegmentedReference, "returns the twist (nan, 0.0) at 0 s: must be finite", []),
        (Returns([0.0, 0.0]), SegmentedReference, "twists have the shape (2,): must be (1, 2), one per pose", []),
        (Feedforward(), NotFiniteAfter, "returns the twist (nan, nan) at 0.1 s: must be finite", [2]),
    ],
)
def test_twists_that_are_none_are_refused(robot, controller, reference, message, rows):
    path = reference((0.0, 0.0, 0.0), [Segment(2.0, 0.0, 0.15)])
    with pytest.raises(RunFailedError) as failure:
        closed_loop(Fleet(robot, path.pose([0.0])), controller, path)
    assert re.fullmatch(f"run 'run 0': its controller('s)? {re.escape(message)}", str(failure.value))
    assert [len(log.time) for log in failure.value.logs] == rows
