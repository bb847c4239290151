"""Open- and closed-loop runs of a fleet in front of the scanner -> RunLogs."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sim.fleet import Fleet
from sim.instruments import pad_forces
from sim.scanner.scanner import ScannerFeed
from sim.stopwatch import Stopwatch
from trackslip.controllers.base import Controller, SensesSprockets
from trackslip.errors import InvalidValueError, TrackslipError
from trackslip.kinematics import Array, RobotGeometry, advance, limit_sprocket_speeds
from trackslip.localization.base import Locator, PoseEstimate
from trackslip.localization.scan import Cluster, extract_plate
from trackslip.localization.tracker import Tracker
from trackslip.logs.runlog import RunLog, Truth
from trackslip.logs.scanlog import ScanLog
from trackslip.slip.base import SlipLaw
from trackslip.slip.compensation import Compensation, FixedLaw
from trackslip.slip.icr import ConstantIcr
from trackslip.trajectory.base import Reference

Progress = Callable[[float], None]
"""Called with the seconds simulated since the last call."""

_SCANS_AT_ONCE = 2000  # scans that are localised together, offline
_TIPPED = 0.5  # roll or pitch from which a robot lies on its side [rad]


@dataclass(frozen=True)
class Description:
    """What a run is called and what is to be remembered of it."""

    run: str
    metadata: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Pilot:
    """Who drives some robots of a fleet: a controller, and what turns its twist into sprocket speeds."""

    controller: Controller
    robots: Sequence[int]
    compensation: Compensation = field(default_factory=FixedLaw)
    preview: float = 0.0
    """How far ahead of now the controller is asked what to drive: as long as sprockets lag behind commands [s]."""


def scan_count(duration: float, period: float) -> int:
    """Scans in a run, the first at its start; raises InvalidValueError for a run without two."""
    count = int(duration / period + 1e-9) + 1
    if not count >= 2:
        raise InvalidValueError("duration", duration, f"at least the time between two scans, {period:g} s")
    return count


def open_loop(
    fleet: Fleet,
    omega: Array,
    duration: float,
    feed: ScannerFeed,
    locator: Locator,
    descriptions: Sequence[Description],
    progress: Progress = lambda seconds: None,
    watch: Stopwatch | None = None,
) -> list[RunLog]:
    """Drive constant sprocket speeds (N, 2) [rad/s] for `duration` [s]; the poses come from the scans, afterwards.

    Speeds beyond the top speed are scaled for both tracks alike, so that the curvature is kept. `watch` is told how
    much of the time is localization.

    Raises:
        TrackslipError: when a robot tips over.
    """
    watch = watch or Stopwatch()
    record = _Recorder(fleet, scan_count(duration, feed.period), feed.period, descriptions)
    tracker = Tracker(fleet.pose(), fleet.robot.geometry)
    block = max(1, _SCANS_AT_ONCE // fleet.size)
    waiting: list[Array] = []
    clusters: list[Cluster] = []
    for k in range(record.rows):
        with watch.stage("physics"):
            if k > 0:
                fleet.advance(feed.period)
                progress(feed.period)
            record.measure(k)
        with watch.stage("scans"):
            waiting.append(feed.true_ranges())
        if len(waiting) == block or k == record.rows - 1:
            with watch.stage("scans"):
                ranges = feed.measure(np.stack(waiting, axis=1)).ranges  # (N, block, B)
                record.scanned(ranges)
            with watch.stage("localization"):
                first = k + 1 - len(waiting)
                _localise(record, tracker, feed, locator, ranges, first)
                scan, pose = feed.scan(_flat(ranges)), _flat(record.pose[first : k + 1].swapaxes(0, 1))
                clusters.append(extract_plate(scan, fleet.robot.plate, scan.from_world(pose)))
            waiting.clear()
        fleet.command(limit_sprocket_speeds(omega, fleet.drive.limit))
        record.command[k] = fleet.drive.set_point
    with watch.stage("localization"):
        return record.with_scans(feed, _by_robot(clusters, fleet.size))


def _localise(
    record: _Recorder, tracker: Tracker, feed: ScannerFeed, locator: Locator, ranges: Array, first: int
) -> None:
    """Poses of the rows from `first` on, from their ranges (N, block, B): all at once, then put in track.

    Where the tracker doesn't believe what was found, something else was taken for the plate, and it is looked for where
    the robot is expected.
    """
    robots, rows, _ = ranges.shape
    single = locator.locate(feed.scan(_flat(ranges)))
    pose, covariance, valid = (
        part.reshape(robots, rows, *part.shape[1:]) for part in (single.pose, single.covariance, single.valid)
    )
    for k in range(rows):
        row = first + k
        predicted = tracker.predict(record.omega[row], feed.period if row > 0 else 0.0)
        estimate = PoseEstimate(pose[:, k], covariance[:, k], valid[:, k])
        doubted = np.flatnonzero(~tracker.believes(estimate))
        if doubted.size:
            again = locator.locate(feed.scan(ranges[doubted, k]), predicted[doubted])
            estimate.pose[doubted], estimate.covariance[doubted] = again.pose, again.covariance
            estimate.valid[doubted] = again.valid
        record.estimate(row, tracker.update(estimate))


def closed_loop(
    fleet: Fleet,
    pilots: Sequence[Pilot],
    reference: Reference,
    feed: ScannerFeed,
    locator: Locator | None,
    descriptions: Sequence[Description],
    progress: Progress = lambda seconds: None,
) -> list[RunLog]:
    """Let controllers follow `reference` to its end, a command per scan, from the pose that the scan gave.

    Without a `locator` the controllers are told the true pose. Commands beyond the top speed are scaled for both tracks
    alike, so that the curvature is kept.

    Raises:
        InvalidValueError: unless each robot has exactly one pilot.
        TrackslipError: when a robot tips over.
    """
    if sorted(i for pilot in pilots for i in pilot.robots) != list(range(fleet.size)):
        raise InvalidValueError("pilots", [list(p.robots) for p in pilots], f"each robot 0..{fleet.size - 1} once")
    geometry = fleet.robot.geometry
    rows = math.ceil(reference.duration / feed.period - 1e-9) + 1  # the last at the reference's end or just after
    record = _Recorder(fleet, rows, feed.period, descriptions)
    tracker = Tracker(fleet.pose(), geometry)
    for pilot in pilots:
        pilot.controller.reset()
        pilot.compensation.reset(fleet.pose()[pilot.robots])
    omega = np.zeros((fleet.size, 2))
    for k in range(record.rows):
        if k > 0:
            fleet.advance(feed.period)
            progress(feed.period)
        record.measure(k)
        if locator is None:
            record.estimate(k, _exactly(fleet.pose()))
        else:
            predicted = tracker.predict(record.omega[k], feed.period if k > 0 else 0.0)
            scan = feed.measure(feed.true_ranges()[:, None, :])
            record.scanned(scan.ranges)
            record.estimate(k, tracker.update(locator.locate(feed.scan(scan.ranges[:, 0]), predicted)))
        for pilot in pilots:
            omega[pilot.robots] = _steer(pilot, record, k, reference, geometry, feed.period)
        fleet.command(limit_sprocket_speeds(omega, fleet.drive.limit))
        record.command[k] = fleet.drive.set_point
    if locator is None or not fleet.robot.contact_sensors:
        return record.logs()
    return record.with_scans(feed, [_plate_of(record, feed, fleet, i) for i in range(fleet.size)])


def _plate_of(record: _Recorder, feed: ScannerFeed, fleet: Fleet, robot: int) -> Cluster:
    """What of a robot's scans belongs to its plate, where it was found to be."""
    scan = feed.scan(record.full_ranges(robot).astype(float))
    return extract_plate(scan, fleet.robot.plate, scan.from_world(record.pose[:, robot]))


