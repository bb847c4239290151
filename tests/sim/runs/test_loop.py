import re

import numpy as np
import pytest

from sim import Drive, Fleet, LaserScanner, Pilot, ScannerFeed, closed_loop, load_robot, open_loop
from sim.motors.motor import Motor
from sim.runs.run_recorder import Description, RunRecorder
from trackslip.controllers.feedback import DynamicFeedback, Feedforward, LinearTimeVarying
from trackslip.errors import InvalidValueError, RunFailedError
from trackslip.laws.icr import ConstantIcr
from trackslip.localization.plate import PlateLocator
from trackslip.metrics import tracking_errors
from trackslip.online.compensation import FixedLaw, OnlineIcr
from trackslip.skid_theory import line_contact, steady_twist
from trackslip.trajectory.segmented import Segment, SegmentedReference, paper_reference

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
        assert log.truth.saturated.max() == 0
        power = Motor().power(log.truth.torque[20:], log.omega[20:])
        np.testing.assert_allclose(log.truth.power[20:], power, rtol=0.05, atol=0.05)


def test_logs_have_the_returns_from_the_plate(robot):
    """Of closed loops, with all ranges, and of open loops."""
    path = short_path()
    fleet = Fleet(robot, path.pose([0.0]))
    feed = ScannerFeed(LaserScanner(), fleet, kept=True)
    pilot = Pilot(Feedforward(), [0])
    (closed,) = closed_loop(fleet, [pilot], path, feed, PlateLocator(robot.plate))
    fleet, feed = set_up(robot, START[:1])
    (opened,) = open_loop(fleet, OMEGA[:1], 1.0, feed, PlateLocator(robot.plate))
    for log in (closed, opened):
        scans = log.scans
        cluster = scans.cluster
        assert scans.plate == robot.plate
        assert scans.scan.ranges.shape == (0, len(feed.bearings))
        np.testing.assert_array_equal(cluster.bearing, feed.bearings[scans.beam])
        assert len(cluster.count) == len(log.time)
        assert cluster.count.min() > 10
        # within five standard deviations of the plate, which leans with the robot
        pose = scans.scan.from_world(log.truth.pose)
        off_plate = robot.plate.outside(pose, cluster.row, *cluster.positions)
        assert np.abs(off_plate).max() < 5 * scans.scan.noise + np.abs(log.truth.lean).max()
    full = closed.scans.full
    assert full.shape == (len(closed.time), len(feed.bearings))
    of_plate = full[closed.scans.cluster.row, closed.scans.beam]
    np.testing.assert_allclose(closed.scans.cluster.range, of_plate, atol=1e-6)
    assert opened.scans.full is None


def test_impulses_of_the_ground_are_the_momentum_gained(robot):
    fleet = Fleet(load_robot(contact_sensors=True), [[0.0, 0.0, 0.0]])
    (log,) = open_loop(fleet, np.array([[3.0, 3.0]]), 0.5, period=0.05)
    gained = robot.mass * log.truth.twist[-1, 0]
    of_belts = log.truth.traction[1:].sum() * 0.05
    assert of_belts == pytest.approx(gained, rel=0.003)
    of_pads = log.truth.contact[1:, :, 0].sum() * 0.05
    assert of_pads == pytest.approx(gained, rel=0.003)
    load = log.truth.contact[1:, :, 2].sum(axis=1)
    np.testing.assert_allclose(load, robot.mass * 9.81, rtol=0.01)


def short_path():
    ramps = [Segment(2.0, 0.0, 0.15), Segment(6.0, 0.15, 0.15, 0.8), Segment(2.0, 0.15, 0.0)]
    return SegmentedReference((0.0, 0.0, np.pi / 2), ramps)


def rms_position(log, reference):
    return tracking_errors(log.time, log.truth.pose, reference).rms_position


def theoretical_law(robot):
    """A constant ICR from theory alone: nothing identified."""
    half_gauge = robot.geometry.half_gauge
    contact = line_contact(half_gauge, robot.parameters.contact_length / 2, 0.70, 0.775)
    _, _, yaw_rate = steady_twist([0.1, 0.14], contact)
    half_width = (0.14 - 0.1) / (2 * yaw_rate)
    return ConstantIcr(half_width - half_gauge, half_gauge, 0.0067)


