"""`trackslip track`: one run in closed loop."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.driving.grid_runs import (
    before_scanner,
    localization_summary,
    make_locator,
    simulated_seconds,
)
from experiments.driving.lookup import compensation, controller, reference
from experiments.driving.world import World
from experiments.options.track import TrackConfig
from experiments.options.world import LINEAR_START
from experiments.recording import record_all
from experiments.report.terminal import print_table, progress
from experiments.storage.plain_json import plain
from experiments.storage.results import RUNS_FILE, results_folder, write_results
from sim.robot.robot import Robot
from sim.run_recorder import Description
from sim.runs import Pilot, closed_loop
from sim.seeds import generator
from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.metrics import tracking_errors
from trackslip.trajectory.base import Reference
from trackslip.trajectory.segmented import circle


def run(config: TrackConfig) -> None:
    """Drive once, store the run and print its errors."""
    began = time.perf_counter()
    with results_folder(config.out) as folder:
        world = World.of(config)
        path = make_reference(config, world.robot)
        logs = drive(config, world, path)
        wall = time.perf_counter() - began
        rows = tracking_summary(logs, path)
        found = localization_summary(logs)
        summary = {
            "tracking": rows,
            "localization": found,
            "timing": {"wall_s": wall, "simulated_s": simulated_seconds(logs), "stages": {"track": wall}},
        }
        about = world.manifest("track", wall)
        write_results(folder, logs, summary, about)
        if config.rrd:
            record_all(folder, logs)
    print_table("Tracking errors of the true pose", TRACKING_HEADER, tracking_rows(rows))
    print(f"{found['valid_fraction']:.1%} of the scans gave a valid pose; the rest was dead reckoning")
    print(f"{config.out / RUNS_FILE}: {wall:.1f} s")


def drive(config: TrackConfig, world: World, path: Reference) -> list[RunLog]:
    """The run, as a list of one."""
    robot = world.robot
    pilot = Pilot(
        controller(config.controller, robot.geometry, config.drive.top_speed),
        [0],
        compensation(config.compensation, robot.geometry, config.laws),
        config.preview,
    )
    start = start_pose(config, path)
    name = f"{config.controller} {config.compensation}"
    fleet = world.fleet(start[None])
    feed = world.feed(fleet, [generator(config.seed, f"track {name}")])
    locator = None if config.localization == "truth" else make_locator(config.localization, robot)
    metadata = world.metadata(config.localization) | {
        "controller": config.controller,
        "compensation": config.compensation,
        "reference": config.reference,
        "start": start.tolist(),
    }
    if config.reference == "circle":
        metadata["circle"] = plain(circle_options(config, robot))
    with progress(name, path.duration) as report:
        return closed_loop(fleet, [pilot], path, feed, locator, [Description(name, metadata)], report)


def circle_options(config: TrackConfig, robot: Robot) -> dict[str, Any]:
    """The arguments of the configured circle."""
    return {
        "radius": config.circle_radius,
        "speed": config.circle_speed,
        "duration": config.circle_duration,
        "start": before_scanner(robot),
    }


def make_reference(config: TrackConfig, robot: Robot) -> Reference:
    """The configured path; a circle is one in front of the scanner, as the options say."""
    if config.reference != "circle":
        return reference(config.reference)
    return circle(**circle_options(config, robot))


def start_pose(config: TrackConfig, reference: Reference) -> Array:
    """Where the robot is set down (3,)."""
    if config.start is not None:
        return np.array(config.start)
    if config.controller == "linear" and config.reference == "paper":
        return np.array(LINEAR_START)
    return reference.pose(0.0)


def tracking_summary(logs: Sequence[RunLog], reference: Reference) -> list[dict[str, Any]]:
    """Errors of each run's true pose against the reference [m, rad]."""
    rows = []
    for log in logs:
        if log.truth is None:
            raise LogError(f"run {log.run!r}: has no truth")
        named = {key: log.metadata[key] for key in ("controller", "compensation", "localization")}
        rows.append(named | plain(tracking_errors(log.time, log.truth.pose, reference)))
    return rows


TRACKING_HEADER = (
    "controller",
    "compensation",
    "rms [mm]",
    "> 12 s [mm]",
    "max [mm]",
    "end [mm]",
    "end [deg]",
)


def tracking_rows(tracking: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """A summary's `tracking` as rows of text."""
    keys = ("rms_position", "rms_position_after_12s", "max_position", "final_position")
    return [
        (
            row["controller"],
            row["compensation"],
            *("-" if row[key] is None else f"{1e3 * row[key]:.1f}" for key in keys),
            f"{np.degrees(row['final_heading']):.2f}",
        )
        for row in tracking
    ]
