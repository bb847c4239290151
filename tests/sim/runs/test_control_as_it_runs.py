"""Closed loops with limits of real ones: computing time, late commands, lost poses, top speed."""

import time

import numpy as np
import pytest
from own_clock import Clock

from sim import Drive, Fleet, LaserScanner, Pilot, ScannerFeed, closed_loop, load_robot
from sim.runs.delayed_commands import DelayedCommands
from sim.runs.loop import MEASURED
from sim.runs.run_recorder import TOP_SPEED_SHARE, Description
from sim.runs.stopwatch import StepTimes, Stopwatch
from trackslip.controllers.feedback import Feedforward, LinearTimeVarying
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.laws.file import load_laws
from trackslip.localization.line import LineLocator
from trackslip.localization.plate import PlateLocator
from trackslip.metrics import tracking_errors
from trackslip.online.compensation import FixedLaw, named_compensation
from trackslip.trajectory.segmented import circle

GEOMETRY = RobotGeometry(0.168, 0.06)
START = (-1.5, 0.0, np.pi / 2)
PATH = circle(1.25, 0.15, 2.0, START)
LAW = FixedLaw(load_laws()["icr_radius"])


@pytest.fixture
def clock(monkeypatch):
    ours = Clock()
    monkeypatch.setattr("sim.runs.loop.time", ours)
    return ours


class Slow(LinearTimeVarying):
    """Takes its time in `sense`, in `twist` and, from 1 s on, in `twist` again."""

    def __init__(self, clock, sense=0.0, twist=0.0, later=0.0):
        super().__init__()
        object.__setattr__(self, "taken", (clock, sense, twist, later))

    def sense(self, omega):
        clock, sense, _, _ = self.taken
        clock.sleep(sense)

    def twist(self, time, pose, reference):
        clock, _, twist, later = self.taken
        clock.sleep(twist + (later if time > 1 else 0.0))
        return super().twist(time, pose, reference)


def steps_of(controller, compensation=LAW):
    watch = Stopwatch()
    robot = load_robot()
    pilots = [Pilot(controller, [0], compensation)]
    closed_loop(Fleet(robot, PATH.pose([0.0])), pilots, PATH, watch=watch)
    return watch.steps["run 0"]


@pytest.mark.parametrize(
    ("taken", "median", "worst"),
    [
        ({"sense": 0.06}, 0.06, 0.06),
        ({"twist": 0.06}, 0.06, 0.06),
        ({"sense": 0.02, "twist": 0.03}, 0.05, 0.05),
        ({"later": 0.06}, 0.0, 0.06),
    ],
)
def test_each_control_step_of_a_run_is_timed(clock, taken, median, worst):
    steps = steps_of(Slow(clock, **taken))
    assert len(steps) == 41
    times = StepTimes.of(steps)
    assert times.median == pytest.approx(median)
    assert times.worst == pytest.approx(worst)


def test_the_law_is_part_of_a_control_step(clock):
    class Learning(FixedLaw):
        def observe(self, omega, duration, estimate):
            clock.sleep(0.01)

        def law(self):
            clock.sleep(0.02)
            return self.known

    steps = steps_of(Feedforward(), Learning(LAW.known))
    np.testing.assert_allclose(steps, [0.02] + 40 * [0.03])


def test_a_shared_pilot_is_not_taken_for_a_single_robot(clock):
    watch = Stopwatch()
    fleet = Fleet(load_robot(), np.tile(PATH.pose(0.0), (3, 1)))
    pilots = [Pilot(Slow(clock, twist=0.01), [2]), Pilot(Slow(clock, twist=0.07), [0, 1])]
    closed_loop(fleet, pilots, PATH, watch=watch)
    assert [*watch.steps] == ["run 2"]
    assert max(watch.steps["run 2"]) == pytest.approx(0.01)


def test_the_real_clock_measures_what_a_controller_waits(robot):
    class Waits(Feedforward):
        def sense(self, omega):
            time.sleep(0.01)

    path = circle(1.25, 0.15, 0.5, START)
    watch = Stopwatch()
    closed_loop(Fleet(robot, path.pose([0.0])), Waits(), path, watch=watch)
    assert min(watch.steps["run 0"]) >= 0.01


def test_warnings_on_steps_name_how_many_are_late():
    often = StepTimes.of(100 * [0.06])
    said = "mine takes 60 ms (99 %; 60 ms at worst) a step, but commands are due every 50 ms"
    assert often.warning("mine", 0.05) == said
    once = StepTimes.of([0.2] + 500 * [0.01])
    said = "mine is late in at most 1 % of the steps: it takes 10 ms (99 %; 200 ms at worst) a step"
    assert once.warning("mine", 0.05) == f"{said}, but commands are due every 50 ms"
    assert once.warning("mine", 0.25) is None


def test_set_points_take_effect_when_they_are_due(robot):
    fleet = Fleet(robot, np.zeros((2, 3)), drive=Drive(lag=0.001))
    commands = DelayedCommands(fleet)
    commands.send(np.full((2, 2), 2.0), np.array([0.0, 0.02]))
    commands.advance(0.01)
    np.testing.assert_allclose(fleet.drive.set_point[:, 0], [2.0, 0.0])
    commands.advance(0.04)
    np.testing.assert_allclose(fleet.drive.set_point[:, 0], [2.0, 2.0])
    turned = fleet.drive.encoder_angle()[:, 0]
    np.testing.assert_allclose(turned, [0.1, 0.06], atol=0.004)


def test_no_set_point_overtakes_an_earlier_one(robot):
    fleet = Fleet(robot, np.zeros((1, 3)))
    commands = DelayedCommands(fleet)
    commands.send(np.full((1, 2), 1.0), 0.06)
    commands.advance(0.02)
    commands.send(np.full((1, 2), 2.0), 0.0)
    assert fleet.drive.set_point[0, 0] == 0.0
    commands.advance(0.04)
    assert fleet.drive.set_point[0, 0] == 2.0


