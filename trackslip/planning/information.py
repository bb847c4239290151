"""Standard errors to expect from a drive, by the derivatives of identification's residuals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from trackslip.drives.drive import Drive, Drives
from trackslip.drives.encoders import Encoders
from trackslip.errors import require, require_positive
from trackslip.identification.law_fit import held_parameters
from trackslip.identification.path import DriveModel
from trackslip.identification.windows import Windows, residuals
from trackslip.kinematics import Array
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning.route import RATE

_WINDOW_LENGTHS: Final = (2.0, 10.0)  # they suit precise and imprecise poses [s]
# largest standard error of a determined parameter, relative to the prior standard deviation
_DETERMINED_SHARE: Final = 0.5
_MAX_POSE_RATE: Final = 10.0  # poses per second that a search resolves at most [Hz]


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
        """Equivalent quality with at most `rate` poses per second [Hz], which are more precise."""
        if self.rate <= rate:
            return self
        share = np.sqrt(rate / self.rate)
        heading = None if self.heading is None else self.heading * share
        return PoseQuality(rate, self.position * share, heading)


@dataclass(frozen=True)
class Expectation:
    """Standard errors expected from an identification."""

    # standard errors of the law's and the extra parameters by name, in their units
    stderr: Mapping[str, float]
    undetermined: tuple[str, ...]  # parameters that the drive doesn't determine


def drive_to_measure(
    speeds: Array, rate: float, poses: PoseQuality, radius: float, merge: int = 1
) -> Drive:
    """Build a drive with belt speeds (T, 2) [m/s] for periods of 1 / `rate` [s].

    `merge` of the periods are combined into one. `radius` is that of the sprockets [m].
    """
    time = np.arange(len(speeds) + 1) / rate
    encoders = Encoders(time, speeds / radius).merged(math.ceil(len(speeds) / merge))
    pose_time = np.arange(0.5 / poses.rate, time[-1], 1 / poses.rate)
    pose = np.zeros((len(pose_time), 3))
    if poses.heading is None:
        pose[:, 2] = np.nan
    return Drive("plan", encoders.edges, encoders.omega, pose_time, pose, 1 / poses.rate)


def expected(
    model: DriveModel,
    values: Array,
    drives: Sequence[Drive],
    poses: PoseQuality,
    slip: Sequence[float],
    known: LawErrors | None = None,
) -> Expectation:
    """Standard errors to expect if the parameters determined by the drives are free.

    The lag is not: see `fit_drives`. `values` (q,) are the law's expected parameters, and `drives`
    come from `drive_to_measure`. `slip` is white noise forwards, sideways [m/sqrt(m)] and in yaw
    [rad/sqrt(m)]. `known` are a previous identification's errors.
    """
    data = Drives.of(drives)
    values = np.concatenate([values, np.zeros(len(model.extras))])
    held = held_parameters(model, data)
    names = [name for name in model.names if name not in held]
    free = np.array([model.index(name) for name in names])

    prior = np.diag(1 / model.prior[free] ** 2)
    if known is not None:
        places = [names.index(name) for name in known.names]
        prior[np.ix_(places, places)] += np.linalg.pinv(known.covariance, hermitian=True)

    # the poses are measured on the path of the expected law
    path = model.path(values, data, np.zeros(0, int))
    data = replace(data, place=path.place, heading=path.heading)
    pose_variance = np.square([poses.position, poses.position, poses.heading or 1.0])
    slip_variance = np.square(slip)

    # the window length with the smaller determinant of the covariance
    covariances = [
        _covariance(model, values, data, length, pose_variance, slip_variance, free, prior)
        for length in _WINDOW_LENGTHS
    ]
    covariance = min(covariances, key=lambda matrix: float(np.linalg.slogdet(matrix)[1]))

    errors = np.sqrt(np.diag(covariance))
    determined = errors < _DETERMINED_SHARE * model.prior[free]
    stderr = {
        name: float(error)
        for name, error, is_determined in zip(names, errors, determined, strict=True)
        if is_determined
    }
    too_imprecise = [name for name in names if name not in stderr]
    return Expectation(stderr, undetermined=(*held, *too_imprecise))


def _covariance(
    model: DriveModel,
    values: Array,
    data: Drives,
    length: float,
    pose_variance: Array,
    slip_variance: Array,
    free: np.ndarray,
    prior: Array,
) -> Array:
    """Covariance (f, f) of the parameters with indices `free` (f,) after fits to windows.

    `length` is that of the windows [s], `pose_variance` (3,) that of x, y and heading,
    `slip_variance` (3,) per distance driven, and `prior` (f, f) a prior precision.

    The fit minimises the squares of the residuals r in all windows, weighted by W. With their
    derivatives S by the parameters, the covariance is N^-1 M N^-1 with N = S' W S and the scatter M
    = cov(S' W r) of the scores. Residuals in a window are correlated, because varying slip is a
    random walk of the pose: each step of the walk shifts all later poses in the window. So the
    scatter does not follow from the slopes alone. It is the sum over all independent noises: the
    errors of each pose in x, y and heading, and the slip in each step forwards, sideways and in
    yaw. A noise e of a pose or step adds var(e) g g', where g is the derivative of S' W r by e, in
    all windows in which it appears. The prior counts as one more measurement and is added to both
    N and M.

    Vectors in the plane are complex: Re(conj(a) b) is the scalar product of a and b, and i b is b
    turned to the left.
    """
    windows = Windows.cut(data, length)
    rows = windows.pose
    distance = data.belt_distance(model.geometry.sprocket_radius)
    last = np.append(windows.first[1:], len(rows)) - 1
    typical = np.median(distance[rows[last]] - distance[rows[windows.first]])

    # the weights that identification would use: about its mean, a random walk has 1/6 of its final
    # variance
    variance = pose_variance + slip_variance * typical / 6
    weight = data.known[:, rows] / variance[1:, None]
    found = residuals(model, data, windows, values, free, weight)
    slope = found.slope[:3]  # (3, f, R)
    precision = np.where(found.known[:3], 1 / variance[:, None], 0.0)
    weighted = slope * precision[:, None]
    normal = np.einsum("kfr,kgr->fg", weighted, slope, optimize=True) + prior

    # derivatives of the scores by the pose of a row: its position in the world, and its heading
    ahead = np.exp(1j * data.heading[rows])
    place = data.place[rows]
    by_place = (weighted[0] + 1j * weighted[1]) * ahead
    by_heading = weighted[2]

    # derivatives by the step before a row, which shifts this and the later rows, and turns them
    # about the row's place: first by shifts and turns about the origin
    by_shift = _later(by_place, windows.first, last)
    by_turn = by_heading + (np.conj(by_place) * 1j * place).real
    by_turn = _later(by_turn, windows.first, last)
    by_forwards = (np.conj(by_shift) * ahead).real
    by_sideways = (np.conj(by_shift) * 1j * ahead).real
    by_yaw = by_turn - (np.conj(by_shift) * 1j * place).real
    step = np.maximum(np.diff(distance, prepend=distance[:1]), 0.0)

    scatter = prior.copy()
    for derivative, noise in [
        (by_place.real, pose_variance[0]),
        (by_place.imag, pose_variance[1]),
        (by_heading, pose_variance[2]),
        (by_forwards, slip_variance[0] * step),
        (by_sideways, slip_variance[1] * step),
        (by_yaw, slip_variance[2] * step),
    ]:
        # windows overlap, so a pose has several rows: sums (f, K) over them
        total = np.stack([np.bincount(rows, row, len(data.time)) for row in derivative])
        scatter += (total * noise) @ total.T
    inverse = np.linalg.inv(normal)
    return np.asarray(inverse @ scatter @ inverse)


def _later(values: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Sums (f, R) of values (f, R) from each row to the end of its window; 0 in its first row.

    `first` and `last` (W,) are the first and last rows of the windows.
    """
    sums = np.cumsum(values, axis=1)
    until_end = np.repeat(sums[:, last], last - first + 1, axis=1)
    later = until_end - sums + values
    later[:, first] = 0.0
    return later


def rate_of(poses: PoseQuality) -> int:
    """Number of command periods that a search may merge without losing the poses' resolution."""
    return max(1, int(RATE / min(poses.rate, _MAX_POSE_RATE)))
