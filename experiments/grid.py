"""`trackslip grid`: radius x speed in front of the scanner."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments import store
from experiments.config import GridConfig, Simulation
from experiments.console import print_table, progress
from sim.fleet import Fleet
from sim.robot import Robot, load_robot
from sim.runs import Description, open_loop
from sim.scanner import ScannerFeed
from sim.seeds import generator
from trackslip.errors import InvalidValueError
from trackslip.identification import SlipSamples, slip_samples, true_samples
from trackslip.kinematics import Array, RobotGeometry, sprocket_speeds, wrap_angle
from trackslip.localization import LineLocator, Locator, PlateLocator
from trackslip.metrics import rms
from trackslip.published import COMMANDED_RADII, OBSERVED_RADII
from trackslip.runlog import RunLog
from trackslip.slip import PUBLISHED

CLEARANCE = 1.5
"""Distance from the scanner to the nearest point of each circle [m]."""


def run(config: GridConfig) -> None:
    """Drive the grid and store it."""
    began = time.perf_counter()
    with store.results(config.out) as folder:
        robot = load_robot()
        logs = drive_grid(config, robot)
        wall = time.perf_counter() - began
        summary = grid_summary(config, logs, robot.geometry) | {
            "timing": {"wall_s": wall, "simulated_s": simulated_seconds(logs), "stages": {"grid": wall}}
        }
        store.write_parquet(folder, logs)
        store.write_json(folder / store.SUMMARY, summary)
        store.write_json(
            folder / store.MANIFEST,
            store.manifest("grid", config, wall, seed=config.seed, model_sha256=robot.digest),
        )
    print_table(
        f"{len(logs)} runs of {config.duration:g} s",
        ("commanded radius [m]", "observed [m]", "outer slip", "inner slip"),
        radius_rows(config, slip_samples(logs, robot.geometry)),
    )
    print(f"{config.out / store.RUNS}: {len(logs)} runs in {wall:.1f} s")


def drive_grid(config: GridConfig, robot: Robot) -> list[RunLog]:
    """Every radius at every speed, all runs at once; raises InvalidValueError for radii too tight for the robot."""
    half_gauge = robot.geometry.half_gauge
    for radius in config.radii:
        if radius <= half_gauge:
            raise InvalidValueError(
                "radii",
                radius,
                f"greater than the half gauge, {half_gauge:g} m: else the inner track must stand or reverse",
            )
    cells = list(itertools.product(config.radii, config.speeds))
    radius, speed = np.array(cells).T
    keys = [f"radius={r:g} speed={v:g}" for r, v in cells]
    fleet = make_fleet(config, robot, np.tile(before_scanner(robot), (len(cells), 1)))
    feed = ScannerFeed(config.scanner, fleet, [generator(config.seed, f"grid {key}") for key in keys])
    omega = sprocket_speeds(np.stack([speed, speed / radius], axis=-1), 0.0, robot.geometry)
    common = run_metadata(config, robot, config.localization)
    descriptions = [
        Description(key, {"radius": r, "speed": v, **common}) for key, (r, v) in zip(keys, cells, strict=True)
    ]
    with progress(f"{len(cells)} runs, scans and poses", config.duration) as report:
        return open_loop(
            fleet, omega, config.duration, feed, make_locator(config.localization, robot), descriptions, report
        )


def before_scanner(robot: Robot) -> Array:
    """The pose (3,) at CLEARANCE in front of the scanner, from where a left turn never comes nearer to it."""
    x, y, heading = robot.lrf_mount
    return np.array([x + CLEARANCE * np.cos(heading), y + CLEARANCE * np.sin(heading), heading - np.pi / 2])


def make_fleet(config: Simulation, robot: Robot, start: Array) -> Fleet:
    """Robots at the poses `start` (N, 3) in the configured world."""
    return Fleet(robot, start, config.ground, config.radius_error, config.drive, config.threads)


def make_locator(name: str, robot: Robot) -> Locator:
    """The localisation method called `name`."""
    return LineLocator(robot.plate) if name == "line" else PlateLocator(robot.plate)


def run_metadata(config: Simulation, robot: Robot, localization: str) -> dict[str, Any]:
    """What every simulated run remembers."""
    metadata: dict[str, Any] = store.plain(
        {
            "geometry": robot.geometry,
            "plate": robot.plate,
            "ground": config.ground,
            "radius_error": config.radius_error,
            "drive": config.drive,
            "scanner": config.scanner,
            "localization": localization,
            "seed": config.seed,
        }
    )
    return metadata


def simulated_seconds(logs: Sequence[RunLog]) -> float:
    """Simulated time of all runs together [s]."""
    return float(sum(log.time[-1] - log.time[0] for log in logs))


def grid_summary(config: GridConfig, logs: Sequence[RunLog], geometry: RobotGeometry) -> dict[str, Any]:
    """The numbers of a grid: radii, spread of the slips over speed, errors of localisation and of slip."""
    samples, truth = slip_samples(logs, geometry), true_samples(logs, geometry)
    by_radius = (len(config.radii), len(config.speeds))
    spread = np.ptp(truth.slip.reshape(*by_radius, 2), axis=1).max(axis=0)
    error = samples.slip - truth.slip
    published = published_radii(config.radii)
    known = np.repeat(~np.isnan(published), len(config.speeds))
    at_published = np.repeat(published, len(config.speeds))[known]
    observed = samples.radius.reshape(by_radius).mean(axis=1)
    relative = (observed / published - 1)[~np.isnan(published)]
    outer, inner = 1, 0  # the runs turn left
    return {
        "radius": {
            "commanded": list(config.radii),
            "observed": observed,
            "published": published,
            "rms_vs_published": rms(relative) if relative.size else None,
        },
        "slip_rms_vs_published": rms(samples.slip[known] - PUBLISHED(1 / at_published)) if known.any() else None,
        "slip_rms_vs_published_at_simulated_radii": rms(samples.slip - PUBLISHED(samples.curvature)),
        "speed_spread": {"outer": spread[outer], "inner": spread[inner]},
        "localization": localization_summary(logs),
        "slip_error": {
            name: {"bias": error[:, track].mean(), "std": error[:, track].std()}
            for name, track in (("outer", outer), ("inner", inner))
        },
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


def radius_rows(config: GridConfig, samples: SlipSamples) -> list[tuple[str, ...]]:
    """Means over the speeds, a row a radius."""
    by_radius = (len(config.radii), len(config.speeds))
    radius = samples.radius.reshape(by_radius).mean(axis=1)
    slip = samples.slip.reshape(*by_radius, 2).mean(axis=1)
    return [
        (f"{commanded:g}", f"{r:.3f}", f"{s[1]:+.4f}", f"{s[0]:+.4f}")
        for commanded, r, s in zip(config.radii, radius, slip, strict=True)
    ]
