"""Scans of an open-loop run, localized in blocks: nobody needs the poses before, and many scans at once cost less."""

from __future__ import annotations

from collections.abc import Sequence

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


class ScanBlocks:
    """The scans of a fleet, one of each robot for each row of its record."""

    def __init__(
        self, fleet: Fleet, record: RunRecorder, feed: ScannerFeed, locator: Locator, watch: Stopwatch
    ) -> None:
        """Begin with the next scan; `record` gets the poses, and `watch` the time of the stage "localization"."""
        self._record, self._feed, self._watch = record, feed, watch
        self._plate = fleet.robot.plate
        self._follower = Follower(locator, Tracker(fleet.pose(), fleet.robot.geometry))
        self._block = min(max(1, _AT_ONCE // fleet.size), _MOST_AT_ONCE)
        self._ranges = np.empty((fleet.size, self._block + EVERY, len(feed.bearings)))  # the first `_waiting` wait
        self._waiting = 0
        self._located = 0  # rows of the record
        self._clusters: list[Cluster] = []

    def take(self, ranges: Array) -> None:
        """Take the next scan of each robot, (N, B) [m], that of the record's next row."""
        self._ranges[:, self._waiting] = ranges
        self._waiting += 1
        if self._waiting >= self._block and (self._located + self._waiting - 1) % EVERY == 0:
            self.locate()

    def locate(self) -> None:
        """Localize the scans that wait."""
        if not self._waiting:
            return
        record, feed = self._record, self._feed
        ranges = self._ranges[:, : self._waiting]
        rows = slice(self._located, self._located + self._waiting)
        with self._watch.stage("localization"):
            angle = record.omega[rows].swapaxes(0, 1) * feed.period
            record.estimates(rows, self._follower.follow(feed.scan(ranges), angle))
            scan, pose = feed.scan(_flat(ranges)), _flat(record.pose[rows].swapaxes(0, 1))
            self._clusters.append(extract_plate(scan, self._plate, scan.from_world(pose)))
        self._located, self._waiting = rows.stop, 0

    def plates(self) -> list[Cluster] | None:
        """The part of each robot's scans that was taken for its plate; None without scans."""
        return _by_robot(self._clusters, len(self._ranges)) if self._clusters else None


def _flat(array: np.ndarray) -> np.ndarray:
    """Merge the axes of robots and rows, (N, T, ...), into one."""
    return array.reshape(-1, *array.shape[2:])


def _by_robot(clusters: Sequence[Cluster], robots: int) -> list[Cluster]:
    """The clusters of each robot in order of time, from blocks of scans (N, T) that follow one another."""
    parts = [(block, len(block.count) // robots) for block in clusters]
    return [Cluster.joined([block.between(k * rows, (k + 1) * rows) for block, rows in parts]) for k in range(robots)]
