"""Estimated poses of a fleet: the truth, noisy truth, or poses from the scanner, by row or by block
of scans.
"""

from __future__ import annotations

from collections.abc import Sequence

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
from trackslip.restorable import Restorable

Index = NDArray[np.int_]

# largest number of scans in a block, of all robots and of each robot
_AT_ONCE, _MOST_AT_ONCE = 2500, 400


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
        longer = max(0, int(last.max()) + 1 - self._noise.shape[1])
        self._noise = np.pad(self._noise, ((0, 0), (0, longer), (0, 0)))
        for row, seed, end in zip(rows, seeds, last, strict=True):
            drawn = np.random.default_rng(seed).standard_normal((end + 1, 3))
            self._noise[row, : end + 1] = drawn * self._deviation

    def start(self, rows: Index) -> Array:
        """Noisy start poses (R, 3); see TruePose."""
        return super().start(rows) + self._noise[rows, 0]

    def estimate(self, k: Index | int, omega: Array, true: Array, duration: float) -> PoseEstimate:
        """Noisy poses in rows `k`; see TruePose."""
        noise = self._noise[np.arange(len(true)), np.minimum(k, self._noise.shape[1] - 1)]
        return super().estimate(k, omega, true + noise, duration)


class ScannedPose(TruePose):
    """Poses from the plates in scans of the laser range finder, tracked from the known start
    poses.
    """

    STATE = ("feed", "tracker")

    def __init__(self, fleet: Fleet, feed: ScannerFeed, locator: Locator) -> None:
        super().__init__(fleet)
        self.feed, self._locator = feed, locator
        self.tracker = Tracker(fleet.pose(), fleet.robot.geometry)
        self.scans: list[np.ndarray] = []  # ranges (N, B) in each scan, if all are kept [m]

    def begin(self, rows: Index, seeds: Sequence[int], last: Index) -> None:
        """Restart noise and tracker for new runs; see TruePose."""
        self.feed.restart(rows, [np.random.default_rng(seed) for seed in seeds])
        self.tracker.restart(rows, self.start(rows))

    def estimate(self, k: Index | int, omega: Array, true: Array, duration: float) -> PoseEstimate:
        """Tracked poses in rows `k`; see TruePose."""
        predicted = self.tracker.predict(omega, duration)
        return self.tracker.update(self._locator.locate(self.feed.scan(self.scan()), predicted))

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
        scans = [self.feed.scan(full.astype(float)) for full in self._full(len(pose))]
        plate = self._fleet.robot.plate
        clusters = [
            extract_plate(scan, plate, scan.from_world(pose[:, k])) for k, scan in enumerate(scans)
        ]
        return self.logged(clusters, len(pose))

    def logged(self, clusters: Sequence[Cluster], rows: int) -> list[ScanLog]:
        """Scans for the robots' logs: the parts recognised as plates, `clusters`, and all ranges if
        they were kept.
        """
        empty, plate = (
            self.feed.scan(np.empty((0, len(self.feed.bearings)))),
            self._fleet.robot.plate,
        )
        full = self._full(rows) if self.scans else [None] * len(clusters)
        return [ScanLog(empty, plate, *own) for own in zip(clusters, full, strict=True)]

    def _full(self, rows: int) -> list[np.ndarray]:
        """Ranges (rows, B) in the first `rows` scans of each robot."""
        return list(np.stack(self.scans[:rows], axis=1))


class PoseEstimation:
    """Pose estimation row by row, as closed loops need it."""

    def __init__(self, record: RunRecorder, source: TruePose) -> None:
        self._record, self._source = record, source

    def estimate(self, k: int) -> None:
        """Estimate the poses in row k."""
        record = self._record
        duration = record.period if k > 0 else 0.0
        record.estimate(k, self._source.estimate(k, record.omega[k], record.fleet.pose(), duration))

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
        self._watch, self._follower = watch, Follower(locator, source.tracker)
        size = record.fleet.size
        block = min(_AT_ONCE // size, _MOST_AT_ONCE) // EVERY * EVERY
        # `_waiting` are valid
        self._ranges = np.empty((size, max(block, EVERY), len(source.feed.bearings)))
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
        if not self._record.complete:
            return []
        clusters = [Cluster.joined(parts) for parts in self._clusters]
        return self._record.logs(self._scanned.logged(clusters, self._record.complete), failure)

    def _locate(self) -> None:
        record, feed, n = self._record, self._scanned.feed, self._waiting
        rows, ranges = slice(self._located, self._located + n), self._ranges[:, :n]
        with self._watch.stage("localization"):
            angle = record.omega[rows].swapaxes(0, 1) * feed.period
            followed = vars(self._follower.follow(feed.scan(ranges), angle)).values()
            record.estimate(rows, PoseEstimate(*(values.swapaxes(0, 1) for values in followed)))
            scan = feed.scan(ranges.reshape(-1, ranges.shape[-1]))
            pose = scan.from_world(record.pose[rows].swapaxes(0, 1).reshape(-1, 3))
            cluster = extract_plate(scan, record.fleet.robot.plate, pose)
            for k, parts in enumerate(self._clusters):
                parts.append(cluster.take(np.arange(k * n, (k + 1) * n)))
        self._located, self._waiting = rows.stop, 0
