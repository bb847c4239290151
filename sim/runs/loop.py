"""Open- and closed-loop runs of a fleet with RunLogs as results, and the pilots that steer the
fleet.
"""

from __future__ import annotations

import itertools
import math
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final, Literal

import numpy as np

from sim.fleet.fleet import Fleet
from sim.runs.delayed_commands import DelayedCommands
from sim.runs.pose_source import PoseEstimation, ScanBlocks, ScannedPose, TruePose
from sim.runs.run_recorder import Description, RunRecorder
from sim.runs.stopwatch import Stopwatch
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from trackslip.arguments import checks_arguments
from trackslip.controllers.base import Controller, SensesSprockets, begin_run
from trackslip.controllers.named import TURNING_CONTROLLERS
from trackslip.errors import RunFailedError, require
from trackslip.kinematics import Array, advance, limit_sprocket_speeds, track_speeds
from trackslip.laws.base import TURNING_LAWS, SlipLaw
from trackslip.localization.pose_estimate import Locator
from trackslip.logs.runlog import RunLog
from trackslip.online.compensation import Compensation, FixedLaw, SensesLoad
from trackslip.trajectory.base import Reference
from trackslip.trajectory.turns import require_turns

Progress = Callable[[float], None]
"""Function that is called with the simulated time since the last call [s]."""
PERIOD: Final = LaserScanner().period
"""Time between rows in a run without a scanner [s]."""
Delay = float | Literal["measured"]
"""Time from a scan until its command takes effect [s], or MEASURED for each control step's own
computing time.
"""
MEASURED: Final = "measured"
WhenLost = Literal["drive", "slow", "stop"]
"""What a lost robot does, see `RunRecorder.is_lost`: drive on by dead reckoning, or do so with at
most half the reference's speed, or stop until there is a valid pose again.
"""
# largest speed of a lost robot's tracks relative to the reference's [-]
_LOST_SPEED: Final = {"slow": 0.5, "stop": 0.0}
_ROUNDING: Final = 1e-9  # tolerance on the number of rows


