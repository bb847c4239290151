"""Statistics of simulated runs: localization errors and, for a grid of left turns, radii, slips and
slip errors.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, Self, TypeVar

import numpy as np

from sim.runs.run_recorder import (
    SATURATION,
    SINKING,
    TOP_SPEED_SHARE,
    Saturation,
    Sinking,
)
from trackslip.identification.samples import SlipSamples, true_samples
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.laws.exponential import PUBLISHED
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII

T = TypeVar("T")


@dataclass(frozen=True)
class OuterInner(Generic[T]):
    """A quantity for the outer and the inner track."""

    outer: T
    inner: T

    @classmethod
    def of(cls, values: Array, number: Callable[[Array], T]) -> "OuterInner[T]":
        """A number for each track from values (n, 2) in left turns, left track first."""
        return cls(number(values[:, 1]), number(values[:, 0]))


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of slip errors over the runs of a grid; NaN if no run has a slip."""

    bias: float
    """Mean [-]."""
    std: float
    """Standard deviation [-]."""

    @classmethod
    def of(cls, error: Array) -> Self:
        """Statistics of errors (n,) [-] that are not NaN."""
        known = error[~np.isnan(error)]
        if not known.size:
            return cls(math.nan, math.nan)
        return cls(float(known.mean()), float(known.std()))


@dataclass(frozen=True)
class RadiusSummary:
    """Radii of a grid, one value per commanded radius [m]."""

    commanded: tuple[float, ...]
    observed: Array  # (R,) from the mean curvature over the speeds; NaN where no run has a sample
    published: Array  # (R,) observed radii in the paper; NaN where the paper has none
    rms_vs_published: float | None
    """Root mean square of observed / published - 1 [-]; None without a published radius."""


@dataclass(frozen=True)
class GridSlips:
    """Radii and slips of a grid, from the runs that have a sample."""

    radius: RadiusSummary
    slip_by_radius: OuterInner[Array]  # (R,) each, mean slip over the speeds [-]
    slip_error: OuterInner[ErrorStatistics]
    slip_rms_vs_published: float | None
    """Root mean square of slip minus Eq. 11 at the paper's radii [-]; None without a published
    radius.
    """
    slip_rms_vs_published_at_simulated_radii: float
    """Root mean square of slip minus Eq. 11 at the radii in the simulation [-]; NaN without a
    sample.
    """
    speed_spread: OuterInner[float]
    """Largest difference in true slip between the speeds at a radius [-]; NaN where a run has no
    sample.
    """

    @classmethod
    def of(cls, commanded: Array, observed: Array, slip: Array, true_slip: Array) -> "GridSlips":
        """Summarize runs with radii (n,) [m] and slips (n, 2); the values measured in runs without
        a sample are NaN.
        """
        radii = tuple(dict.fromkeys(commanded.tolist()))

        def means(values: Array) -> Array:
            """Means (R,) over the runs at each radius."""
            return np.array([known_mean(values[commanded == radius]) for radius in radii])

        # radii, from the mean curvature over the speeds
        driven = 1 / means(1 / observed)
        published = published_radii(radii)
        relative = driven / published - 1
        relative = relative[~np.isnan(published)]
        radius_rms = rms(relative) if relative.size else None

        # slips minus Eq. 11, at the paper's radii and at the simulation's own
        printed = published_radii(commanded)
        known = ~np.isnan(observed)
        in_paper = known & ~np.isnan(printed)
        slip_rms = None
        if in_paper.any():
            slip_rms = rms(slip[in_paper] - PUBLISHED(1 / printed[in_paper]))
        own_slip_rms = math.nan
        if known.any():
            own_slip_rms = rms(slip[known] - PUBLISHED(1 / observed[known]))

        # differences between the speeds at each radius
        spread = np.array([np.ptp(true_slip[commanded == radius], axis=0) for radius in radii])

        return GridSlips(
            radius=RadiusSummary(radii, driven, published, radius_rms),
            slip_by_radius=OuterInner.of(slip, means),
            slip_error=OuterInner.of(slip - true_slip, ErrorStatistics.of),
            slip_rms_vs_published=slip_rms,
            slip_rms_vs_published_at_simulated_radii=own_slip_rms,
            speed_spread=OuterInner.of(spread, lambda of_radius: float(of_radius.max())),
        )


