"""Sources of the estimated poses of a fleet: the truth, the truth with noise, or the scanner."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.fleet import Fleet
from sim.restorable import Restorable
from sim.scanner.feed import ScannerFeed
from trackslip.kinematics import Array
from trackslip.localization.base import Locator, PoseEstimate
from trackslip.localization.pose_tracker import Tracker

Index = NDArray[np.int_]


class TruePose(Restorable):
    """True poses of N robots; the base of the other sources."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._covariance = np.zeros((fleet.size, 3, 3))
        self._valid = np.ones(fleet.size, bool)

    def begin(self, rows: Index, seeds: Sequence[int], last: Index) -> None:
        """Begin new runs of the robots `rows` (R,), with noise seeds (R,) and lengths (R,) [rows]."""

    def start(self, rows: Index) -> Array:
        """Estimated poses (R, 3) of the robots `rows` (R,) at the start of their runs."""
        return self._fleet.pose()[rows]

    def estimate(self, k: Index | int, omega: Array, true: Array, duration: float) -> PoseEstimate:
        """Estimated poses of the N robots in the rows `k` (N,) since their runs began.

        `omega` (N, 2) are the mean sprocket speeds in the last `duration` [rad/s, s], `true` (N, 3) the true poses.
        """
        return PoseEstimate(true, self._covariance, self._valid)


class NoisyPose(TruePose):
    """True poses plus Gaussian noise, drawn at the start of each run."""

    STATE = ("_noise",)

    def __init__(self, fleet: Fleet, deviation: Sequence[float]) -> None:
        """With the standard `deviation` (3,) of x, y and heading [m, m, rad]."""
        super().__init__(fleet)
        self._deviation = np.array(deviation)
        self._covariance[:] = np.diag(self._deviation**2)
        self._noise = np.zeros((fleet.size, 1, 3))

    def begin(self, rows: Index, seeds: Sequence[int], last: Index) -> None:
        """Draw the noise."""
        longer = max(0, int(last.max()) + 1 - self._noise.shape[1])
        self._noise = np.pad(self._noise, ((0, 0), (0, longer), (0, 0)))
        for row, seed, end in zip(rows, seeds, last, strict=True):
            drawn = np.random.default_rng(seed).standard_normal((end + 1, 3))
            self._noise[row, : end + 1] = drawn * self._deviation

    def start(self, rows: Index) -> Array:
        """Noisy poses (R, 3)."""
        return super().start(rows) + self._noise[rows, 0]

    def estimate(self, k: Index | int, omega: Array, true: Array, duration: float) -> PoseEstimate:
        """Noisy poses."""
        noise = self._noise[np.arange(len(true)), np.minimum(k, self._noise.shape[1] - 1)]
        return super().estimate(k, omega, true + noise, duration)


class ScannedPose(TruePose):
    """The pose of the plate in the scans of the laser range finder, tracked from the known start."""

    STATE = ("feed", "tracker")

    def __init__(self, fleet: Fleet, feed: ScannerFeed, locator: Locator) -> None:
        super().__init__(fleet)
        self.feed, self._locator = feed, locator
        self.tracker = Tracker(fleet.pose(), fleet.robot.geometry)
        self.scans: list[np.ndarray] = []
        """Ranges (N, B) of the scans so far, if all are kept [m]."""

    def begin(self, rows: Index, seeds: Sequence[int], last: Index) -> None:
        """Restart the noise and the tracker."""
        self.feed.restart(rows, [np.random.default_rng(seed) for seed in seeds])
        self.tracker.restart(rows, self.start(rows))

    def estimate(self, k: Index | int, omega: Array, true: Array, duration: float) -> PoseEstimate:
        """Tracked poses."""
        predicted = self.tracker.predict(omega, duration)
        return self.tracker.update(self._locator.locate(self.feed.scan(self.scan()), predicted))

    def scan(self) -> Array:
        """Measured ranges (N, B) in the next scan [m]."""
        ranges = self.feed.measure(self.feed.true_ranges()[:, None])[:, 0]
        if self.feed.kept:
            self.scans.append(ranges.astype(np.float32))
        return ranges
