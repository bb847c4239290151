"""The numbers of a grid of steady left turns: radii, slips, and the errors of slip and localization."""

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Generic, Self, TypeVar

import numpy as np

from experiments.options.grid import GridConfig
from experiments.storage.plain_json import plain
from sim.stopwatch import Stopwatch
from trackslip.errors import LogError
from trackslip.identification.samples import MeasuredRuns, SlipSamples, samples_by_method
from trackslip.identification.true_samples import true_samples
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.localization.bound import scan_ratio_to_bound
from trackslip.localization.scan import Cluster
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.motion.methods import MOTION_METHODS
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII
from trackslip.slip.exponential import PUBLISHED

T = TypeVar("T")


@dataclass(frozen=True)
class OuterInner(Generic[T]):
    """A quantity of the outer and of the inner track."""

    outer: T
    inner: T

    @classmethod
    def of(cls, values: Array, number: Callable[[Array], T]) -> "OuterInner[T]":
        """A number of each track from values (n, 2) in left turns, left track first."""
        return cls(number(values[:, 1]), number(values[:, 0]))


@dataclass(frozen=True)
class ErrorStatistics:
    """Errors of slip over the runs of a grid; NaN where no run gives one."""

    bias: float
    """Mean [-]."""
    std: float
    """Standard deviation [-]."""

    @classmethod
    def of(cls, error: Array) -> Self:
        """Of errors (n,) [-], leaving out NaN."""
        known = error[~np.isnan(error)]
        return cls(float(known.mean()), float(known.std())) if known.size else cls(math.nan, math.nan)


@dataclass(frozen=True)
class Radii:
    """Radii of a grid, one value per commanded radius [m]."""

    commanded: tuple[float, ...]
    observed: Array  # (R,) of the mean curvature over the speeds; NaN where no run gave a sample
    published: Array  # (R,) the paper's; NaN where it has none


@dataclass(frozen=True)
class RadiusSummary(Radii):
    """The same compared with the paper; NaN where one of the runs gave no sample."""

    rms_vs_published: float | None
    """Root mean square of observed / published - 1 [-]; None without a published radius."""


@dataclass(frozen=True)
class RatioToBound:
    """Root mean square errors of the measured poses over their Cramér-Rao bound [-]."""

    x: float
    y: float
    heading: float


@dataclass(frozen=True)
class PoseErrors:
    """Root mean square errors of all poses, gaps bridged by odometry included."""

    rmse_x: float
    """[m]"""
    rmse_y: float
    """[m]"""
    rmse_heading: float
    """[rad]"""
    valid_fraction: float
    """Share of the scans that gave a pose [-]."""

    @classmethod
    def of(cls, logs: Sequence[RunLog]) -> "PoseErrors":
        """Of simulated runs."""
        error = np.concatenate([log.pose - log.truth.pose for log in logs if log.truth is not None])
        valid = float(np.concatenate([log.is_valid for log in logs]).mean())
        return PoseErrors(rms(error[:, 0]), rms(error[:, 1]), rms(wrap_angle(error[:, 2])), valid)


@dataclass(frozen=True)
class LocalizationErrors(PoseErrors):
    """The same, and how often a pose was found."""

    rate_hz: float
    """Valid poses per second [1/s]."""

    @classmethod
    def of(cls, logs: Sequence[RunLog]) -> Self:
        """Of simulated runs with one sampling period."""
        poses = PoseErrors.of(logs)
        return cls(**vars(poses), rate_hz=poses.valid_fraction / float(np.median(np.diff(logs[0].time))))


@dataclass(frozen=True)
class GridLocalization(LocalizationErrors):
    """How well the poses of a grid were found, and how fast."""

    ratio_to_bound: RatioToBound | None
    """None for runs without scans."""
    scans_per_s: float | None
    """Scans localized per second of computing [1/s]; None where the time was not measured."""


@dataclass(frozen=True)
class GridSummary:
    """The numbers of a grid. Where one needs a run that gave no sample, it is NaN."""

    radius: RadiusSummary
    slip_by_radius: OuterInner[Array]  # (R,) each, mean slip over the speeds [-]
    slip_rms_vs_published: float | None
    """Root mean square of slip minus Eq. 11 at the paper's radii [-]; None without a published radius."""
    slip_rms_vs_published_at_simulated_radii: float
    """The same at the radii driven here [-]."""
    speed_spread: OuterInner[float]
    """Largest difference of true slip between the speeds of one radius [-]."""
    localization: GridLocalization
    slip_error: OuterInner[ErrorStatistics]
    """Errors of slip with the chosen motion method."""
    slip_error_by_method: Mapping[str, OuterInner[ErrorStatistics] | None]
    """Errors of slip with every motion method; None for a method that suits no run."""

    def to_json(self) -> dict[str, Any]:
        """The entries of a summary.json."""
        found = plain(self)
        found["slip_error"] |= found.pop("slip_error_by_method")
        return found