@dataclass(frozen=True)
class LocalizationErrors:
    """Root mean square errors of all poses, including gaps bridged by odometry."""

    rmse_x: float
    """Error in x [m]."""
    rmse_y: float
    """Error in y [m]."""
    rmse_heading: float
    """Error in heading [rad]."""
    valid_fraction: float
    """Share of scans with a valid pose [-]."""
    rate_hz: float
    """Valid poses per second [1/s]."""

    @classmethod
    def of(cls, logs: Iterable[RunLog]) -> Self:
        """Errors of simulated runs of equal length."""
        x, y, heading, valid, rate = np.mean([_pose_errors(log) for log in logs], axis=0).tolist()
        return cls(math.sqrt(x), math.sqrt(y), math.sqrt(heading), valid, rate)


@dataclass(frozen=True)
class GridSummary(GridSlips):
    """Radii, slips and localization errors of a grid."""

    localization: LocalizationErrors

    @classmethod
    def of_logs(
        cls, logs: Sequence[RunLog], samples: SlipSamples, geometry: RobotGeometry
    ) -> "GridSummary":
        """Summarize the runs of a grid, which must be ordered by radius, and the slip samples of
        some of them.
        """
        names = [log.run for log in logs]
        rows = [names.index(name) for name in samples.run]
        slip = np.full((len(logs), 2), np.nan)
        true_slip = np.full((len(logs), 2), np.nan)
        observed = np.full(len(logs), np.nan)
        slip[rows] = samples.slip
        observed[rows] = samples.radius
        true_slip[rows] = true_samples([logs[row] for row in rows], geometry).slip
        commanded = np.array([log.metadata["radius"] for log in logs])
        slips = GridSlips.of(commanded, observed, slip, true_slip)
        return cls(**vars(slips), localization=LocalizationErrors.of(logs))


def published_radii(commanded: Iterable[float]) -> Array:
    """The paper's observed radii (n,) [m] for commanded radii; NaN where the paper has none."""
    printed = dict(zip(COMMANDED_RADII, OBSERVED_RADII, strict=True))
    return np.array([printed.get(radius, np.nan) for radius in commanded])


def known_mean(values: Array) -> float:
    """Mean of the values that are not NaN; NaN if there are none."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else math.nan


def _pose_errors(log: RunLog) -> Array:
    """Mean square errors in x, y and heading, the share of valid poses, and the rate of valid poses
    (5,).
    """
    assert log.truth is not None
    error = log.pose - log.truth.pose
    error[:, 2] = wrap_angle(error[:, 2])
    x, y, heading = np.mean(error**2, axis=0)
    valid = np.mean(log.is_valid)
    period = np.median(np.diff(log.time))
    return np.array([x, y, heading, valid, valid / period])


def simulated_seconds(logs: Sequence[RunLog]) -> float:
    """Simulated time of all runs together [s]."""
    return float(sum(log.time[-1] - log.time[0] for log in logs))


def saturation_of(log: RunLog) -> Saturation | None:
    """The motor of a run that was at its limit for longer; None if none was."""
    known = log.metadata.get(SATURATION)
    return None if known is None else Saturation(**known)


def sinking_of(log: RunLog) -> Sinking | None:
    """How the robot of a run sank into soft soil; None on firm ground."""
    known = log.metadata.get(SINKING)
    return None if known is None else Sinking(**known)


def soil_warnings(logs: Sequence[RunLog]) -> list[str]:
    """Lines for runs in soft soil in which the robot was immobilised, or tilted in its ruts."""
    lines = []
    for log in logs:
        sinking = sinking_of(log)
        if sinking is not None:
            lines += [f"run {log.run!r}: {note}" for note in sinking.notes]
    return lines


def saturation_warnings(logs: Sequence[RunLog]) -> list[str]:
    """A line for each run in which a motor reached its limit, and for each in which set points
    reached the top speed.
    """
    warnings = []
    for log in logs:
        saturation = saturation_of(log)
        if saturation is not None:
            warnings.append(saturation_warning(log.run, saturation))
        share = log.metadata.get(TOP_SPEED_SHARE)
        if share is not None:
            warnings.append(
                f"run {log.run!r}: set points at the top speed for {share:.1%} of the time"
            )
    return warnings


def saturation_warning(run: str, saturation: Saturation) -> str:
    """The warning on a run with a motor at its limit."""
    return f"run {run!r}: {saturation}"