def test_the_right_law_keeps_to_the_path_and_icrs_are_learnt(robot):
    reference = short_path()
    law = theoretical_law(robot)
    geometry = robot.geometry
    fleet, feed = set_up(robot, np.tile(reference.pose(0.0), (5, 1)))
    learning = OnlineIcr(geometry, ConstantIcr(0.0, geometry.half_gauge))
    pilots = [
        Pilot(Feedforward(), [0]),
        Pilot(Feedforward(), [1], FixedLaw(law)),
        Pilot(LinearTimeVarying(), [2]),
        Pilot(LinearTimeVarying(), [3], FixedLaw(law)),
        Pilot(LinearTimeVarying(), [4], learning),
    ]
    logs = closed_loop(fleet, pilots, reference, feed, PlateLocator(robot.plate), names(5))
    errors = [rms_position(log, reference) for log in logs]
    for plain, compensated in (errors[0:2], errors[2:4]):
        assert compensated < min(0.012, plain / 1.5)
    first = logs[0]
    assert first.time[-1] == pytest.approx(reference.duration)
    np.testing.assert_array_equal(first.twist_command, reference.twist(first.time))
    # it brakes at 0.075 m/s^2, late by the servo's lag of 50 ms and a scan's hold of at most 50 ms
    assert np.abs(first.truth.twist[-1]).max() < 0.075 * 0.1
    *_, fixed, learnt = logs
    assert abs(learnt.icr[0, 0]) < 1e-3
    assert learnt.icr[-1, 0] == pytest.approx(law.offset, rel=0.3)
    known = np.tile([law.offset, law.radius_error], (len(fixed.time), 1))
    np.testing.assert_array_equal(fixed.icr, known)


def test_a_preview_by_the_lag_of_the_drive_makes_up_for_it(robot):
    reference = short_path()
    law = FixedLaw(theoretical_law(robot))
    lag = 0.2
    fleet = Fleet(robot, np.tile(reference.pose(0.0), (2, 1)), drive=Drive(lag=lag))
    pilots = [
        Pilot(LinearTimeVarying(), [0], law, 0.0),
        Pilot(LinearTimeVarying(), [1], law, lag),
    ]
    unread = ScannerFeed(LaserScanner(), fleet)  # as there is no locator
    late, early = closed_loop(fleet, pilots, reference, unread)
    assert rms_position(early, reference) < 0.25 * rms_position(late, reference)


def test_runs_that_make_no_sense_are_refused(robot):
    fleet, feed = set_up(robot, START)
    for robots in ([0], [0, 0], [0, 2]):
        with pytest.raises(InvalidValueError, match="pilots"):
            closed_loop(fleet, [Pilot(Feedforward(), robots)], short_path(), feed)
    said = r"duration = 0\.01: must be at least the time between two scans"
    with pytest.raises(InvalidValueError, match=said):
        open_loop(fleet, OMEGA, 0.01, feed)
    assert [len(log.time) for log in open_loop(fleet, OMEGA, 0.05, feed)] == [2, 2]
    said = "descriptions = '1 descriptions': must be 2, one per robot"
    with pytest.raises(InvalidValueError, match=said):
        open_loop(fleet, OMEGA, 1.0, descriptions=names(1))


class Custom(Feedforward):
    """A controller that is a function of time [s] and of the feedforward's twists (N, 2)."""

    def __init__(self, function):
        self._function = function

    def twist(self, time, pose, reference):
        return self._function(time, super().twist(time, pose, reference))


def fails(time, twist):
    if time > 0.99:
        raise RuntimeError("out of order")
    return twist


@pytest.mark.parametrize(
    ("function", "message", "rows"),
    [
        (
            lambda time, twist: twist * np.nan,
            "returns the twist (nan, nan) at 0 s: must be finite",
            [],
        ),
        (
            lambda time, twist: twist[0],
            "twists have the shape (2,): must be (1, 2), one per pose",
            [],
        ),
        (
            lambda time, twist: twist * (np.nan if time > 0.07 else 1),
            "returns the twist (nan, nan) at 0.1 s: ",
            [2],
        ),
    ],
)
def test_twists_that_are_none_are_refused(robot, function, message, rows):
    path = short_path()
    with pytest.raises(RunFailedError) as failure:
        closed_loop(Fleet(robot, path.pose([0.0])), Custom(function), path)
    said = f"run 'run 0': its controller('s)? {re.escape(message)}"
    assert re.match(said, str(failure.value))
    assert [len(log.time) for log in failure.value.logs] == rows


