"""Residuals of runs with respect to a law, in standard deviations.

The measured twist of a run is random; its sprocket speeds are known. A law predicts the twist from these speeds, so
slip and radius, both functions of the measured twist with correlated errors, need not be treated separately: the
residual of a run is the measured minus the predicted speed V of either track, (2,) [m/s]. Its covariance is

    C = N + tau^2 s^2 I,    N = B P B^T,    s = r max |omega|

P is the covariance of the measured twist, B maps twists to track speeds, and tau is the scatter of the track speeds
beyond the measurement errors, relative to s, the speed of the faster sprocket: effects outside the law (uneven ground,
speed, its wrong shape). They act on the robot as a whole, so a slow sprocket is not predicted better than a fast one,
and one that stands still is as good as any. N is diagonalised once per run, N = s^2 Q diag(lambda) Q^T, so that
changing tau is cheap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import SIDES, Array, RobotGeometry, track_speeds
from trackslip.laws.base import SlipLaw

MIN_SCATTER = 1e-9  # tau of samples that follow a law to within rounding, and their least relative error [-]
_MAX_SCATTER = 10.0
_HALVINGS = 60
_EXPLAINED = 0.99  # quantile of chi-square up to which measurement errors explain it


@dataclass(frozen=True)
class WeightedRuns:
    """M sets of n steady runs with the same sprocket speeds; arrays shared by all sets have a leading length of 1."""

    geometry: RobotGeometry
    omega: Array  # (n, 2) [rad/s]
    speeds: Array  # (M or 1, n, 2) measured speeds V of the tracks [m/s]
    turn: Array  # (n, 2, 2) Q^T / s
    eigenvalues: Array  # (n, 2) lambda
    weight: Array  # (M or 1, n) multiplicity of each run
    load: Array | None = None  # (n, 2) tractions per unit load, if known [-]

    @classmethod
    def of(cls, samples: SlipSamples, geometry: RobotGeometry) -> WeightedRuns:
        """One set of runs. Without covariances of the twists, all scatter is tau."""
        scale = geometry.sprocket_radius * np.abs(samples.omega).max(axis=1)[:, None, None]
        speeds = track_speeds(samples.twist, geometry.half_gauge)[None]
        weight = np.ones((1, len(scale)))
        if samples.covariance is None:
            return cls(
                geometry, samples.omega, speeds, np.eye(2) / scale, np.zeros((len(scale), 2)), weight, samples.load
            )
        to_tracks = _to_tracks(geometry)
        noise = to_tracks @ samples.covariance @ to_tracks.T
        eigenvalues, vectors = np.linalg.eigh(noise / scale**2)
        turn = vectors.swapaxes(1, 2) / scale
        return cls(geometry, samples.omega, speeds, turn, np.maximum(eigenvalues, MIN_SCATTER**2), weight, samples.load)

    @property
    def runs(self) -> int:
        """Number of runs, n."""
        return len(self.omega)

    @property
    def of_twists(self) -> Array:
        """Q^T B / s (n, 2, 2): from twists to deviations along the eigenvectors."""
        return self.turn @ _to_tracks(self.geometry)

    @property
    def axes(self) -> Array:
        """Q^T (n, 2, 2): from deviations of the tracks relative to s to those along the eigenvectors."""
        return self.turn * (self.geometry.sprocket_radius * np.abs(self.omega).max(axis=1)[:, None, None])

    def weighted(self, weight: Array) -> WeightedRuns:
        """A copy with weights (M, n)."""
        return replace(self, weight=weight)

    def measured(self, twist: Array) -> WeightedRuns:
        """A copy with other measured twists (M, n, 2)."""
        return replace(self, speeds=track_speeds(twist, self.geometry.half_gauge))

    def deviation(self, law: SlipLaw, rows: np.ndarray | slice = slice(None)) -> Array:
        """Residuals (m, n, 2) of the sets `rows` along the eigenvectors, relative to s; `law` is m laws (m, 1)."""
        return self.missed(law.twist(self.omega, self.geometry), rows)

    def missed(self, twist: Array, rows: np.ndarray | slice = slice(None)) -> Array:
        """Residuals (m, n, 2) of predicted twists (m, n, 2), as `deviation` gives them."""
        predicted = track_speeds(twist, self.geometry.half_gauge)
        speeds = self.speeds if len(self.speeds) == 1 else self.speeds[rows]
        return np.einsum("nij,mnj->mni", self.turn, speeds - predicted)

    def whiten(self, deviation: Array, scatter: Array, rows: np.ndarray | slice = slice(None)) -> Array:
        """Residuals (m, 2 n) in standard deviations, times the roots of the weights, for scatters (m,)."""
        return (deviation * self.roots(scatter, rows)).reshape(len(deviation), 2 * deviation.shape[1])

    def roots(self, scatter: Array, rows: np.ndarray | slice = slice(None)) -> Array:
        """Roots (m, n, 2) of the weights over the standard deviations, for scatters (m,)."""
        weight = self.weight if len(self.weight) == 1 else self.weight[rows]
        return np.sqrt(weight[..., None] / (self.eigenvalues + scatter[:, None, None] ** 2))

    def scatter(self, deviation: Array, freedom: float) -> Array:
        """tau (M,) at which chi-square equals its expectation `freedom`, after Paule and Mandel (1982).

        It is 0 if the measurement errors explain chi-square: estimating the scatter only when chance makes it large
        would widen intervals needlessly. Without measurement errors it is at least MIN_SCATTER.
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
            least |= unscattered < scipy.special.chdtri(freedom, 1 - _EXPLAINED)
        return np.where(least, 0.0 if known else MIN_SCATTER, np.exp((low + high) / 2))


def _to_tracks(geometry: RobotGeometry) -> Array:
    """B (2, 2): from a twist to track speeds."""
    return np.column_stack([np.ones(2), SIDES * geometry.half_gauge])


def relative_errors(twist: Array, samples: SlipSamples, geometry: RobotGeometry) -> Array:
    """Errors (n, 2) of the track speeds of predicted twists (n, 2), relative to the speed of the faster sprocket."""
    missed = track_speeds(twist - samples.twist, geometry.half_gauge)
    return missed / (geometry.sprocket_radius * np.abs(samples.omega).max(axis=1, keepdims=True))
