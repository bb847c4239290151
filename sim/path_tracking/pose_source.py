"""Sources of the observed pose: the truth, the truth with noise, or the scanner."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.fleet import Fleet
from sim.path_tracking.config import PERIOD, EnvConfig
from sim.path_tracking.episode import Index
from sim.restorable import Restorable
from sim.scanner.feed import ScannerFeed
from trackslip.kinematics import Array
from trackslip.localization.base import PoseEstimate
from trackslip.localization.plate import PlateLocator
from trackslip.localization.pose_tracker import Tracker


class TruePose(Restorable):
    """True poses of N robots; the base of the other sources."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._covariance = np.zeros((fleet.size, 3, 3))
        self._valid = np.ones(fleet.size, bool)

    def begin(self, rows: Index, seeds: Sequence[int], last: Index) -> None:
        """Begin episodes of the robots `rows` (R,), with noise seeds (R,) and lengths (R,) [control periods]."""

    def start(self, rows: Index) -> Array:
        """Observed poses (R, 3) of the robots `rows` (R,) at the start of their episodes."""
        return self._fleet.pose()[rows]

    def estimate(self, k: Index, omega: Array, true: Array) -> PoseEstimate:
        """Observed poses of the N robots, `k` (N,) control periods after the episodes began.

        `omega` (N, 2) are the mean sprocket speeds in the last one [rad/s], `true` (N, 3) the true poses [m, m, rad].
        """
        return PoseEstimate(true, self._covariance, self._valid)


class NoisyPose(TruePose):
    """True poses plus Gaussian noise, drawn at the start of each episode."""

    STATE = ("_noise",)

    def __init__(self, fleet: Fleet, config: EnvConfig) -> None:
        super().__init__(fleet)
        self._deviation = np.array([config.position_noise, config.position_noise, config.heading_noise])
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

    def estimate(self, k: Index, omega: Array, true: Array) -> PoseEstimate:
        """Noisy poses."""
        noise = self._noise[np.arange(len(k)), np.minimum(k, self._noise.shape[1] - 1)]
        return super().estimate(k, omega, true + noise)


class ScannedPose(TruePose):
    """The pose of the plate in the scans of the laser range finder, tracked from the known start."""

    STATE = ("_feed", "_tracker")

    def __init__(self, fleet: Fleet, config: EnvConfig) -> None:
        super().__init__(fleet)
        self._feed = ScannerFeed(config.scanner, fleet)
        self._locator = PlateLocator(fleet.robot.plate)
        self._tracker = Tracker(fleet.pose(), fleet.robot.geometry)

    def begin(self, rows: Index, seeds: Sequence[int], last: Index) -> None:
        """Restart the noise and the tracker."""
        self._feed.restart(rows, [np.random.default_rng(seed) for seed in seeds])
        self._tracker.restart(rows, self.start(rows))

    def estimate(self, k: Index, omega: Array, true: Array) -> PoseEstimate:
        """Tracked poses."""
        predicted = self._tracker.predict(omega, PERIOD)
        ranges = self._feed.measure(self._feed.true_ranges()[:, None])[:, 0]
        return self._tracker.update(self._locator.locate(self._feed.scan(ranges), predicted))


def pose_source(config: EnvConfig, fleet: Fleet) -> TruePose:
    """The pose source of a configuration."""
    if config.pose_source == "truth":
        return TruePose(fleet)
    return NoisyPose(fleet, config) if config.pose_source == "noisy" else ScannedPose(fleet, config)
