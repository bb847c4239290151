"""Localization of the robots in a run: by true poses, scan by scan, or in blocks of scans."""

from __future__ import annotations

import numpy as np

from sim.fleet import Fleet
from sim.run_recorder import RunRecorder
from sim.scanner.feed import ScannerFeed
from sim.stopwatch import Stopwatch
from trackslip.kinematics import Array
from trackslip.localization.base import Locator, PoseEstimate
from trackslip.localization.follower import EVERY, Follower
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import Cluster, extract_plate
from trackslip.logs.runlog import RunLog

_AT_ONCE, _MOST_AT_ONCE = 2500, 400  # scans in a block: of all robots, and of each


class Localization:
    """True poses in every row of a record."""

    def __init__(self, fleet: Fleet, record: RunRecorder) -> None:
        self._fleet, self._record = fleet, record

    def estimate(self, k: int) -> None:
        """Estimate the poses in row k."""
        n = self._fleet.size
        self._record.estimate(k, PoseEstimate(self._fleet.pose(), np.zeros((n, 3, 3)), np.ones(n, bool)))

    def logs(self, failure: str | None = None) -> list[RunLog]:
        """A log per run of the complete rows; `failure` says why the runs stopped early."""
        return self._record.logs(failure=failure)


class ScanByScan(Localization):
    """Localization of each scan as it is taken, near the pose predicted by the encoders, for closed loops."""

    def __init__(self, fleet: Fleet, record: RunRecorder, feed: ScannerFeed, locator: Locator) -> None:
        super().__init__(fleet, record)
        self._feed, self._locator = feed, locator
        self._tracker = Tracker(fleet.pose(), fleet.robot.geometry)

    def estimate(self, k: int) -> None:
        """See Localization."""
        record, ranges = self._record, self._scan()
        predicted = self._tracker.predict(record.omega[k], record.period if k > 0 else 0.0)
        record.estimate(k, self._tracker.update(self._locator.locate(self._feed.scan(ranges), predicted)))

    def logs(self, failure: str | None = None) -> list[RunLog]:
        """See Localization; includes the plate's part of the scans if all ranges are kept."""
        record, feed, plate = self._record, self._feed, self._fleet.robot.plate
        if not feed.kept or not record.complete:
            return super().logs(failure)
        plates = []
        for robot in range(self._fleet.size):  # the part of its scans that belongs to its plate, at the estimated poses
            scan = feed.scan(record.full_ranges(robot).astype(float))
            plates.append(extract_plate(scan, plate, scan.from_world(record.pose[: record.complete, robot])))
        return record.logs(feed, plates, failure)

    def _scan(self) -> Array:
        """Take the next scan of each robot; returns ranges (N, B) [m], and records them if they are kept."""
        ranges = self._feed.measure(self._feed.true_ranges()[:, None, :])
        if self._feed.kept:
            self._record.scanned(ranges)
        return ranges[:, 0]


class ScanBlocks(ScanByScan):
    """Localization of scans in blocks, which is faster, for open loops."""

    def __init__(
        self, fleet: Fleet, record: RunRecorder, feed: ScannerFeed, locator: Locator, watch: Stopwatch
    ) -> None:
        """`watch` gets the times of the stages "scans" and "localization"."""
        super().__init__(fleet, record, feed, locator)
        self._watch, self._follower = watch, Follower(locator, self._tracker)
        self._block = min(max(1, _AT_ONCE // fleet.size), _MOST_AT_ONCE)
        self._ranges = np.empty((fleet.size, self._block + EVERY, len(feed.bearings)))  # the first `_waiting` wait
        self._waiting = 0
        self._located = 0  # rows of the record
        self._clusters: list[list[Cluster]] = [[] for _ in range(fleet.size)]

    def estimate(self, k: int) -> None:
        """Take the scans of row k, and localize the pending ones once they fill a block."""
        with self._watch.stage("scans"):
            self._ranges[:, self._waiting] = self._scan()
        self._waiting += 1
        if self._waiting >= self._block and k % EVERY == 0:
            self._locate()

    def logs(self, failure: str | None = None) -> list[RunLog]:
        """See Localization; with the plate in the scans."""
        if self._waiting:
            self._locate()
        if not self._located:
            return super(ScanByScan, self).logs(failure)
        return self._record.logs(self._feed, [Cluster.joined(parts) for parts in self._clusters], failure)

    def _locate(self) -> None:
        """Localize the pending scans."""
        record, feed, n = self._record, self._feed, self._waiting
        rows, ranges = slice(self._located, self._located + n), self._ranges[:, :n]
        with self._watch.stage("localization"):
            angle = record.omega[rows].swapaxes(0, 1) * feed.period
            record.estimates(rows, self._follower.follow(feed.scan(ranges), angle))
            scan = feed.scan(ranges.reshape(-1, ranges.shape[-1]))
            pose = scan.from_world(record.pose[rows].swapaxes(0, 1).reshape(-1, 3))
            cluster = extract_plate(scan, self._fleet.robot.plate, pose)
            for k, parts in enumerate(self._clusters):
                parts.append(cluster.between(k * n, (k + 1) * n))
        self._located, self._waiting = rows.stop, 0