@checks_arguments
@dataclass(frozen=True)
class Pilot:
    """The controller and slip compensation for R robots in a fleet."""

    controller: Controller
    robots: Sequence[int]
    compensation: Compensation = field(default_factory=FixedLaw)
    preview: float = 0.0
    """Look-ahead time of the controller, the delay between command and motion [s]."""
    when_lost: WhenLost = "drive"
    seeds: Sequence[int] | None = None
    """Seeds (R,) for a random controller; None for the numbers of the robots."""

    @cached_property
    def _loaded(self) -> SensesLoad | None:
        return self.compensation if isinstance(self.compensation, SensesLoad) else None

    @cached_property
    def _sensing(self) -> SensesSprockets | None:
        return self.controller if isinstance(self.controller, SensesSprockets) else None

    def name(self, record: RunRecorder) -> str:
        """Name of the run of the pilot's first robot."""
        return record.name(self.robots[0])

    def begin(self, record: RunRecorder) -> None:
        """Begin new runs at the robots' current poses; `record` is their recorder."""
        with self._failing(record, 0.0):
            begin_run(self.controller, self.robots if self.seeds is None else self.seeds)
        self.compensation.reset(record.fleet.pose()[self.robots])
        if self._loaded is not None:
            record.sense_loads()

    def require_able(self, reference: Reference) -> None:
        """Raise InvalidValueError if the reference turns on the spot, and its follower can't."""
        controller = self.controller
        name = type(controller).__name__
        require_turns(reference, "controller", name, controller, TURNING_CONTROLLERS)
        law = self.compensation.law()
        require_turns(reference, "compensation", type(law).__name__, law, TURNING_LAWS)

    def law(self, record: RunRecorder, k: int) -> SlipLaw:
        """Slip law for row k, after the compensation has observed the motion up to then."""
        if k > 0:
            omega = record.omega[k, self.robots]
            self.compensation.observe(omega, record.period, record.estimated(k, self.robots))
        if self._loaded is not None:
            self._loaded.sense(record.load[k, self.robots])
        law = self.compensation.law()
        record.compensated(k, self.robots, law)
        return law

    def twist(self, record: RunRecorder, k: int, law: SlipLaw, reference: Reference) -> Array:
        """Twists (R, 2) to drive from row k on, as the controller requests; raises RunFailedError
        if the controller fails.
        """
        now = float(record.time[k])
        pose: Array = record.pose[k, self.robots]
        omega = record.omega[k, self.robots]
        geometry = record.fleet.robot.geometry
        # the robots' direction of motion, and their poses when the command takes effect
        if self._loaded is not None:
            pose[:, 2] += self._loaded.crab_angle(law.twist(omega, geometry))
        if self.preview > 0:
            pose = advance(pose, law.twist(omega, geometry), self.preview)
        with self._failing(record, now):
            if self._sensing is not None:
                self._sensing.sense(omega)
            requested = self.controller.twist(now + self.preview, pose, reference)
            twist = np.asarray(requested, dtype=float)
        record.require_twists(k, self.robots, twist)
        if self.when_lost != "drive":
            twist = self._slowed(twist, record, k, reference)
        record.wanted(k, self.robots, twist)
        return twist

    def _slowed(self, twist: Array, record: RunRecorder, k: int, reference: Reference) -> Array:
        """Twists (R, 2) in row k, of which those of lost robots are scaled, so that their tracks
        are at most as fast as a share of what the reference takes.
        """
        half_gauge = record.fleet.robot.geometry.half_gauge
        desired = track_speeds(reference.twist(record.time[k]), half_gauge)
        allowed = _LOST_SPEED[self.when_lost] * np.abs(desired).max()
        fastest = np.abs(track_speeds(twist, half_gauge)).max(axis=-1)
        is_slowed = record.is_lost(k, self.robots) & (fastest > allowed)
        factor = np.where(is_slowed, allowed / np.where(is_slowed, fastest, 1.0), 1.0)
        return factor[:, None] * twist

    @contextmanager
    def _failing(self, record: RunRecorder, time: float) -> Iterator[None]:
        """Turn any exception that a user's controller raises into a RunFailedError."""
        try:
            yield
        except (Exception, SystemExit) as error:
            # without this frame and that of the call
            frames = traceback.extract_tb(error.__traceback__)[2:]
            where = ""
            if frames:
                where = f", {Path(frames[0].filename).name} line {frames[0].lineno}"
            run = self.name(record)
            cause = f"{type(error).__name__}: {error}"
            raise RunFailedError(
                f"run {run!r}: its controller fails at {time:g} s ({cause}){where}"
            ) from error


@checks_arguments
def open_loop(
    fleet: Fleet,
    omega: Array,
    duration: float,
    feed: ScannerFeed | None = None,
    locator: Locator | None = None,
    descriptions: Sequence[Description] | None = None,
    progress: Progress = lambda seconds: None,
    watch: Stopwatch | None = None,
    period: float = PERIOD,
) -> list[RunLog]:
    """Drive each robot at given sprocket speeds.

    Args:
        fleet: N robots.
        omega: sprocket speeds (N, 2) or (2,) [rad/s], or (T, N, 2) for T rows; if they exceed the
            top speed, both tracks are scaled by the same factor.
        duration: duration of each run [s].
        feed: scanner that observes the fleet; by default none.
        locator: finds poses in blocks of scans; by default the logs contain the true poses.
        descriptions: name and metadata of each run.
        progress: function that is called with the simulated time since its last call [s].
        watch: stopwatch for the stages "physics", "scans" and "localization".
        period: time between rows in a run without a scanner [s].

    Raises:
        RunFailedError: if a robot tips over; the error's `logs` contain the rows up to then.
        InvalidValueError: for arguments out of range.
    """
    watch = watch or Stopwatch()
    period = period if feed is None else feed.period
    rows = int(duration / period + _ROUNDING) + 1
    require(rows >= 2, "duration", duration, f"at least the time between two scans, {period:g} s")
    record = RunRecorder(fleet, rows, period, descriptions)
    localization = PoseEstimation(record, TruePose(fleet))
    if feed is not None and locator is not None:
        localization = ScanBlocks(record, ScannedPose(fleet, feed, locator), locator, watch)
    speeds = np.broadcast_to(np.asarray(omega, float), (rows, fleet.size, 2))
    return _drive(record, localization, lambda k: speeds[k], progress, watch)


