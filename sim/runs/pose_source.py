"""Estimated poses of a fleet: the truth, noisy truth, or poses from the scanner, by row or by block
of scans.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim.fleet.fleet import Fleet
from sim.runs.run_recorder import RunRecorder
from sim.runs.stopwatch import Stopwatch
from sim.scanner.feed import ScannerFeed
from trackslip.kinematics import Array
from trackslip.localization.pose_estimate import Locator, PoseEstimate
from trackslip.localization.pose_tracker import EVERY, Follower, Tracker
from trackslip.localization.scan import Cluster, extract_plate
from trackslip.logs.runlog import RunLog, ScanLog
from trackslip.online.compensation import Compensation
from trackslip.online.law_tracker import LawTracker
from trackslip.restorable import Restorable

Index = NDArray[np.int_]

_SCANS_AT_ONCE: Final = 2500  # largest number of scans in a block, of all robots
_OWN_SCANS_AT_ONCE: Final = 400  # and of each robot


class TruePose(Restorable):
    """True poses of N robots; the base class of other pose sources."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._covariance = np.zeros((fleet.size, 3, 3))
        self._valid = np.ones(fleet.size, bool)

    def begin(self, rows: Index, seeds: Sequence[int], last: Index) -> None:
        """Begin runs of the robots `rows` (R,), with noise `seeds` (R,) and numbers `last` (R,) of
        their last rows.
        """

    def start(self, rows: Index) -> Array:
        """Estimated poses (R, 3) of the robots `rows` (R,) at the beginning of their runs."""
        return self._fleet.pose()[rows]

    def estimate(self, k: Index | int, omega: Array, true: Array, duration: float) -> PoseEstimate:
        """Estimated poses of N robots in rows `k` (N,), counted from the beginning of their runs.

        `omega` (N, 2) are mean sprocket speeds over the last `duration` [rad/s, s], `true` (N, 3)
        are true poses.
        """
        return PoseEstimate(true, self._covariance, self._valid)

    def scan_logs(self, pose: Array) -> list[ScanLog] | None:
        """Scans for the logs of N robots with poses (T, N, 3) estimated in T rows; None unless all
        scans were kept.
        """
        return None


class NoisyPose(TruePose):
    """True poses plus Gaussian noise, which is drawn at the beginning of each run."""

    STATE = ("_noise",)

    def __init__(self, fleet: Fleet, deviation: Sequence[float]) -> None:
        """Use standard deviations `deviation` (3,) for x, y and heading [m, m, rad]."""
        super().__init__(fleet)
        self._deviation = np.array(deviation)
        self._covariance[:] = np.diag(self._deviation**2)
        self._noise = np.zeros((fleet.size, 1, 3))

    def begin(self, rows: Index, seeds: Sequence[int], last: Index) -> None:
        """Draw the noise of new runs; see TruePose."""
        stored = self._noise.shape[1]
        missing = max(0, int(last.max()) + 1 - stored)
        self._noise = np.pad(self._noise, ((0, 0), (0, missing), (0, 0)))
        for row, seed, end in zip(rows, seeds, last, strict=True):
            drawn = np.random.default_rng(seed).standard_normal((end + 1, 3))
            self._noise[row, : end + 1] = drawn * self._deviation

    def start(self, rows: Index) -> Array:
        """Noisy start poses (R, 3); see TruePose."""
        return super().start(rows) + self._noise[rows, 0]

    def estimate(self, k: Index | int, omega: Array, true: Array, duration: float) -> PoseEstimate:
        """Noisy poses in rows `k`; see TruePose."""
        last = self._noise.shape[1] - 1
        noise = self._noise[np.arange(len(true)), np.minimum(k, last)]
        return super().estimate(k, omega, true + noise, duration)


class ScannedPose(TruePose):
    """Poses from the plates in scans of the laser range finder, tracked from the known start
    poses.
    """

    STATE = ("feed", "tracker")

    def __init__(
        self,
        fleet: Fleet,
        feed: ScannerFeed,
        locator: Locator,
        compensations: Sequence[tuple[Sequence[int], Compensation]] = (),
    ) -> None:
        """Track the robots of a fleet; `compensations`, of robots given by their indices, have the
        laws by which poses are predicted, by default without slip.
        """
        super().__init__(fleet)
        self.feed = feed
        self._locator = locator
        start = fleet.pose()
        geometry = fleet.robot.geometry
        self.tracker = Tracker(start, geometry)
        if compensations:
            self.tracker = LawTracker(start, geometry, compensations)
        self.scans: list[np.ndarray] = []  # ranges (N, B) in each scan, if all are kept [m]

    def begin(self, rows: Index, seeds: Sequence[int], last: Index) -> None:
        """Restart noise and tracker for new runs; see TruePose."""
        self.feed.restart(rows, [np.random.default_rng(seed) for seed in seeds])
        self.tracker.restart(rows, self.start(rows))

    def estimate(self, k: Index | int, omega: Array, true: Array, duration: float) -> PoseEstimate:
        """Tracked poses in rows `k`; see TruePose."""
        predicted = self.tracker.predict(omega, duration)
        scan = self.feed.scan(self.scan())
        return self.tracker.update(self._locator.locate(scan, predicted))

    def scan(self) -> Array:
        """Ranges (N, B) in the next scan [m]."""
        ranges = self.feed.measure(self.feed.true_ranges()[:, None])[:, 0]
        if self.feed.kept:
            self.scans.append(ranges.astype(np.float32))
        return ranges

    def scan_logs(self, pose: Array) -> list[ScanLog] | None:
        """All scans, with the parts that were recognised as the plate; see TruePose."""
        if not self.scans or not len(pose):
            return None
        clusters = []
        for robot, ranges in enumerate(self._full(len(pose))):
            scan = self.feed.scan(ranges.astype(float))
            seen_from = scan.from_world(pose[:, robot])
            clusters.append(extract_plate(scan, self._fleet.robot.plate, seen_from))
        return self.logged(clusters, len(pose))

    def logged(self, clusters: Sequence[Cluster], rows: int) -> list[ScanLog]:
        """Scans for the robots' logs: the parts recognised as plates, `clusters`, and all ranges if
        they were kept.
        """
        plate = self._fleet.robot.plate
        empty = self.feed.scan(np.empty((0, len(self.feed.bearings))))
        if not self.scans:
            return [ScanLog(empty, plate, cluster) for cluster in clusters]
        full = self._full(rows)
        return [ScanLog(empty, plate, *own) for own in zip(clusters, full, strict=True)]

    def _full(self, rows: int) -> list[np.ndarray]:
        """Ranges (rows, B) in the first `rows` scans of each robot."""
        return list(np.stack(self.scans[:rows], axis=1))