def _steer(
    pilot: Pilot, record: _Recorder, k: int, reference: Reference, geometry: RobotGeometry, period: float
) -> Array:
    """Sprocket speeds (R, 2) [rad/s] that a pilot asks of its R robots at row k."""
    robots = pilot.robots
    pose: Array = record.pose[k, robots]
    omega = record.omega[k, robots]
    if k > 0:
        pilot.compensation.observe(omega, period, record.estimated(k, robots))
    law = pilot.compensation.law()
    if pilot.preview > 0:
        pose = advance(pose, law.twist(omega, geometry), pilot.preview)
    try:
        if isinstance(pilot.controller, SensesSprockets):
            pilot.controller.sense(omega)
        wanted = pilot.controller.twist(float(record.time[k]) + pilot.preview, pose.copy(), reference)
        twist = np.asarray(wanted, dtype=float)
    except TrackslipError:
        raise
    except Exception as error:  # whatever a user's controller does
        name, what = record.name(robots[0]), f"{type(error).__name__}: {error}"
        raise TrackslipError(
            f"run {name!r}: its controller fails at {record.time[k]:g} s ({what}){_line(error)}"
        ) from error
    record.steered(k, robots, twist, law)
    return law.sprocket_speeds(twist, geometry)


def _line(error: Exception) -> str:
    """Where in a controller's own code an error came up, or nothing if it never got there."""
    frames = traceback.extract_tb(error.__traceback__)[1:]  # without the call itself
    return f", {Path(frames[0].filename).name} line {frames[0].lineno}" if frames else ""


