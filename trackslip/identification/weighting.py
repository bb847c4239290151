"""How far runs are from a law, in standard deviations.

What is random is the measured twist of a run; its sprocket speeds are known. A law says what twist those speeds drive,
so slip and radius, both functions of the measured twist with errors that belong together, needn't be told apart: the
residual of a run is the measured minus the predicted speed V of either track, (2,) [m/s]. Its covariance is

    C = N + tau^2 S^2,    N = B P B^T,    S = diag(r |omega|)

P is the covariance of the measured twist, B takes twists to track speeds, and tau is a scatter of slip beyond
measurement: what the law doesn't know of (uneven ground, speed, its own wrong shape). S is floored at a tenth of the
faster track's, for slip is no measure of a track whose sprocket hardly turns. N and S^2 are diagonalised together once
per run, N = S Q diag(lambda) Q^T S, so that another tau costs nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import SIDES, Array, RobotGeometry, track_speeds
from trackslip.slip.base import SlipLaw

_MIN_RELATIVE_SPEED = 0.1  # sprocket speed whose slip still counts, relative to the faster one
MIN_SCATTER = 1e-9
"""tau of samples that lie on a law to within rounding [-]."""
_MAX_SCATTER = 10.0
_HALVINGS = 60
_EXPLAINED = 0.99  # probability of a smaller chi-square, up to which it is put down to chance


@dataclass(frozen=True)
class WeightedRuns:
    """M sets of n steady runs with the same sprocket speeds; what all sets have in common has length 1 in front."""

    geometry: RobotGeometry
    omega: Array  # (n, 2) [rad/s]
    speeds: Array  # (M or 1, n, 2) measured speeds V of the tracks [m/s]
    turn: Array  # (n, 2, 2) Q^T S^-1
    eigenvalues: Array  # (n, 2) lambda
    weight: Array  # (M or 1, n) how often each run counts

    @classmethod
    def of(cls, samples: SlipSamples, geometry: RobotGeometry) -> WeightedRuns:
        """One set. Without covariances of the twists, all scatter is tau."""
        size = np.abs(samples.omega)
        scale = geometry.sprocket_radius * np.maximum(size, _MIN_RELATIVE_SPEED * size.max(axis=1, keepdims=True))
        to_tracks = np.column_stack([np.ones(2), SIDES * geometry.half_gauge])
        if samples.covariance is None:
            noise: Array = np.zeros((len(size), 2, 2))
        else:
            noise = to_tracks @ samples.covariance @ to_tracks.T
        eigenvalues, vectors = np.linalg.eigh(noise / scale[:, :, None] / scale[:, None, :])
        turn = vectors.swapaxes(1, 2) / scale[:, None, :]
        speeds = track_speeds(samples.twist, geometry.half_gauge)[None]
        return cls(geometry, samples.omega, speeds, turn, np.maximum(eigenvalues, 0.0), np.ones((1, len(size))))

    @property
    def runs(self) -> int:
        """n."""
        return len(self.omega)

    def weighted(self, weight: Array) -> WeightedRuns:
        """The same with weights (M, n)."""
        return replace(self, weight=weight)

    def measured(self, twist: Array) -> WeightedRuns:
        """The same with other measured twists (M, n, 2)."""
        return replace(self, speeds=track_speeds(twist, self.geometry.half_gauge))

    def deviation(self, law: SlipLaw, rows: np.ndarray | slice = slice(None)) -> Array:
        """Residuals (m, n, 2) of the sets `rows` along the eigenvectors, in units of slip; `law` is m laws (m, 1)."""
        predicted = track_speeds(law.twist(self.omega, self.geometry), self.geometry.half_gauge)
        speeds = self.speeds if len(self.speeds) == 1 else self.speeds[rows]
        return np.einsum("nij,mnj->mni", self.turn, speeds - predicted)

    def whiten(self, deviation: Array, scatter: Array, rows: np.ndarray | slice = slice(None)) -> Array:
        """Residuals (m, 2 n) in standard deviations, times the roots of the weights, for scatters (m,)."""
        weight = self.weight if len(self.weight) == 1 else self.weight[rows]
        factor = np.sqrt(weight[..., None] / (self.eigenvalues + scatter[:, None, None] ** 2))
        return (deviation * factor).reshape(len(deviation), -1)

    def scatter(self, deviation: Array, freedom: float) -> Array:
        """tau (M,) that brings chi-square to its expectation `freedom`, after Paule and Mandel (1982).

        0 where the errors of measurement explain chi-square: a scatter that is estimated only when chance makes it
        large would widen intervals for nothing. Without such errors at least what rounding leaves.
        """
        known = self.eigenvalues.min(initial=np.inf) > 0
        low = np.full(len(deviation), np.log(MIN_SCATTER))
        high = np.full(len(deviation), np.log(_MAX_SCATTER))
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            above = np.sum(self.whiten(deviation, np.exp(middle)) ** 2, axis=1) > freedom
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        least = low == np.log(MIN_SCATTER)
        if known:
            unscattered = np.sum(self.whiten(deviation, np.zeros(len(deviation))) ** 2, axis=1)
            least |= unscattered < scipy.stats.chi2.ppf(_EXPLAINED, freedom)
        return np.where(least, 0.0 if known else MIN_SCATTER, np.exp((low + high) / 2))
