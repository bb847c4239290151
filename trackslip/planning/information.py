"""Standard errors to expect from a drive, by the slopes of the residuals that identification fits: those of windows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import require, require_positive
from trackslip.identification.path import EXTRAS, GYRO, DriveModel
from trackslip.identification.preparation import PreparedDrive, merged
from trackslip.identification.windows import Data, Windows, residuals
from trackslip.kinematics import Array
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning.maneuvers import RATE

_LENGTHS = (2.0, 10.0)  # of windows [s], for fine and for coarse poses
_WALK = 0.1  # variance of the slope of n residuals of a random walk over that of white ones, per n and way
_TOLD = 0.5  # share of the prior's width that a standard error has at most where the driving tells a parameter


@dataclass(frozen=True)
class PoseQuality:
    """Poses that a drive will be measured with."""

    rate: float
    """Poses per second [Hz]."""
    position: float
    """Standard deviation of x and of y [m]."""
    heading: float | None
    """Standard deviation of the heading [rad]; None where it isn't measured."""

    def __post_init__(self) -> None:
        require_positive("rate", self.rate)
        require_positive("position", self.position)
        require(self.heading is None or self.heading > 0, "heading", self.heading, "a number > 0, or None")

    def thinned(self, rate: float) -> PoseQuality:
        """About as good poses, but no more than `rate` per second [Hz]."""
        if self.rate <= rate:
            return self
        share = np.sqrt(rate / self.rate)
        return PoseQuality(rate, self.position * share, None if self.heading is None else self.heading * share)


@dataclass(frozen=True)
class Expectation:
    """Standard errors expected of an identification."""

    stderr: Mapping[str, float]
    """Standard errors of the law's parameters and of the extras, in their units."""
    held: tuple[str, ...]
    """Parameters that the driving doesn't determine."""


def drive_to_measure(speeds: Array, rate: float, poses: PoseQuality, radius: float, merge: int = 1) -> PreparedDrive:
    """A drive with belt speeds (T, 2) [m/s] in periods of 1 / `rate` [s], `merge` of them taken together."""
    edges, omega = merged(np.arange(len(speeds) + 1) / rate, speeds / radius, -(-len(speeds) // merge))
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
    """Standard errors to expect, with all parameters but the lag free that the drives determine, as in `fit_drives`.

    Args:
        model: the law and the sensor.
        values: expected parameters (p,) of the model.
        drives: the drives, as by `drive_to_measure`.
        poses: quality of the poses.
        slip: white slip forwards, sideways [m/sqrt(m)] and in turn [rad/sqrt(m)].
        known: errors of the law from an earlier identification.
    """
    held = {"lag"} if poses.heading is not None else {"lag", "sensor_yaw"}
    if "offset_left" in model.names:
        held.add("sensor_y")  # can't be told from unequal ICRs
    names = [name for name in model.names if name not in held]
    matrix = information(model, values, drives, poses, slip, names)
    if known is not None:
        at = [names.index(name) for name in known.names]
        matrix[np.ix_(at, at)] += np.linalg.inv(known.covariance)
    errors = np.sqrt(np.diag(np.linalg.inv(matrix)))
    told = errors < _TOLD * model.prior[[model.index(name) for name in names]]
    return Expectation(
        {name: float(error) for name, error, kept in zip(names, errors, told, strict=True) if kept},
        (*held, *(name for name, kept in zip(names, told, strict=True) if not kept)),
    )


def information(
    model: DriveModel,
    values: Array,
    drives: Sequence[PreparedDrive],
    poses: PoseQuality,
    slip: Sequence[float],
    names: Sequence[str],
) -> Array:
    """Information (f, f) on the parameters `names` of drives cut into windows, and of the priors.

    Of windows that are short or long, those that tell more are taken, as identification does.
    """
    free = np.array([model.index(name) for name in names])
    prior = np.diag(1 / model.prior[free] ** 2)
    told = [_of_windows(model, values, Data.of(drives), length, poses, slip, free) + prior for length in _LENGTHS]
    return max(told, key=lambda matrix: float(np.linalg.slogdet(matrix)[1]))


def _of_windows(
    model: DriveModel,
    values: Array,
    data: Data,
    length: float,
    poses: PoseQuality,
    slip: Sequence[float],
    free: np.ndarray,
) -> Array:
    """Information (f, f) of windows of a length [s] on the parameters `free` (f,).

    Slip that varies is a random walk of the pose, so that residuals of a window depend on each other: n of them that
    drive a way L have the variance of white ones plus 0.1 n L times that of the walk, for whatever grows with the way.
    """
    windows = Windows.cut(data, length, twice=False)
    variance = np.array([poses.position, poses.heading or np.inf]) ** 2
    weight = data.known[:, windows.pose] / variance[:, None]
    found = residuals(model, data, windows, values, free, weight)
    line = data.line
    driven = np.append(0.0, np.cumsum(np.abs(line.omega).mean(axis=1) * np.diff(line.edges)))
    way = model.geometry.sprocket_radius * np.interp(line.time, line.edges, driven)[windows.pose]
    count, first = np.diff(np.append(windows.first, len(windows.pose))), windows.first
    way = way[first + count - 1] - way[first]
    forward, sideways, turn = (walk**2 * way for walk in slip)
    walk = np.stack([forward, sideways + turn * way**2 / 12, turn])  # a turn moves what lies ahead sideways
    white = np.array([poses.position, poses.position, poses.heading or 1.0])[:, None] ** 2
    total = (white + _WALK * count * walk)[:, windows.of]
    pull = np.where(found.known[:3], 1 / total, 0.0)
    return np.asarray(np.einsum("kfr,kr,kgr->fg", found.slope[:3], pull, found.slope[:3], optimize=True))


def with_extras(law: Array) -> Array:
    """Parameters (p,) of a model without gyro: the law's, followed by EXTRAS, which are 0."""
    return np.concatenate([law, np.zeros(len(EXTRAS) - len(GYRO))])


def rate_of(poses: PoseQuality) -> int:
    """Number of commands to take together in a search without losing the poses' resolution."""
    return max(1, int(RATE / min(poses.rate, 10.0)))