class PoseEstimation:
    """Pose estimation row by row, as closed loops need it."""

    def __init__(self, record: RunRecorder, source: TruePose) -> None:
        self._record = record
        self._source = source

    def estimate(self, k: int) -> None:
        """Estimate the poses in row k."""
        record = self._record
        duration = record.period if k > 0 else 0.0
        estimate = self._source.estimate(k, record.omega[k], record.fleet.pose(), duration)
        record.estimate(k, estimate)

    def logs(self, failure: str | None = None) -> list[RunLog]:
        """One log of complete rows per run; `failure` is the reason if the runs ended early."""
        pose = self._record.pose[: self._record.complete]
        return self._record.logs(self._source.scan_logs(pose), failure)


class ScanBlocks(PoseEstimation):
    """Pose estimation in blocks of scans, which is faster, for open loops."""

    def __init__(
        self, record: RunRecorder, source: ScannedPose, locator: Locator, watch: Stopwatch
    ) -> None:
        """Estimate poses with `locator`; `watch` measures the stages "scans" and "localization"."""
        super().__init__(record, source)
        self._scanned = source
        self._watch = watch
        self._follower = Follower(locator, source.tracker)
        size = record.fleet.size
        wanted = min(_SCANS_AT_ONCE // size, _OWN_SCANS_AT_ONCE)
        block = max(wanted // EVERY * EVERY, EVERY)  # a multiple of EVERY
        # ranges of which the first `_waiting` scans are valid
        self._ranges = np.empty((size, block, len(source.feed.bearings)))
        self._waiting = 0
        self._located = 0  # number of rows with estimated poses
        self._clusters: list[list[Cluster]] = [[] for _ in range(size)]

    def estimate(self, k: int) -> None:
        """Scan for row k; estimate poses once the waiting scans fill a block."""
        with self._watch.stage("scans"):
            self._ranges[:, self._waiting] = self._scanned.scan()
        self._waiting += 1
        if self._waiting == self._ranges.shape[1]:
            self._locate()

    def logs(self, failure: str | None = None) -> list[RunLog]:
        """One log per run, see PoseEstimation, with the parts of the scans that show the plate."""
        if self._waiting:
            self._locate()
        rows = self._record.complete
        if not rows:
            return []
        clusters = [Cluster.joined(parts) for parts in self._clusters]
        return self._record.logs(self._scanned.logged(clusters, rows), failure)

    def _locate(self) -> None:
        """Estimate the poses in the waiting scans, and find the plates in them."""
        with self._watch.stage("localization"):
            rows = slice(self._located, self._located + self._waiting)
            ranges = self._ranges[:, : self._waiting]
            self._follow(rows, ranges)
            self._extract(rows, ranges)
        self._located = rows.stop
        self._waiting = 0

    def _follow(self, rows: slice, ranges: Array) -> None:
        """Estimate poses in some rows (T) from ranges (N, T, B) [m]."""
        record = self._record
        feed = self._scanned.feed
        turned = record.omega[rows].swapaxes(0, 1) * feed.period
        followed = self._follower.follow(feed.scan(ranges), turned)
        by_row = PoseEstimate(
            pose=followed.pose.swapaxes(0, 1),
            covariance=followed.covariance.swapaxes(0, 1),
            valid=followed.valid.swapaxes(0, 1),
        )
        record.estimate(rows, by_row)

    def _extract(self, rows: slice, ranges: Array) -> None:
        """Find the plates in ranges (N, T, B) [m], near the poses estimated in the rows (T)."""
        record = self._record
        scan = self._scanned.feed.scan(ranges.reshape(-1, ranges.shape[-1]))
        pose = record.pose[rows].swapaxes(0, 1).reshape(-1, 3)
        cluster = extract_plate(scan, record.fleet.robot.plate, scan.from_world(pose))
        count = ranges.shape[1]
        for robot, parts in enumerate(self._clusters):
            first = robot * count
            parts.append(cluster.take(np.arange(first, first + count)))