def test_a_controller_that_fails_leaves_the_rows_before():
    robot = load_robot(contact_sensors=True)
    reference = SegmentedReference((0.0, 0.0, np.pi / 2), [Segment(1.5, 0.1, 0.15)])
    start = np.tile(reference.pose(0.0), (2, 1))
    fleet, feed = set_up(robot, start)
    pilots = [Pilot(Feedforward(), [0]), Pilot(Custom(fails), [1])]
    locator = PlateLocator(robot.plate)
    said = r"^run 'run 1': its controller fails at 1 s \(RuntimeError"
    with pytest.raises(RunFailedError, match=said) as failure:
        closed_loop(fleet, pilots, reference, feed, locator, names(2))
    fleet, feed = set_up(robot, start)
    pilot = Pilot(Feedforward(), range(2))
    whole = closed_loop(fleet, [pilot], reference, feed, locator, names(2))
    for log, expected in zip(failure.value.logs, whole, strict=True):
        assert len(log.time) == 20
        assert log.metadata == {
            "number": expected.metadata["number"],
            "failure": str(failure.value),
        }
        # robot 0 is located afterwards, in blocks
        np.testing.assert_allclose(log.pose, expected.pose[:20], atol=1e-6)
        np.testing.assert_array_equal(log.command, expected.command[:20])
        np.testing.assert_array_equal(log.twist_command, expected.twist_command[:20])
        np.testing.assert_array_equal(log.scans.full, expected.scans.full[:20])
        np.testing.assert_array_equal(log.scans.cluster.count, expected.scans.cluster.count[:20])


STARTS = np.array([[0.0, 0.0, 1.5], [0.05, 0.0, 1.6], [0.0, 0.1, 1.4], [-0.05, 0.1, 1.7]])
ROWS = 5
PERIOD = 0.05


@pytest.fixture(scope="module")
def fleet(robot):
    return Fleet(robot, STARTS)


def commands(fleet, pilots):
    """Set points (T, 4, 2) that pilots of the fleet give to its robots, which creep forwards."""
    record = RunRecorder(fleet, ROWS, PERIOD, None)
    creeping = np.arange(ROWS)[:, None, None] * [0.0, 0.004, 0.0]
    record.pose[:] = STARTS + creeping
    record.omega[:] = 1.0
    omega = np.zeros((ROWS, 4, 2))
    for pilot in pilots:
        pilot.begin(record)
        for k in range(ROWS):
            law = pilot.law(record, k)
            twist = pilot.twist(record, k, law, paper_reference())
            omega[k, pilot.robots] = law.sprocket_speeds(twist, fleet.robot.geometry)
    return omega


@pytest.mark.parametrize("controller", [LinearTimeVarying, DynamicFeedback, Feedforward])
def test_a_pilot_of_many_robots_is_as_many_pilots_to_the_bit(fleet, controller):
    geometry = fleet.robot.geometry
    law = ConstantIcr(0.03, geometry.half_gauge, 0.006)
    for make in (lambda: FixedLaw(law), lambda: OnlineIcr(geometry, law)):
        together = commands(fleet, [Pilot(controller(), range(4), make(), 0.02)])
        alone = commands(fleet, [Pilot(controller(), [k], make(), 0.02) for k in range(4)])
        np.testing.assert_array_equal(together, alone)


class Dithering:
    """Feedforward with noise in the yaw rate, from a generator per robot."""

    def reset(self, seed):
        self.generators = [np.random.default_rng(one) for one in seed]

    def twist(self, time, pose, reference):
        noise = [0.1 * generator.standard_normal() for generator in self.generators]
        return reference.twist(time) + np.column_stack([np.zeros(len(pose)), noise])


def test_random_controllers_get_a_seed_per_robot(robot):
    """A robot's run depends on its seed, not on the robots beside it."""
    path = short_path()

    def driven(seeds):
        fleet = Fleet(robot, np.tile(path.pose([0.0]), (len(seeds), 1)))
        pilot = Pilot(Dithering(), range(len(seeds)), seeds=seeds)
        return [log.truth.pose for log in closed_loop(fleet, [pilot], path)]

    alone = driven([7])
    together = driven([3, 7, 7])
    np.testing.assert_array_equal(together[1], alone[0])
    np.testing.assert_array_equal(together[2], alone[0])
    assert np.abs(together[0] - alone[0]).max() > 1e-4