@checks_arguments
def closed_loop(
    fleet: Fleet,
    pilots: Controller | Sequence[Pilot],
    reference: Reference,
    feed: ScannerFeed | None = None,
    locator: Locator | None = None,
    descriptions: Sequence[Description] | None = None,
    progress: Progress = lambda seconds: None,
    watch: Stopwatch | None = None,
    delay: Delay = 0.0,
) -> list[RunLog]:
    """Let controllers follow `reference` to its end; each scan leads to one command, limited as in
    `open_loop`.

    Args:
        fleet: N robots.
        pilots: pilots that together control all robots, or one controller for all robots without
            slip compensation.
        reference: the trajectory to follow.
        feed: scanner that observes the fleet; by default none, with a command every PERIOD.
        locator: finds poses in scans; by default controllers get the true poses.
        descriptions: see `open_loop`.
        progress: see `open_loop`.
        watch: stopwatch for the control steps of each pilot of a single robot, by the name of the
            robot's run. A step is everything between pose and set points: compensation, controller,
            and the conversion by the slip law.
        delay: time from each scan until its command takes effect, rounded to servo periods.

    Raises:
        InvalidValueError: for a negative delay, unless every robot has exactly one pilot, and for a
            reference that turns on the spot if a controller or its law can't.
        RunFailedError: if a robot tips over or a controller fails; the error's `logs` contain the
            rows up to then.
    """
    if not isinstance(pilots, Sequence):
        pilots = [Pilot(pilots, range(fleet.size))]
    steered = [list(pilot.robots) for pilot in pilots]
    valid = sorted(itertools.chain(*steered)) == list(range(fleet.size))
    require(valid, "pilots", steered, f"each robot 0..{fleet.size - 1} once")
    is_measured = delay == MEASURED
    valid = is_measured or (not isinstance(delay, str) and 0 <= delay < math.inf)
    require(valid, "delay", delay, 'a finite number of seconds >= 0, or "measured"')
    watch = watch or Stopwatch()
    period = PERIOD if feed is None else feed.period
    # the last is at the reference's end or just after
    rows = math.ceil(reference.duration / period - _ROUNDING) + 1
    record = RunRecorder(fleet, rows, period, descriptions)
    for pilot in pilots:
        pilot.begin(record)
        pilot.require_able(reference)
        if len(pilot.robots) == 1:
            watch.steps[pilot.name(record)] = []
    localization = PoseEstimation(record, TruePose(fleet))
    if feed is not None and locator is not None:
        compensations = [(pilot.robots, pilot.compensation) for pilot in pilots]
        source = ScannedPose(fleet, feed, locator, compensations)
        localization = PoseEstimation(record, source)
    omega = np.zeros((fleet.size, 2))
    delays = np.full(fleet.size, 0.0 if is_measured else delay)

    def steer(k: int) -> Array:
        for pilot in pilots:
            began = time.perf_counter()
            law = pilot.law(record, k)
            twist = pilot.twist(record, k, law, reference)
            omega[pilot.robots] = law.sprocket_speeds(twist, fleet.robot.geometry)
            taken = time.perf_counter() - began
            if len(pilot.robots) == 1:
                watch.steps[pilot.name(record)].append(taken)
            if is_measured:
                delays[pilot.robots] = taken
        return omega

    return _drive(record, localization, steer, progress, watch, delays)


def _drive(
    record: RunRecorder,
    localization: PoseEstimation,
    steer: Callable[[int], Array],
    progress: Progress,
    watch: Stopwatch,
    delays: Array | float = 0.0,
) -> list[RunLog]:
    """Drive, scan, localize, steer and record each row; `steer` returns a row's sprocket speeds (N,
    2) [rad/s], which take effect after `delays`, a scalar or (N,) [s].
    """
    fleet = record.fleet
    commands = DelayedCommands(fleet)
    try:
        for k in range(len(record.time)):
            with watch.stage("physics"):
                if k > 0:
                    commands.advance(record.period)
                    progress(record.period)
                record.measure(k)
            localization.estimate(k)
            omega = limit_sprocket_speeds(steer(k), fleet.drive.limit)
            commands.send(omega, delays)
            record.command(k, omega)
    except RunFailedError as error:
        error.logs = localization.logs(str(error))
        raise
    return localization.logs()
