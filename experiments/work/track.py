"""`trackslip track`: one run in closed loop."""

import time
from functools import partial
from typing import Any

import numpy as np

from experiments.driving.closed_loop import ClosedLoopRun, drive_closed_loops, start_pose
from experiments.driving.grid_runs import before_scanner
from experiments.driving.lookup import compensation, reference
from experiments.driving.world import World
from experiments.measuring.grid import LocalizationErrors, simulated_seconds
from experiments.measuring.tracking import tracking_results
from experiments.options.track import TrackConfig
from experiments.recording import record_all
from experiments.recording.failed_runs import results_or_failed_runs
from experiments.report.terminal import busy, print_table, progress
from experiments.report.tracking import TRACKING_HEADER, tracking_table
from experiments.storage.bags import bags_text, write_bags
from experiments.storage.plain_json import plain
from experiments.storage.results import RUNS_FILE, write_results
from sim.robot.robot import Robot
from trackslip.logs.runlog import RunLog
from trackslip.ros.decode import require_rosbags
from trackslip.trajectory.base import Reference
from trackslip.trajectory.segmented import circle


def run(config: TrackConfig) -> None:
    """Drive once, store the run and print its errors."""
    began = time.perf_counter()
    if config.bag:
        require_rosbags()
    world = World.of(config)
    path = make_reference(config, world.robot)
    with results_or_failed_runs(config.out, "track", world) as folder:
        logs = drive(config, world, path)
        wall = time.perf_counter() - began
        results, poses = tracking_results(logs, path), LocalizationErrors.of(logs)
        summary: dict[str, Any] = {
            "tracking": [result.to_json() for result in results],
            "localization": poses,
            "timing": {"wall_s": wall, "simulated_s": simulated_seconds(logs), "stages": {"track": wall}},
        }
        if config.bag:
            summary["bags"] = write_bags(folder, [log.run for log in logs], logs)
        write_results(folder, summary, world.manifest("track", wall), logs)
        if config.rrd:
            with busy("recording"):
                record_all(folder, logs)
    print_table("Tracking errors of the true pose", TRACKING_HEADER, tracking_table(results))
    print(f"{poses.valid_fraction:.1%} of the scans gave a valid pose; odometry bridged the rest")
    if config.bag:
        print(bags_text(config.out, summary["bags"]))
    print(f"{config.out / RUNS_FILE}: {wall:.1f} s")


def drive(config: TrackConfig, world: World, path: Reference) -> list[RunLog]:
    """Drive the run; returns a list of one."""
    name = f"{config.controller} {config.compensation}"
    metadata: dict[str, Any] = {"reference": config.reference}
    if config.reference == "circle":
        metadata["circle"] = plain(circle_options(config, world.robot))
    start = start_pose(config.controller, config.reference, path) if config.start is None else np.array(config.start)
    one = ClosedLoopRun(
        name, f"track {name}", config.seed, config.controller, config.compensation, start, metadata=metadata
    )
    law = partial(compensation, robot=world.robot.geometry, laws=config.laws)
    with progress(name, path.duration) as report:
        return drive_closed_loops([one], world, path, config.localization, law, config.preview, report, config.bag)


def circle_options(config: TrackConfig, robot: Robot) -> dict[str, Any]:
    """The arguments of the configured circle."""
    options = {"radius": config.circle_radius, "speed": config.circle_speed, "duration": config.circle_duration}
    return options | {"start": before_scanner(robot)}


def make_reference(config: TrackConfig, robot: Robot) -> Reference:
    """The configured path; a circle lies in front of the scanner."""
    if config.reference != "circle":
        return reference(config.reference)
    return circle(**circle_options(config, robot))