def test_means_over_a_row_include_the_time_before_a_late_command(robot):
    def traction(parts):
        fleet = Fleet(robot, np.zeros((1, 3)))
        commands = DelayedCommands(fleet)
        commands.send(np.full((1, 2), 3.0))
        commands.advance(0.02)
        commands.send(np.full((1, 2), 3.0), parts)
        commands.advance(0.05)
        return fleet.mean_traction

    np.testing.assert_allclose(traction(0.03), traction(0.0), rtol=1e-6)


def driven(delay, controller=None):
    robot = load_robot()
    controller = controller or LinearTimeVarying()
    fleet = Fleet(robot, PATH.pose([0.0]))
    return closed_loop(fleet, [Pilot(controller, [0], LAW)], PATH, delay=delay)[0]


def test_late_commands_make_the_robot_start_late():
    now, late, later = (driven(delay) for delay in (0.0, 0.1, 0.3))
    behind = [abs(log.truth.pose[-1] - PATH.pose(2.0))[:2].max() for log in (now, late, later)]
    assert behind[0] < behind[1] < behind[2]
    assert not late.omega[:3].any()
    assert now.omega[2].all()
    np.testing.assert_array_equal(late.command[0], now.command[0])  # as it was given


def test_measured_times_delay_as_much_as_given_ones(clock):
    measured = driven(MEASURED, Slow(clock, sense=0.03, twist=0.05))
    given = driven(0.08)
    np.testing.assert_array_equal(measured.truth.pose, given.truth.pose)
    quick = driven(MEASURED, Slow(clock, twist=0.0002))
    np.testing.assert_array_equal(quick.truth.pose, driven(0.0).truth.pose)


@pytest.mark.parametrize("delay", [-0.1, np.inf, np.nan, "late"])
def test_delays_that_make_no_sense_are_refused(delay):
    with pytest.raises(InvalidValueError, match="delay = "):
        driven(delay)


def blind(pilots, duration=30.0, locator=PlateLocator):
    """A circle out of the scanner's range, and the logs of robots on it."""
    robot = load_robot()
    path = circle(1.25, 0.15, duration, START)
    fleet = Fleet(robot, np.tile(path.pose(0.0), (sum(len(p.robots) for p in pilots), 1)))
    feed = ScannerFeed(LaserScanner(max_range=1.0), fleet)
    logs = closed_loop(fleet, pilots, path, feed, locator(robot.plate))
    return path, logs


@pytest.mark.parametrize(
    "locator", [PlateLocator, pytest.param(LineLocator, marks=pytest.mark.slow)]
)
def test_a_blind_robot_with_its_law_stays_on_the_path(locator):
    names = ("icr_radius", "online", "none")
    pilots = [
        Pilot(LinearTimeVarying(), [k], named_compensation(name, GEOMETRY))
        for k, name in enumerate(names)
    ]
    path, logs = blind(pilots, locator=locator)
    errors = [tracking_errors(log.time, log.truth.pose, path) for log in logs]
    assert not any(log.is_valid.any() for log in logs)
    assert errors[0].max_position < 0.01
    assert errors[1].max_position < 0.01
    assert errors[2].max_position > 0.5
    # errors of a pose that agree with its covariance
    error = (logs[0].pose - logs[0].truth.pose)[-1]
    deviations = error / np.sqrt(np.diagonal(logs[0].covariance[-1]))
    assert (np.abs(deviations) < 4).all()
    assert np.sqrt(logs[0].covariance[-1, 0, 0]) < 0.01


def test_lost_robots_stop_or_slow_down_when_asked():
    pilots = [
        Pilot(LinearTimeVarying(), [k], LAW, when_lost=what)
        for k, what in enumerate(("drive", "slow", "stop"))
    ]
    _, logs = blind(pilots, duration=4.0)
    driven, slowed, stopped = (log.truth.twist[-1, 0] for log in logs)
    assert driven == pytest.approx(0.15, abs=0.01)
    assert stopped == pytest.approx(0.0, abs=0.001)
    assert slowed == pytest.approx(0.075, rel=0.05)
    half_a_second = logs[2].time < 0.5
    np.testing.assert_array_equal(logs[2].command[half_a_second], logs[0].command[half_a_second])
    assert not logs[2].command[~half_a_second].any()


def test_robots_that_are_seen_now_and_then_are_not_lost(robot):
    path = circle(1.25, 0.15, 4.0, START)
    logs = []
    for what in ("drive", "stop"):
        fleet = Fleet(robot, path.pose([0.0]))
        feed = ScannerFeed(LaserScanner(dropout=0.6), fleet)
        pilots = [Pilot(LinearTimeVarying(), [0], LAW, when_lost=what)]
        logs += closed_loop(fleet, pilots, path, feed, PlateLocator(robot.plate))
    assert 0 < logs[0].is_valid.mean() < 0.9
    np.testing.assert_array_equal(logs[0].command, logs[1].command)


def test_a_run_at_the_top_speed_says_so(robot):
    fast = circle(0.5, 0.29, 5.0, START)
    slow = circle(0.5, 0.15, 5.0, START)
    shares = []
    for path in (fast, slow):
        fleet = Fleet(robot, path.pose([0.0]))
        names = [Description("mine")]
        (log,) = closed_loop(fleet, [Pilot(Feedforward(), [0], LAW)], path, descriptions=names)
        shares.append(log.metadata.get(TOP_SPEED_SHARE))
    assert shares[0] == pytest.approx(1.0, abs=0.02)
    assert shares[1] is None
