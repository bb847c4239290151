"""Scans of robots whose poses nobody needs while they drive, localized in blocks: many scans at once cost less."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext

import numpy as np

from sim.fleet import Fleet
from sim.run_recorder import RunRecorder
from sim.scanner.feed import ScannerFeed
from sim.stopwatch import Stopwatch
from trackslip.kinematics import Array
from trackslip.localization.base import Locator
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.recorded import EVERY, Follower
from trackslip.localization.scan import Cluster, extract_plate

_AT_ONCE, _MOST_AT_ONCE = 2500, 400  # scans in a block: of all robots, and of each


class DeferredScans:
    """The scans of R robots of a fleet, one for each row of its record.

    A robot's poses don't depend on which robots are localized with it.
    """

    def __init__(
        self,
        fleet: Fleet,
        robots: np.ndarray,
        record: RunRecorder,
        feed: ScannerFeed,
        locator: Locator,
        watch: Stopwatch | None = None,
        with_plates: bool = False,
    ) -> None:
        """Begin with the next scan, at the robots' present poses.

        Args:
            fleet, robots: the fleet, and the indices (R,) of the robots.
            record: where the poses are put.
            feed: the scanner that makes the scans.
            locator: finds the poses.
            watch: measures the time spent in the stage "localization".
            with_plates: whether to keep the part of each scan that is its plate's.
        """
        self._robots, self._record, self._feed, self._watch = robots, record, feed, watch
        self._plate = fleet.robot.plate if with_plates else None
        self._follower = Follower(locator, Tracker(fleet.pose()[robots], fleet.robot.geometry))
        self._block = min(max(1, _AT_ONCE // len(robots)), _MOST_AT_ONCE)
        self._ranges = np.empty((len(robots), self._block + EVERY, len(feed.bearings)))  # the first `_waiting` wait
        self._waiting = 0
        self._located = 0  # rows of the record
        self._taken = 0  # scans of each robot
        self._begun = False
        self._clusters: list[Cluster] = []

    def take(self, ranges: Array) -> None:
        """Take the next scan of each robot, (R, B) [m], that of the record's next row."""
        self._ranges[:, self._waiting] = ranges
        self._waiting += 1
        if self._waiting >= self._block and self._taken % EVERY == 0:
            self.locate()
        self._taken += 1

    def locate(self) -> None:
        """Localize the scans that wait."""
        if not self._waiting:
            return
        record, feed = self._record, self._feed
        ranges = self._ranges[:, : self._waiting]
        rows = slice(self._located, self._located + self._waiting)
        with self._stage():
            angle = record.omega[rows, self._robots].swapaxes(0, 1) * feed.period
            if not self._begun:
                angle[:, 0] = 0.0  # the tracker starts from the pose of the first scan
                self._begun = True
            record.estimates(rows, self._robots, self._follower.follow(feed.scan(ranges), angle))
            if self._plate is not None:
                scan, pose = feed.scan(_flat(ranges)), _flat(record.pose[rows, self._robots].swapaxes(0, 1))
                self._clusters.append(extract_plate(scan, self._plate, scan.from_world(pose)))
        self._located, self._waiting = rows.stop, 0

    def plates(self) -> list[Cluster] | None:
        """The part of each robot's scans that was taken for its plate; None if that is not kept, and without scans."""
        return _by_robot(self._clusters, len(self._robots)) if self._clusters else None

    def _stage(self) -> AbstractContextManager[None]:
        return nullcontext() if self._watch is None else self._watch.stage("localization")


def _flat(array: np.ndarray) -> np.ndarray:
    """Merge the axes of robots and rows, (R, T, ...), into one."""
    return array.reshape(-1, *array.shape[2:])


def _by_robot(clusters: Sequence[Cluster], robots: int) -> list[Cluster]:
    """The clusters of each robot in order of time, from blocks of scans (R, T) that follow one another."""
    parts = [(block, len(block.count) // robots) for block in clusters]
    return [Cluster.joined([block.between(k * rows, (k + 1) * rows) for block, rows in parts]) for k in range(robots)]
