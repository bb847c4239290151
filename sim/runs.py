"""Open- and closed-loop runs of a fleet -> RunLogs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from sim.fleet import Fleet
from sim.run_recorder import Description, RunFailedError, RunRecorder
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.steering import Pilot, Steering
from sim.stopwatch import Stopwatch
from trackslip.controllers.base import Controller
from trackslip.errors import require
from trackslip.kinematics import Array, limit_sprocket_speeds
from trackslip.localization.base import Locator
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.recorded import EVERY, Follower
from trackslip.localization.scan import Cluster, extract_plate
from trackslip.logs.runlog import RunLog
from trackslip.trajectory.base import Reference

Progress = Callable[[float], None]
"""Called with the seconds simulated since the last call."""

PERIOD = LaserScanner().period
"""Time between the rows of a run without a scanner [s]."""
_SCANS_AT_ONCE, _MOST_AT_ONCE = 5000, 400  # scans localized together offline: of all robots, and of each
_FEWEST_ROWS, _MOST_ROWS = 32, 300  # of each robot in a part: making logs of fewer rows would take long
_IN_MEMORY = 32_768  # rows of all robots together in a part, if that leaves each neither few nor many


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

    The logs of long runs of many robots need much memory: `open_loop_parts` gives them piece by piece.

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
    everything = _rows(duration, PERIOD if feed is None else feed.period)
    return next(open_loop_parts(fleet, omega, duration, feed, locator, descriptions, progress, watch, everything))


def open_loop_parts(
    fleet: Fleet,
    omega: Array,
    duration: float,
    feed: ScannerFeed | None = None,
    locator: Locator | None = None,
    descriptions: Sequence[Description] | None = None,
    progress: Progress = lambda seconds: None,
    watch: Stopwatch | None = None,
    rows_at_once: int | None = None,
) -> Iterator[list[RunLog]]:
    """Drive as `open_loop` does, and give the same runs in parts: logs of the rows after those of the part before.

    A part is forgotten once the next one is asked for, so that memory doesn't grow with the duration. Arguments and
    errors are those of `open_loop`; the logs of a RunFailedError contain what was recorded since the part before.

    Args:
        fleet, omega, duration, feed, locator, descriptions, progress, watch: see `open_loop`.
        rows_at_once: about as many rows are in a part; by default as many as suit the number of robots.
    """
    watch = watch or Stopwatch()
    period = PERIOD if feed is None else feed.period
    omega = limit_sprocket_speeds(np.broadcast_to(np.asarray(omega, float), (fleet.size, 2)), fleet.drive.limit)
    rows = _rows(duration, period)
    least = max(2, rows_at_once or min(max(_FEWEST_ROWS, _IN_MEMORY // fleet.size), _MOST_ROWS))
    scanned = feed is not None and locator is not None
    most = least + (_block(fleet.size) + EVERY if scanned else 1)
    record = RunRecorder(fleet, min(rows, most), period, descriptions)
    scans = None if feed is None or locator is None else _Scans(fleet, record, feed, locator, watch)

    def logs(failure: str | None = None) -> list[RunLog]:
        return record.logs(failure=failure) if scans is None else scans.logs(failure)

    try:
        for left in reversed(range(rows)):
            k = record.complete
            with watch.stage("physics"):
                if left < rows - 1:
                    fleet.advance(period)
                    progress(period)
                record.measure(k)
            if scans is None:
                record.estimate_exactly(k)
            else:
                scans.take()
            fleet.command(omega)
            record.command(k)
            # a log has two rows or more
            if record.complete >= least and left >= 2 and (scans is None or scans.located):
                yield logs()
                record.go_on()
                if scans is not None:
                    scans.go_on()
    except RunFailedError as error:
        error.logs = logs(str(error))
        raise
    yield logs()


def _rows(duration: float, period: float) -> int:
    """Rows of a run of some duration [s]; raises InvalidValueError for less than two."""
    rows = int(duration / period + 1e-9) + 1
    require(rows >= 2, "duration", duration, f"at least the time between two scans, {period:g} s")
    return rows


def _block(robots: int) -> int:
    """Number of scans of each robot that are localized together."""
    return min(max(1, _SCANS_AT_ONCE // robots), _MOST_AT_ONCE)


class _Scans:
    """The scans of an open-loop run, localized in blocks: nobody needs the poses before the run is over."""

    def __init__(
        self, fleet: Fleet, record: RunRecorder, feed: ScannerFeed, locator: Locator, watch: Stopwatch
    ) -> None:
        self._fleet, self._record, self._feed, self._watch = fleet, record, feed, watch
        self._follower = Follower(locator, Tracker(fleet.pose(), fleet.robot.geometry))
        self._block = _block(fleet.size)
        # true ranges of the scans that wait to be localized: the first `_waiting` rows
        self._true = np.empty((self._block + EVERY, fleet.size, len(feed.bearings)))
        self._waiting = 0
        self._located = 0  # rows of the record
        self._taken = 0  # scans of each robot
        self._begun = False
        self._clusters: list[Cluster] = []

    @property
    def located(self) -> bool:
        """Whether no scan waits to be localized."""
        return not self._waiting

    def go_on(self) -> None:
        """Forget the scans, as the record does its rows."""
        self._located = 0
        self._clusters.clear()

    def take(self) -> None:
        """Scan the robots where they are."""
        with self._watch.stage("scans"):
            self._feed.true_ranges(self._true[self._waiting])
        self._waiting += 1
        if self._waiting >= self._block and self._taken % EVERY == 0:
            self._locate()
        self._taken += 1

    def logs(self, failure: str | None) -> list[RunLog]:
        """See `RunRecorder.logs`."""
        if self._waiting:
            self._locate()
        with self._watch.stage("localization"):
            plates = _by_robot(self._clusters, self._fleet.size) if self._clusters else None
            return self._record.logs(self._feed, plates, failure)

    def _locate(self) -> None:
        """Measure and localize the scans that are waiting."""
        feed, record, first = self._feed, self._record, self._located
        with self._watch.stage("scans"):
            ranges = feed.measured(self._true[: self._waiting].swapaxes(0, 1))  # (N, block, B)
            if feed.kept:
                record.scanned(ranges)
        self._waiting = 0
        self._located += ranges.shape[1]
        with self._watch.stage("localization"):
            rows = slice(first, self._located)
            angle = record.omega[rows].swapaxes(0, 1) * feed.period
            if not self._begun:
                angle[:, 0] = 0.0  # the tracker starts from the pose of the first scan
                self._begun = True
            record.estimates(rows, self._follower.follow(feed.scan(ranges), angle))
            scan, pose = feed.scan(_flat(ranges)), _flat(record.pose[rows].swapaxes(0, 1))
            self._clusters.append(extract_plate(scan, self._fleet.robot.plate, scan.from_world(pose)))


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
    tracker = Tracker(fleet.pose(), fleet.robot.geometry)
    steering = Steering(pilots, fleet.pose(), record, reference, fleet.robot.geometry)

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
                ranges = feed.measured(feed.true_ranges()[:, None, :])
                if feed.kept:
                    record.scanned(ranges)
                record.estimate(k, tracker.update(locator.locate(feed.scan(ranges[:, 0]), predicted)))
            fleet.command(limit_sprocket_speeds(steering.omega(k, period), fleet.drive.limit))
            record.command(k)
    except RunFailedError as error:
        error.logs = logs(str(error))
        raise
    return logs()


def _flat(array: np.ndarray) -> np.ndarray:
    """Merge the axes of robots and rows, (N, T, ...), into one."""
    return array.reshape(-1, *array.shape[2:])


def _by_robot(clusters: Sequence[Cluster], robots: int) -> list[Cluster]:
    """The clusters of each robot in order of time, from blocks of scans (N, T) that follow one another."""
    parts = [(block, len(block.count) // robots) for block in clusters]
    return [Cluster.joined([block.between(k * rows, (k + 1) * rows) for block, rows in parts]) for k in range(robots)]