def grid_summary(
    config: GridConfig,
    names: Sequence[str],
    logs: Sequence[RunLog],
    samples: SlipSamples,
    geometry: RobotGeometry,
    watch: Stopwatch,
    measured: MeasuredRuns = MappingProxyType({}),
) -> GridSummary:
    """Evaluate a grid: `names` of all its runs, radius by radius; `logs` of those that were driven; and `samples`.

    `watch` knows how long localization took; runs may be `measured` by every method already.
    """
    sampled_logs = [log for log in logs if log.run in samples.run]
    truth = _true_samples(sampled_logs, geometry, measured)
    sampled = np.isin(names, samples.run)
    slip, true_slip = (np.full((len(names), 2), np.nan) for _ in range(2))
    radius = np.full(len(names), np.nan)
    slip[sampled], true_slip[sampled], radius[sampled] = samples.slip, truth.slip, samples.radius
    by_radius = (len(config.radii), len(config.speeds))
    mean_slip = slip.reshape(*by_radius, 2).mean(axis=1)
    spread = np.ptp(true_slip.reshape(*by_radius, 2), axis=1)
    published = published_radii(config.radii)
    at_published = np.repeat(published, len(config.speeds))
    known = ~np.isnan(at_published)
    observed = 1 / (1 / radius).reshape(by_radius).mean(axis=1)
    relative = (observed / published - 1)[~np.isnan(published)]
    seconds = watch.stages.get("localization")
    return GridSummary(
        radius=RadiusSummary(config.radii, observed, published, rms(relative) if relative.size else None),
        slip_by_radius=OuterInner.of(mean_slip, np.array),
        slip_rms_vs_published=rms(slip[known] - PUBLISHED(1 / at_published[known])) if known.any() else None,
        slip_rms_vs_published_at_simulated_radii=rms(samples.slip - PUBLISHED(samples.curvature)),
        speed_spread=OuterInner.of(spread, lambda of_radius: float(of_radius.max())),
        localization=GridLocalization(
            **vars(LocalizationErrors.of(logs)),
            ratio_to_bound=ratio_to_bound(logs),
            scans_per_s=sum(len(log.time) for log in logs) / seconds if seconds else None,
        ),
        slip_error=OuterInner.of(samples.slip - truth.slip, ErrorStatistics.of),
        slip_error_by_method=_errors_by_method(sampled_logs, truth.slip, geometry, measured),
    )


def _true_samples(logs: Sequence[RunLog], geometry: RobotGeometry, measured: MeasuredRuns) -> SlipSamples:
    """Samples from the true motion of the runs."""
    known = [one.truth for log in logs if (one := measured.get(log.run)) is not None and one.truth is not None]
    return SlipSamples.joined(known) if len(known) == len(logs) else true_samples(logs, geometry)


def _errors_by_method(
    logs: Sequence[RunLog], true_slip: Array, geometry: RobotGeometry, measured: MeasuredRuns
) -> dict[str, OuterInner[ErrorStatistics] | None]:
    """Errors of slip (n, 2) with every motion method, over the runs that it suits; None where it suits none."""
    errors: dict[str, list[Array]] = {name: [] for name in MOTION_METHODS}
    for log, true in zip(logs, true_slip, strict=True):
        with contextlib.suppress(LogError):
            known = measured.get(log.run)
            for name, sample in (samples_by_method(log, geometry) if known is None else known.by_method).items():
                errors[name].append(sample.slip - true)
    return {
        name: OuterInner.of(np.concatenate(parts), ErrorStatistics.of) if parts else None
        for name, parts in errors.items()
    }


def published_radii(commanded: Sequence[float]) -> Array:
    """The paper's observed radius for each commanded one, (n,) [m]; NaN where the paper has none."""
    printed = dict(zip(COMMANDED_RADII, OBSERVED_RADII, strict=True))
    return np.array([printed.get(radius, np.nan) for radius in commanded])


def ratio_to_bound(logs: Sequence[RunLog]) -> RatioToBound | None:
    """Errors of the measured poses over their bound, leaving out views close to edge-on; None without scans or noise.

    The scanner sees the plate, so the reference is the plate's true place on the leaning robot.
    """
    estimated, true = [], []
    for log in logs:
        if log.scans is None or log.scans.scan.noise == 0 or log.truth is None or log.truth.lean is None:
            return None
        phi = log.truth.pose[:, 2]
        left = np.column_stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)])
        estimated.append(log.pose[log.is_valid])
        true.append((log.truth.pose + log.truth.lean[:, None] * left)[log.is_valid])
    scans = logs[0].scans
    assert scans is not None
    seen = None
    if scans.scan.dropout > 0:
        seen = Cluster.joined([log.scans.cluster.take(np.flatnonzero(log.is_valid)) for log in logs if log.scans])
    ratios = scan_ratio_to_bound(np.concatenate(estimated), np.concatenate(true), scans.plate, scans.scan, seen)
    return RatioToBound(*ratios.tolist())


def simulated_seconds(logs: Sequence[RunLog]) -> float:
    """Simulated time of all runs together [s]."""
    return float(sum(log.time[-1] - log.time[0] for log in logs))


def saturation_warnings(logs: Sequence[RunLog]) -> list[str]:
    """A line for each run in which a motor reached its limit."""
    return [
        f"run {log.run!r}: a motor is at its limit for {log.truth.saturated.mean(axis=0).max():.1%} of the time"
        for log in logs
        if log.truth is not None and log.truth.saturated is not None and log.truth.saturated.max() > 0
    ]