class _Recorder:
    """The rows of N runs as they are driven."""

    def __init__(self, fleet: Fleet, rows: int, period: float, descriptions: Sequence[Description]) -> None:
        n = fleet.size
        self._fleet, self._period, self._descriptions = fleet, period, descriptions
        self._angle = fleet.drive.encoder_angle()
        self.rows = rows
        self.time = np.arange(rows) * period
        self.command = np.zeros((rows, n, 2))
        self._twist_command = np.full((rows, n, 2), np.nan)
        self._icr = np.full((rows, n, 2), np.nan)
        self.omega = np.zeros((rows, n, 2))
        self.pose = np.zeros((rows, n, 3))
        self._covariance = np.zeros((rows, n, 3, 3))
        self._valid = np.zeros((rows, n), bool)
        self._true_pose = np.zeros((rows, n, 3))
        self._true_twist = np.zeros((rows, n, 3))
        self._lean = np.zeros((rows, n))
        self._traction = np.zeros((rows, n, 2))
        self._torque = np.zeros((rows, n, 2))
        self._energy = np.zeros((rows, n, 2))
        self._saturated_time = np.zeros((rows, n, 2))
        self._in_detail = fleet.robot.contact_sensors
        self._contact = np.zeros((rows if self._in_detail else 0, n, len(fleet.robot.pad_side), 3), np.float32)
        self._ranges: list[np.ndarray] = []  # (N, rows, B) each

    def measure(self, k: int) -> None:
        """Encoders and truth."""
        fleet = self._fleet
        angle = fleet.drive.encoder_angle()
        self.omega[k] = (angle - self._angle) / self._period
        self._angle = angle
        self._true_pose[k], self._true_twist[k] = fleet.pose(), fleet.twist()
        self._lean[k] = fleet.lean()
        self._traction[k], self._torque[k] = fleet.traction(), fleet.drive.torque
        self._energy[k], self._saturated_time[k] = fleet.drive.energy, fleet.drive.saturated_time
        if self._in_detail:
            self._contact[k] = pad_forces(fleet)
        for i in np.flatnonzero(~(np.abs(fleet.attitude()[:, 1:]) < _TIPPED).all(axis=1)):
            name = self._descriptions[int(i)].run
            raise TrackslipError(f"run {name!r}: the robot tips over after {self.time[k]:g} s")

    def estimate(self, k: int, estimate: PoseEstimate) -> None:
        self.pose[k], self._covariance[k], self._valid[k] = estimate.pose, estimate.covariance, estimate.valid

    def scanned(self, ranges: Array) -> None:
        """Keep the next whole scans (N, rows, B), where all is recorded."""
        if self._in_detail:
            self._ranges.append(ranges.astype(np.float32))

    def full_ranges(self, robot: int) -> Array:
        """The whole scans (T, B) of a robot."""
        return np.concatenate([block[robot] for block in self._ranges])

    def name(self, robot: int) -> str:
        """What a robot's run is called."""
        return self._descriptions[robot].run

    def estimated(self, k: int, robots: Sequence[int]) -> PoseEstimate:
        """What was estimated of some robots."""
        return PoseEstimate(self.pose[k, robots], self._covariance[k, robots], self._valid[k, robots])

    def steered(self, k: int, robots: Sequence[int], twist: Array, law: SlipLaw) -> None:
        """A controller's twists (R, 2) for R robots, and the law they are turned into sprocket speeds with.

        Raises:
            TrackslipError: for twists of another shape, and for one that isn't finite.
        """
        if twist.shape != (len(robots), 2):
            raise TrackslipError(
                f"run {self.name(robots[0])!r}: its controller's twists have the shape {twist.shape}: must be "
                f"{(len(robots), 2)}, for as many poses"
            )
        for i in np.flatnonzero(~np.isfinite(twist).all(axis=1)):
            name = self.name(robots[int(i)])
            raise TrackslipError(
                f"run {name!r}: its controller asks for the twist {tuple(twist[i].tolist())} at {self.time[k]:g} s"
            )
        self._twist_command[k, robots] = twist
        if isinstance(law, ConstantIcr):
            self._icr[k, robots] = np.stack(np.broadcast_arrays(law.offset, law.radius_error), axis=-1)

    def with_scans(self, feed: ScannerFeed, plates: Sequence[Cluster]) -> list[RunLog]:
        """The logs, with what of each robot's scans was taken for its plate."""
        empty, plate = feed.scan(np.empty((0, len(feed.bearings)))), self._fleet.robot.plate
        full = [self.full_ranges(i) if self._in_detail else None for i in range(len(plates))]
        seen = [ScanLog(empty, plate, cluster, ranges) for cluster, ranges in zip(plates, full, strict=True)]
        return [replace(log, scans=scans) for log, scans in zip(self.logs(), seen, strict=True)]

    def logs(self) -> list[RunLog]:
        return [
            RunLog(
                run=d.run,
                time=self.time,
                omega=self.omega[:, i],
                pose=self.pose[:, i],
                command=self.command[:, i],
                twist_command=None if np.isnan(self._twist_command[:, i]).any() else self._twist_command[:, i],
                icr=None if np.isnan(self._icr[:, i]).any() else self._icr[:, i],
                covariance=self._covariance[:, i],
                valid=self._valid[:, i],
                truth=Truth(
                    self._true_pose[:, i],
                    self._true_twist[:, i],
                    self._traction[:, i],
                    self._torque[:, i],
                    self._rate(self._energy[:, i]),
                    self._rate(self._saturated_time[:, i]),
                    self._lean[:, i],
                    self._contact[:, i] if self._in_detail else None,
                ),
                metadata=dict(d.metadata),
            )
            for i, d in enumerate(self._descriptions)
        ]

    def _rate(self, total: Array) -> Array:
        """Mean rates (T, 2) since the row before, of what has added up to (T, 2)."""
        return np.diff(total, axis=0, prepend=total[:1]) / self._period


def _exactly(pose: Array) -> PoseEstimate:
    return PoseEstimate(pose, np.zeros((len(pose), 3, 3)), np.ones(len(pose), bool))


def _flat(array: np.ndarray) -> np.ndarray:
    """Robots x rows x ... as one axis of both."""
    return array.reshape(-1, *array.shape[2:])


def _by_robot(clusters: Sequence[Cluster], robots: int) -> list[Cluster]:
    """Clusters of blocks of scans (robots x scans), one after another for each robot."""
    whole = Cluster.joined(clusters)
    owner = np.concatenate([np.repeat(np.arange(robots), len(block.count) // robots) for block in clusters])
    return [whole.take(np.flatnonzero(owner == k)) for k in range(robots)]
