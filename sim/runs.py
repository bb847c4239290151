"""Open- and closed-loop runs of a fleet -> RunLogs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from sim.fleet import Fleet
from sim.run_recorder import Description, RunRecorder
from sim.scan_blocks import ScanBlocks
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.steering import Pilot, Steering
from sim.stopwatch import Stopwatch
from trackslip.controllers.base import Controller
from trackslip.errors import RunFailedError, require
from trackslip.kinematics import Array, limit_sprocket_speeds
from trackslip.localization.base import Locator
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import extract_plate
from trackslip.logs.runlog import RunLog
from trackslip.trajectory.base import Reference

Progress = Callable[[float], None]
"""Called with the seconds simulated since the last call."""

PERIOD = LaserScanner().period
"""Time between the rows of a run without a scanner [s]."""


def open_loop(
    fleet: Fleet,
    omega: Array,
    duration: float,
    feed: ScannerFeed | None = None,
    locator: Locator | None = None,
    descriptions: Sequence[Description] | None = None,
    progress: Progress = lambda seconds: None,
    watch: Stopwatch | None = None,
) -> list[RunLog]:
    """Drive every robot at constant sprocket speeds.

    Args:
        fleet: N robots.
        omega: sprocket speeds (N, 2) or (2,) [rad/s]; above the top speed, both tracks are scaled by the same factor.
        duration: of each run [s].
        feed: the scanner in front of the fleet; by default there is none, and a row is recorded every PERIOD.
        locator: finds the poses in the scans, after the run; by default the log contains the true poses.
        descriptions: name and metadata of each run.
        progress: see Progress.
        watch: measures the time spent in the stages "physics", "scans" and "localization".

    Raises:
        RunFailedError: when a robot tips over; its `logs` contain what was recorded until then.
        InvalidValueError: for arguments out of range.
    """
    watch = watch or Stopwatch()
    period = PERIOD if feed is None else feed.period
    omega = limit_sprocket_speeds(np.broadcast_to(np.asarray(omega, float), (fleet.size, 2)), fleet.drive.limit)
    record = RunRecorder(fleet, _rows(duration, period), period, descriptions)
    scans = None
    if feed is not None and locator is not None:
        scans = ScanBlocks(fleet, record, feed, locator, watch)

    def logs(failure: str | None = None) -> list[RunLog]:
        if scans is None:
            return record.logs(failure=failure)
        scans.locate()
        return record.logs(feed, scans.plates(), failure)

    try:
        for k in range(len(record.time)):
            with watch.stage("physics"):
                if k > 0:
                    fleet.advance(period)
                    progress(period)
                record.measure(k)
            if feed is None or scans is None:
                record.estimate_exactly(k)
            else:
                with watch.stage("scans"):
                    ranges = _next_scans(feed, record)
                scans.take(ranges)
            fleet.command(omega)
            record.command(k)
    except RunFailedError as error:
        error.logs = logs(str(error))
        raise
    return logs()


def _rows(duration: float, period: float) -> int:
    """Rows of a run of some duration [s]; raises InvalidValueError for less than two."""
    rows = int(duration / period + 1e-9) + 1
    require(rows >= 2, "duration", duration, f"at least the time between two scans, {period:g} s")
    return rows


def closed_loop(
    fleet: Fleet,
    pilots: Controller | Sequence[Pilot],
    reference: Reference,
    feed: ScannerFeed | None = None,
    locator: Locator | None = None,
    descriptions: Sequence[Description] | None = None,
    progress: Progress = lambda seconds: None,
) -> list[RunLog]:
    """Let controllers follow `reference` to its end, with one command per scan, limited as in `open_loop`.

    Args:
        fleet: N robots.
        pilots: together they control every robot; or one controller of all robots, without slip compensation.
        reference: the trajectory to follow.
        feed: the scanner in front of the fleet; by default there is none, and a command is given every PERIOD.
        locator: finds the poses in the scans; by default the controllers are given the true poses.
        descriptions, progress: see `open_loop`.

    Raises:
        InvalidValueError: unless every robot has exactly one pilot.
        RunFailedError: when a robot tips over or a controller fails; its `logs` contain what was recorded until then.
    """
    if not isinstance(pilots, Sequence):
        pilots = [Pilot(pilots, range(fleet.size))]
    valid = sorted(i for pilot in pilots for i in pilot.robots) == list(range(fleet.size))
    require(valid, "pilots", [list(pilot.robots) for pilot in pilots], f"each robot 0..{fleet.size - 1} once")
    period = PERIOD if feed is None else feed.period
    rows = math.ceil(reference.duration / period - 1e-9) + 1  # the last at the reference's end or just after
    record = RunRecorder(fleet, rows, period, descriptions)
    steering = Steering(pilots, fleet.pose(), record, reference, fleet.robot.geometry)
    tracker = Tracker(fleet.pose(), fleet.robot.geometry)

    def logs(failure: str | None = None) -> list[RunLog]:
        if feed is None or locator is None or not feed.kept or not record.complete:
            return record.logs(failure=failure)
        plates = []
        for robot in range(fleet.size):  # the part of its scans that belongs to its plate, at the estimated poses
            scan = feed.scan(record.full_ranges(robot).astype(float))
            pose = scan.from_world(record.pose[: record.complete, robot])
            plates.append(extract_plate(scan, fleet.robot.plate, pose))
        return record.logs(feed, plates, failure)

    try:
        for k in range(rows):
            if k > 0:
                fleet.advance(period)
                progress(period)
            record.measure(k)
            if feed is None or locator is None:
                record.estimate_exactly(k)
            else:
                predicted = tracker.predict(record.omega[k], period if k > 0 else 0.0)
                found = locator.locate(feed.scan(_next_scans(feed, record)), predicted)
                record.estimate(k, tracker.update(found))
            fleet.command(limit_sprocket_speeds(steering.omega(k, period), fleet.drive.limit))
            record.command(k)
    except RunFailedError as error:
        error.logs = logs(str(error))
        raise
    return logs()


def _next_scans(feed: ScannerFeed, record: RunRecorder) -> Array:
    """The ranges (N, B) of the next scan of each robot [m], which are recorded if they are kept."""
    ranges = feed.measure(feed.true_ranges()[:, None, :])
    if feed.kept:
        record.scanned(ranges)
    return ranges[:, 0]


def drive_fleet(
    fleet: Fleet,
    omega: Array,
    rate: float,
    descriptions: Sequence[Description],
    progress: Progress = lambda seconds: None,
) -> list[RunLog]:
    """Drive N robots at set points `omega` (T, N, 2) [rad/s], each for a period of the encoders, 1 / `rate` [s].

    The logs have the true poses and, in each row, the sprocket speeds since the row before.

    Raises:
        RunFailedError: when a robot tips over; its `logs` contain what was recorded until then.
        InvalidValueError: unless the encoders' period is a multiple of the servo's.
    """
    record = RunRecorder(fleet, len(omega), 1 / rate, descriptions)
    try:
        for k, command in enumerate(omega):
            if k > 0:
                fleet.advance(1 / rate)
                progress(1 / rate)
            record.measure(k)
            record.estimate_exactly(k)
            fleet.command(command)
            record.command(k)
    except RunFailedError as error:
        error.logs = record.logs(failure=str(error))
        raise
    return record.logs()
