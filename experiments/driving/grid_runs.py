"""Radius x speed in front of the scanner: the paper's grid of runs, and what its numbers are."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from experiments.driving.world import World
from experiments.options.grid import GridConfig
from experiments.report.terminal import progress
from sim.fleet import Fleet
from sim.robot.robot import Robot
from sim.run_recorder import Description
from sim.runs import Progress as Report
from sim.runs import open_loop
from sim.seeds import generator
from sim.stopwatch import Stopwatch
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.samples import SlipSamples, slip_samples, true_samples
from trackslip.kinematics import Array, RobotGeometry, sprocket_speeds, wrap_angle
from trackslip.localization.base import Locator
from trackslip.localization.bound import scan_ratio_to_bound
from trackslip.localization.line import LineLocator
from trackslip.localization.plate import PlateLocator
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.motion.methods import MOTION_METHODS
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII
from trackslip.slip.exponential import PUBLISHED

CLEARANCE = 1.5
"""Distance from the scanner to the nearest point of each circle [m]."""
_DRIVEN_OVER_COMMANDED = 1.3  # radius driven over radius commanded, about


@dataclass(frozen=True)
class Cell:
    """One run of a grid."""

    name: str
    key: str
    """What its random numbers depend on, besides the root seed."""
    radius: float
    """Of the no-slip command [m]."""
    speed: float
    """Of the no-slip command [m/s]."""
    about: Mapping[str, Any] = field(default_factory=dict)
    """What else is to be remembered of it."""

    @classmethod
    def at(cls, radius: float, speed: float) -> Cell:
        """A run that has nothing special but its radius and speed."""
        name = f"radius={radius!r} speed={speed!r}"
        return cls(name, name, radius, speed)


def drive_grid(config: GridConfig, world: World, watch: Stopwatch | None = None) -> list[RunLog]:
    """Every radius at every speed, all runs at once; raises InvalidValueError for radii too tight for the robot."""
    cells = [Cell.at(radius, speed) for radius, speed in itertools.product(config.radii, config.speeds)]
    with progress(f"{len(cells)} runs, scans and poses", config.duration) as report:
        return drive_cells(cells, [world] * len(cells), report, watch)


def drive_cells(
    cells: Sequence[Cell],
    worlds: Sequence[World],
    report: Report = lambda seconds: None,
    watch: Stopwatch | None = None,
) -> list[RunLog]:
    """Runs of one fleet, each in its own world; these differ in ground, radius error and seed only.

    `report` is told the seconds that have passed for all of them.
    """
    world = worlds[0]
    config, robot = cast(GridConfig, world.config), world.robot
    for cell in cells:
        require_radius(cell.radius, robot.geometry)
    start = np.tile(before_scanner(robot), (len(cells), 1))
    if config.random_phase:
        phases = [
            generator(w.config.seed, f"phase {c.key}").uniform(0, 2 * np.pi) for c, w in zip(cells, worlds, strict=True)
        ]
        start = np.array([on_circle(robot, c.radius, phase) for c, phase in zip(cells, phases, strict=True)])
    errors = np.array([w.radius_error for w in worlds])
    fleet = Fleet(robot, start, [w.ground for w in worlds], errors, config.drive, config.threads)
    feed = world.feed(fleet, [generator(w.config.seed, f"grid {c.key}") for c, w in zip(cells, worlds, strict=True)])
    twist = np.array([(cell.speed, cell.speed / cell.radius) for cell in cells])
    omega = sprocket_speeds(twist, 0.0, robot.geometry)
    descriptions = [
        Description(c.name, {"radius": c.radius, "speed": c.speed, **c.about, **w.metadata(config.localization)})
        for c, w in zip(cells, worlds, strict=True)
    ]
    locator = make_locator(config.localization, robot)
    return open_loop(fleet, omega, config.duration, feed, locator, descriptions, report, watch)


def require_radius(radius: float, geometry: RobotGeometry) -> None:
    """Raise InvalidValueError for a radius too tight for the robot."""
    if radius <= geometry.half_gauge:
        allowed = f"greater than the half gauge, {geometry.half_gauge:g} m: else the inner track must stand or reverse"
        raise InvalidValueError("radii", radius, allowed)


def before_scanner(robot: Robot) -> Array:
    """The pose (3,) at CLEARANCE in front of the scanner, from where a left turn never comes nearer to it."""
    x, y, heading = robot.lrf_mount
    return np.array([x + CLEARANCE * np.cos(heading), y + CLEARANCE * np.sin(heading), heading - np.pi / 2])


def on_circle(robot: Robot, radius: float, phase: float) -> Array:
    """A pose (3,) on a circle before the scanner, from where a left turn commanded with `radius` [m] follows it.

    The circle is as wide as slip makes it, so that it comes no nearer than CLEARANCE wherever on it the robot starts.
    """
    x, y, heading = robot.lrf_mount
    driven = _DRIVEN_OVER_COMMANDED * radius
    away = CLEARANCE + driven
    centre = np.array([x + away * np.cos(heading), y + away * np.sin(heading)])
    along = heading - np.pi / 2 + phase
    outwards = np.array([np.sin(along), -np.cos(along)])
    return np.array([*(centre + driven * outwards), along])


def make_locator(name: str, robot: Robot) -> Locator:
    """The localisation method called `name`."""
    return LineLocator(robot.plate) if name == "line" else PlateLocator(robot.plate)


def simulated_seconds(logs: Sequence[RunLog]) -> float:
    """Simulated time of all runs together [s]."""
    return float(sum(log.time[-1] - log.time[0] for log in logs))


def stages_text(stages: Mapping[str, float]) -> str:
    """Seconds by stage, in a line."""
    return ", ".join(f"{name} {seconds:.1f} s" for name, seconds in stages.items())


def saturation_warnings(logs: Sequence[RunLog]) -> list[str]:
    """Which drives were too weak."""
    warnings = []
    for log in logs:
        if log.truth is not None and log.truth.saturated is not None and log.truth.saturated.max() > 0:
            share = log.truth.saturated.mean(axis=0).max()
            warnings.append(f"run {log.run!r}: a motor is at its limit for {share:.1%} of the time")
    return warnings


def grid_summary(
    config: GridConfig,
    names: Sequence[str],
    logs: Sequence[RunLog],
    samples: SlipSamples,
    geometry: RobotGeometry,
    watch: Stopwatch,
) -> dict[str, Any]:
    """The numbers of a grid: radii, spread of the slips over speed, errors and speed of localisation, errors of slip.

    `names` are those of all its runs, speed by speed. What needs a run that gave no sample is NaN.
    """
    truth = true_samples([log for log in logs if log.run in samples.run], geometry)
    sampled = np.isin(names, samples.run)
    slip, true_slip, radius = (
        np.full((len(names), 2), np.nan),
        np.full((len(names), 2), np.nan),
        np.full(len(names), np.nan),
    )
    slip[sampled], true_slip[sampled], radius[sampled] = samples.slip, truth.slip, samples.radius
    by_radius = (len(config.radii), len(config.speeds))
    by_cell = slip.reshape(*by_radius, 2)
    spread = np.ptp(true_slip.reshape(*by_radius, 2), axis=1).max(axis=0)
    error = samples.slip - truth.slip
    published = published_radii(config.radii)
    at_published = np.repeat(published, len(config.speeds))
    known = ~np.isnan(at_published)
    observed = 1 / (1 / radius).reshape(by_radius).mean(axis=1)  # of the mean curvature
    relative = (observed / published - 1)[~np.isnan(published)]
    outer, inner = 1, 0  # the runs turn left
    seconds = watch.stages.get("localization")
    return {
        "radius": {
            "commanded": list(config.radii),
            "observed": observed,
            "published": published,
            "rms_vs_published": rms(relative) if relative.size else None,
        },
        "slip_by_radius": {"outer": by_cell[..., outer].mean(axis=1), "inner": by_cell[..., inner].mean(axis=1)},
        "slip_rms_vs_published": rms(slip[known] - PUBLISHED(1 / at_published[known])) if known.any() else None,
        "slip_rms_vs_published_at_simulated_radii": rms(samples.slip - PUBLISHED(samples.curvature)),
        "speed_spread": {"outer": spread[outer], "inner": spread[inner]},
        "localization": localization_summary(logs)
        | {
            "ratio_to_bound": bound_ratios(logs),
            "scans_per_s": sum(len(log.time) for log in logs) / seconds if seconds else None,
        },
        "slip_error": _slip_error(error) | motion_errors([log for log in logs if log.run in samples.run], geometry),
    }


def motion_errors(logs: Sequence[RunLog], geometry: RobotGeometry) -> dict[str, Any]:
    """Errors of slip with every motion method, over the runs to which it can be applied; None without any."""
    errors: dict[str, Any] = {}
    for name in MOTION_METHODS:
        parts = []
        for log in logs:
            with contextlib.suppress(LogError):
                parts.append(slip_samples([log], geometry, method=name).slip - true_samples([log], geometry).slip)
        errors[name] = _slip_error(np.concatenate(parts)) if parts else None
    return errors


def _slip_error(error: Array) -> dict[str, Any]:
    """Bias and standard deviation of slip errors (n, 2) in left turns."""
    return {
        name: {"bias": error[:, track].mean(), "std": error[:, track].std()}
        for name, track in (("outer", 1), ("inner", 0))
    }


def published_radii(commanded: Sequence[float]) -> Array:
    """The paper's observed radius for each commanded one (n,) [m]; NaN where the paper has none."""
    printed = dict(zip(COMMANDED_RADII, OBSERVED_RADII, strict=True))
    return np.array([printed.get(radius, np.nan) for radius in commanded])


