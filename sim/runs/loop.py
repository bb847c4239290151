"""Open- and closed-loop runs of a fleet with RunLogs as results, and the pilots that steer the
fleet.
"""

from __future__ import annotations

import itertools
import math
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from sim.fleet.fleet import Fleet
from sim.runs.pose_source import PoseEstimation, ScanBlocks, ScannedPose, TruePose
from sim.runs.run_recorder import Description, RunRecorder
from sim.runs.stopwatch import Stopwatch
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from trackslip.arguments import checks_arguments
from trackslip.controllers.base import Controller, SensesSprockets, reset_arguments
from trackslip.controllers.named import TURNING_CONTROLLERS
from trackslip.errors import RunFailedError, require
from trackslip.kinematics import Array, advance, limit_sprocket_speeds
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
    seeds: Sequence[int] | None = None
    """Seeds (R,) for a random controller; None for the numbers of the robots."""

    @cached_property
    def _loaded(self) -> SensesLoad | None:
        return self.compensation if isinstance(self.compensation, SensesLoad) else None

    @cached_property
    def _sensing(self) -> SensesSprockets | None:
        return self.controller if isinstance(self.controller, SensesSprockets) else None

    def begin(self, record: RunRecorder) -> None:
        """Begin new runs at the robots' current poses; `record` is their recorder."""
        with self._failing(record, 0.0):
            seeds = self.robots if self.seeds is None else self.seeds
            self.controller.reset(**reset_arguments(self.controller, seeds))
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
        """Twists (R, 2) that the controller requests in row k; raises RunFailedError if the
        controller fails.
        """
        time = float(record.time[k])
        pose: Array = record.pose[k, self.robots]
        omega = record.omega[k, self.robots]
        geometry = record.fleet.robot.geometry
        # the robots' direction of motion, and their poses when the command takes effect
        if self._loaded is not None:
            pose[:, 2] += self._loaded.crab_angle(law.twist(omega, geometry))
        if self.preview > 0:
            pose = advance(pose, law.twist(omega, geometry), self.preview)
        with self._failing(record, time):
            if self._sensing is not None:
                self._sensing.sense(omega)
            requested = self.controller.twist(time + self.preview, pose, reference)
            twist = np.asarray(requested, dtype=float)
        record.wanted(k, self.robots, twist)
        return twist

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
            run = record.name(self.robots[0])
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

    Raises:
        InvalidValueError: unless every robot has exactly one pilot, and for a reference that turns
            on the spot if a controller or its law can't.
        RunFailedError: if a robot tips over or a controller fails; the error's `logs` contain the
            rows up to then.
    """
    if not isinstance(pilots, Sequence):
        pilots = [Pilot(pilots, range(fleet.size))]
    steered = [list(pilot.robots) for pilot in pilots]
    valid = sorted(itertools.chain(*steered)) == list(range(fleet.size))
    require(valid, "pilots", steered, f"each robot 0..{fleet.size - 1} once")
    period = PERIOD if feed is None else feed.period
    # the last is at the reference's end or just after
    rows = math.ceil(reference.duration / period - _ROUNDING) + 1
    record = RunRecorder(fleet, rows, period, descriptions)
    for pilot in pilots:
        pilot.begin(record)
        pilot.require_able(reference)
    localization = PoseEstimation(record, TruePose(fleet))
    if feed is not None and locator is not None:
        compensations = [(pilot.robots, pilot.compensation) for pilot in pilots]
        source = ScannedPose(fleet, feed, locator, compensations)
        localization = PoseEstimation(record, source)
    omega = np.zeros((fleet.size, 2))

    def steer(k: int) -> Array:
        for pilot in pilots:
            law = pilot.law(record, k)
            twist = pilot.twist(record, k, law, reference)
            omega[pilot.robots] = law.sprocket_speeds(twist, fleet.robot.geometry)
        return omega

    return _drive(record, localization, steer, progress)


def _drive(
    record: RunRecorder,
    localization: PoseEstimation,
    steer: Callable[[int], Array],
    progress: Progress,
    watch: Stopwatch | None = None,
) -> list[RunLog]:
    """Drive, scan, localize, steer and record each row; `steer` returns a row's sprocket speeds (N,
    2) [rad/s].
    """
    fleet = record.fleet
    watch = watch or Stopwatch()
    try:
        for k in range(len(record.time)):
            with watch.stage("physics"):
                if k > 0:
                    fleet.advance(record.period)
                    progress(record.period)
                record.measure(k)
            localization.estimate(k)
            fleet.command(limit_sprocket_speeds(steer(k), fleet.drive.limit))
            record.command(k)
    except RunFailedError as error:
        error.logs = localization.logs(str(error))
        raise
    return localization.logs()
