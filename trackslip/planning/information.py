"""Standard errors to expect from a drive, computed from the derivatives of the residuals fitted in
identification.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackslip.errors import require, require_positive
from trackslip.identification.law_fit import held_parameters
from trackslip.identification.path import DriveModel
from trackslip.identification.preparation import Drives, PreparedDrive, merged
from trackslip.identification.windows import Windows, residuals
from trackslip.kinematics import Array
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning.route import RATE

_LENGTHS = (2.0, 10.0)  # window lengths that suit precise and imprecise poses [s]
# largest standard error of a determined parameter, relative to the prior standard deviation
_DETERMINED = 0.5


@dataclass(frozen=True)
class PoseQuality:
    """Rate and standard deviations of the poses that will be measured in a drive."""

    rate: float
    """Number of poses per second [Hz]."""
    position: float
    """Standard deviation of x, and of y [m]."""
    heading: float | None
    """Standard deviation of the heading [rad]; None if it isn't measured."""

    def __post_init__(self) -> None:
        require_positive("rate", self.rate)
        require_positive("position", self.position)
        require(
            self.heading is None or self.heading > 0,
            "heading",
            self.heading,
            "a number > 0, or None",
        )

    def thinned(self, rate: float) -> PoseQuality:
        """Equivalent quality with at most `rate` poses per second [Hz], which are more precise in
        return.
        """
        if self.rate <= rate:
            return self
        share = np.sqrt(rate / self.rate)
        return PoseQuality(
            rate, self.position * share, None if self.heading is None else self.heading * share
        )


@dataclass(frozen=True)
class Expectation:
    """Standard errors expected from an identification."""

    # standard errors of the law's and the extra parameters by name, in their units
    stderr: Mapping[str, float]
    held: tuple[str, ...]  # parameters that the drive doesn't determine


def drive_to_measure(
    speeds: Array, rate: float, poses: PoseQuality, radius: float, merge: int = 1
) -> PreparedDrive:
    """Build a drive with belt speeds (T, 2) [m/s] for periods of 1 / `rate` [s], `merge` of them
    combined into one.
    """
    edges, omega = merged(
        np.arange(len(speeds) + 1) / rate, speeds / radius, -(-len(speeds) // merge)
    )
    time = np.arange(0.5 / poses.rate, edges[-1], 1 / poses.rate)
    pose = np.zeros((len(time), 3))
    if poses.heading is None:
        pose[:, 2] = np.nan
    return PreparedDrive("plan", edges, omega, time, pose, 1 / poses.rate)


def expected(
    model: DriveModel,
    values: Array,
    drives: Sequence[PreparedDrive],
    poses: PoseQuality,
    slip: Sequence[float],
    known: LawErrors | None = None,
) -> Expectation:
    """Standard errors to expect if all parameters determined by the drives are free, except the
    lag: see `fit_drives`.

    `values` (q,) are the law's expected parameters, and `drives` come from `drive_to_measure`.
    `slip` is white noise forwards, sideways [m/sqrt(m)] and in yaw [rad/sqrt(m)]. `known` are a
    previous identification's errors.
    """
    data, values = Drives.of(drives), np.concatenate([values, np.zeros(len(model.extras))])
    held = held_parameters(model, data)
    names = [name for name in model.names if name not in held]
    free = np.array([model.index(name) for name in names])
    prior = np.diag(1 / model.prior[free] ** 2)
    if known is not None:
        at = [names.index(name) for name in known.names]
        prior[np.ix_(at, at)] += np.linalg.pinv(known.covariance, hermitian=True)
    path = model.path(values, data, np.zeros(0, int))
    data = replace(data, place=path.place, heading=path.heading)
    white, per_way = np.square([[poses.position, poses.position, poses.heading or 1.0], slip])
    covariances = [
        _covariance(model, values, data, length, white, per_way, free, prior) for length in _LENGTHS
    ]
    covariance = min(covariances, key=lambda matrix: float(np.linalg.slogdet(matrix)[1]))
    errors = np.sqrt(np.diag(covariance))
    determined = errors < _DETERMINED * model.prior[free]
    stderr = {
        name: float(error)
        for name, error, known in zip(names, errors, determined, strict=True)
        if known
    }
    return Expectation(stderr, (*held, *(name for name in names if name not in stderr)))


def _covariance(
    model: DriveModel,
    values: Array,
    data: Drives,
    length: float,
    white: Array,
    slip: Array,
    free: np.ndarray,
    prior: Array,
) -> Array:
    """Covariance (f, f) of the parameters with indices `free` (f,), fitted to windows of `length`
    [s].

    `white` (3,) are pose variances, `slip` (3,) slip variances per distance driven, `prior` (f, f)
    a prior precision.

    Residuals in a window are correlated, because varying slip is a random walk of the pose: each
    step of the walk shifts all later poses in the window. So the scatter of the scores does not
    follow from their slopes alone.
    """
    windows, rows = (cut := Windows.cut(data, length)), cut.pose
    way = data.way(model.geometry.sprocket_radius)
    last = np.append(windows.first[1:], len(rows)) - 1
    typical = np.median(way[rows[last]] - way[rows[windows.first]])
    # about its mean, a random walk has 1/6 of its final variance
    variance = white + slip * typical / 6
    weight = data.known[:, rows] / variance[1:, None]
    found = residuals(model, data, windows, values, free, weight)
    pull = found.slope[:3] * np.where(found.known[:3], 1 / variance[:, None], 0.0)[:, None]
    normal = np.einsum("kfr,kgr->fg", pull, found.slope[:3], optimize=True) + prior

    ahead, place = np.exp(1j * data.heading[rows]), data.place[rows]
    at_place, at_heading = (pull[0] + 1j * pull[1]) * ahead, pull[2]
    along = _later(at_place, windows.first, last)
    turning = _later(at_heading + (np.conj(at_place) * 1j * place).real, windows.first, last)
    by_step = [(np.conj(along) * ahead).real, (np.conj(along) * 1j * ahead).real]
    by_step.append(turning - (np.conj(along) * 1j * place).real)
    step = np.maximum(np.diff(way, prepend=way[:1]), 0.0)
    scatter = prior.copy()
    for score, size in [
        *zip((at_place.real, at_place.imag, at_heading), white[:, None], strict=True),
        *zip(by_step, slip[:, None] * step, strict=True),
    ]:
        total = np.stack([np.bincount(rows, each, len(data.time)) for each in score])
        scatter += (total * size) @ total.T
    inverse = np.linalg.inv(normal)
    return np.asarray(inverse @ scatter @ inverse)


def _later(values: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Sums (f, R) of values (f, R) from each row to the end of its window, but 0 in the first row
    of a window.
    """
    sums = np.cumsum(values, axis=1)
    rest = np.repeat(sums[:, last], last - first + 1, axis=1) - sums + values
    rest[:, first] = 0.0
    return rest


def rate_of(poses: PoseQuality) -> int:
    """Number of command periods that a search may combine into one without losing the resolution of
    the poses.
    """
    return max(1, int(RATE / min(poses.rate, 10.0)))