def localization_summary(logs: Sequence[RunLog]) -> dict[str, Any]:
    """Root mean square errors of all poses against the truth, bridged gaps included [m, m, rad]."""
    error = np.concatenate([log.pose - log.truth.pose for log in logs if log.truth is not None])
    valid = np.concatenate([log.is_valid for log in logs])
    period = float(np.median(np.diff(logs[0].time)))
    return {
        "rmse_x": rms(error[:, 0]),
        "rmse_y": rms(error[:, 1]),
        "rmse_heading": rms(wrap_angle(error[:, 2])),
        "valid_fraction": valid.mean(),
        "rate_hz": valid.mean() / period,
    }


def bound_ratios(logs: Sequence[RunLog]) -> dict[str, float] | None:
    """Errors of the measured poses over their bound, more than MIN_ANGLE from edge-on; None for runs without scans.

    What the scanner sees is the plate, so its own true place, where the leaning robot holds it, is what counts.
    """
    estimated, true = [], []
    for log in logs:
        if log.scans is None or log.scans.scan.noise == 0 or log.truth is None or log.truth.lean is None:
            return None  # exact ranges have no bound either
        phi = log.truth.pose[:, 2]
        left = np.column_stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)])
        estimated.append(log.pose[log.is_valid])
        true.append((log.truth.pose + log.truth.lean[:, None] * left)[log.is_valid])
    scans = logs[0].scans
    assert scans is not None
    ratios = scan_ratio_to_bound(np.concatenate(estimated), np.concatenate(true), scans.plate, scans.scan)
    return dict(zip(("x", "y", "heading"), ratios.tolist(), strict=True))


def radius_rows(config: GridConfig, summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Means over the speeds, a row a radius."""
    columns = (summary["radius"]["observed"], summary["slip_by_radius"]["outer"], summary["slip_by_radius"]["inner"])
    return [
        (f"{commanded:g}", f"{radius:.3f}", f"{outer:+.4f}", f"{inner:+.4f}")
        for commanded, radius, outer, inner in zip(config.radii, *columns, strict=True)
    ]
