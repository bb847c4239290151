"""Simulated runs in numbers: errors of localization; of a grid of left turns radii, slips and errors."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Generic, Self, TypeVar

import numpy as np

from experiments.common.plain_json import plain
from experiments.simulate.grid_options import GridConfig
from sim.stopwatch import Stopwatch
from trackslip.identification.samples import SlipSamples, samples_by_method, true_samples
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.localization.bound import beside_bound
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.motion.methods import MOTION_METHODS, best_method
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
    """Radii compared with the paper; NaN where one of the runs gave no sample."""

    rms_vs_published: float | None
    """Root mean square of observed / published - 1 [-]; None without a published radius."""


@dataclass(frozen=True)
class RatioToBound:
    """Root mean square errors of the measured poses over their Cramér-Rao bound [-]."""

    x: float
    y: float
    heading: float


@dataclass(frozen=True)
class PoseAccuracy:
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
    def of(cls, logs: Iterable[RunLog]) -> Self:
        """Of simulated runs with one sampling period."""
        found = _Poses()
        for log in logs:
            found.add(log)
        values = found.errors()
        return cls(**{one.name: values[one.name] for one in fields(cls)})


@dataclass(frozen=True)
class LocalizationErrors(PoseAccuracy):
    """Pose errors, and the rate of valid poses."""

    rate_hz: float
    """Valid poses per second [1/s]."""


@dataclass(frozen=True)
class GridLocalization(LocalizationErrors):
    """Accuracy and speed of localization in a grid."""

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
    logs: Iterable[RunLog],
    samples: SlipSamples,
    geometry: RobotGeometry,
    watch: Stopwatch,
) -> GridSummary:
    """Evaluate a grid: `names` of all its runs, radius by radius; `logs` of those that were driven; and `samples`.

    The logs are gone through once, so that there need never be more than one of them, in the order of the names.
    `watch` knows how long localization took.
    """
    poses, bound = _Poses(), _PosesOverBound()
    slip, true_slip = (np.full((len(names), 2), np.nan) for _ in range(2))
    radius = np.full(len(names), np.nan)
    sampled = np.isin(names, samples.run)
    slip[sampled], radius[sampled] = samples.slip, samples.radius
    by_method: dict[str, list[Array]] = {name: [] for name in MOTION_METHODS}
    for log in logs:
        poses.add(log)
        bound.add(log)
        if log.run in samples.run:
            truth = true_samples([log], geometry).slip
            row = names.index(log.run)
            true_slip[row] = truth[0]
            with watch.stage("errors of all methods"):
                measured = config.motion or best_method(log)
                by_method[measured].append(slip[[row]] - truth)
                others = [name for name in MOTION_METHODS if name != measured]
                for name, sample in samples_by_method(log, geometry, others).items():
                    by_method[name].append(sample.slip - truth)
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
            **poses.errors(), ratio_to_bound=bound.ratio(), scans_per_s=poses.rows / seconds if seconds else None
        ),
        slip_error=OuterInner.of((slip - true_slip)[sampled], ErrorStatistics.of),
        slip_error_by_method={
            name: OuterInner.of(np.concatenate(parts), ErrorStatistics.of) if parts else None
            for name, parts in by_method.items()
        },
    )


def published_radii(commanded: Sequence[float]) -> Array:
    """The paper's observed radius for each commanded one, (n,) [m]; NaN where the paper has none."""
    printed = dict(zip(COMMANDED_RADII, OBSERVED_RADII, strict=True))
    return np.array([printed.get(radius, np.nan) for radius in commanded])


@dataclass
class _Poses:
    """The errors of all poses of some runs, summed up."""

    rows: int = 0
    compared: int = 0  # with the truth, where that is known
    valid: int = 0
    squares: Array = field(default_factory=lambda: np.zeros(3))  # of the errors of x, y and heading
    period: float = math.nan  # of the rows, the same for all runs

    def add(self, log: RunLog) -> None:
        """Add the poses of a simulated run."""
        if log.truth is not None:
            error = log.pose - log.truth.pose
            error[:, 2] = wrap_angle(error[:, 2])
            self.squares += np.sum(error**2, axis=0)
            self.compared += len(error)
        self.rows += len(log.time)
        self.valid += int(np.count_nonzero(log.is_valid))
        self.period = float(np.median(np.diff(log.time)))

    def errors(self) -> dict[str, float]:
        """The fields of LocalizationErrors for all runs added."""
        x, y, heading = np.sqrt(self.squares / self.compared).tolist()
        valid = self.valid / self.rows
        return dict(rmse_x=x, rmse_y=y, rmse_heading=heading, valid_fraction=valid, rate_hz=valid / self.period)


@dataclass
class _PosesOverBound:
    """The errors of measured poses and their bound, leaving out views close to edge-on, summed up.

    The scanner sees the plate, so the reference is the plate's true place on the leaning robot.
    """

    unknown: bool = False  # of a run without scans or noise
    squares: Array = field(default_factory=lambda: np.zeros(3))  # of the errors of x, y and heading
    variances: Array = field(default_factory=lambda: np.zeros(3))  # the bounds

    def add(self, log: RunLog) -> None:
        """Add the measured poses of a simulated run."""
        scans, truth = log.scans, log.truth
        if scans is None or scans.scan.noise == 0 or truth is None or truth.lean is None:
            self.unknown = True
            return
        phi, valid = truth.pose[:, 2], log.is_valid
        left = np.column_stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)])
        true = (truth.pose + truth.lean[:, None] * left)[valid]
        error, bound = beside_bound(log.pose[valid], true, scans.plate, scans.scan)
        self.squares += np.sum(error**2, axis=0)
        self.variances += np.einsum("sii->i", bound)

    def ratio(self) -> RatioToBound | None:
        """Errors over their bound; None if that is unknown."""
        return None if self.unknown else RatioToBound(*np.sqrt(self.squares / self.variances).tolist())


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
