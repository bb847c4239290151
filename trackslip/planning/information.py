"""Standard errors to expect from a drive, by the Fisher information of the drive estimator's own equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import require, require_positive
from trackslip.identification.determined import vaguest
from trackslip.identification.drive_equations import solve
from trackslip.identification.drive_model import EXTRAS, GYRO, DriveModel
from trackslip.identification.drive_residuals import Nodes, Noise, residuals
from trackslip.identification.drives import PreparedDrive, merged
from trackslip.kinematics import Array
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning.maneuvers import RATE

_UNKNOWN_HEADING = 1.0  # standard deviation of a heading that isn't measured, which has no weight [rad]


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
    return PreparedDrive("plan", edges, omega, time, pose, np.arange(len(time)), 1 / poses.rate)


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
    while True:
        free = [model.index(name) for name in names]
        prior = np.diag(1 / model.prior[free] ** 2)
        found = vaguest(names, matrix - prior, model.limits[2][free])
        if found is None:
            break
        kept = np.array([name != found[0] for name in names])
        names = [name for name in names if name != found[0]]
        matrix = matrix[np.ix_(kept, kept)]
    errors = np.sqrt(np.diag(np.linalg.inv(matrix)))
    return Expectation(
        dict(zip(names, errors.tolist(), strict=True)), tuple(name for name in model.names if name not in names)
    )


def information(
    model: DriveModel,
    values: Array,
    drives: Sequence[PreparedDrive],
    poses: PoseQuality,
    slip: Sequence[float],
    names: Sequence[str],
) -> Array:
    """Information (f, f) on the parameters `names`, the trajectory being unknown, and of the priors."""
    nodes = Nodes.of(drives)
    states = np.concatenate([model.sensor_path(values, drive) for drive in drives])
    noise = Noise(np.array([poses.position, poses.heading or _UNKNOWN_HEADING, *slip, 0.0, 0.0]))
    free = np.array([model.index(name) for name in names])
    found = residuals(model, nodes, states, values, free)
    still = np.zeros(len(values))
    return solve(found, nodes, noise, model.index("sensor_yaw"), model.prior, still).information


def with_extras(law: Array) -> Array:
    """Parameters (p,) of a model without gyro: the law's, followed by EXTRAS, which are 0."""
    return np.concatenate([law, np.zeros(len(EXTRAS) - len(GYRO))])


def rate_of(poses: PoseQuality) -> int:
    """Number of commands to take together in a search without losing the poses' resolution."""
    return max(1, int(RATE / min(poses.rate, 10.0)))
