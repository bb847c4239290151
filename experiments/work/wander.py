"""`trackslip wander`: teleoperated drives, and logs of them as labs have."""

import shlex
import time
from math import degrees
from typing import Any

from experiments.driving.wander import bag_contents, wander
from experiments.driving.world import World
from experiments.measuring.wander import DriveContents
from experiments.options.wander import WanderConfig
from experiments.recording import record_all
from experiments.recording.failed_runs import results_or_failed_runs
from experiments.report.terminal import busy, print_table, progress
from experiments.storage.bags import bags_text, write_bags
from experiments.storage.results import RUNS_FILE, write_results
from trackslip.ros.decode import require_rosbags

_HEADER = ("drive", "rows", "poses", "way [m]", "left [deg]", "right [deg]", "at rest")
_MOST_ROWS = 20  # of the table


def run(config: WanderConfig) -> None:
    """Drive, store and print."""
    began = time.perf_counter()
    if config.bag:
        require_rosbags()
    world = World.of(config.simulation())
    with results_or_failed_runs(config.out, "wander", world) as folder:
        with progress(f"{config.driving}, {config.drives} drives", config.drives * config.duration) as report:
            logs = wander(config, world, report)
        contents = [DriveContents.of(log) for log in logs]
        wall = time.perf_counter() - began
        simulated = config.drives * config.duration
        timing = {"wall_s": wall, "simulated_s": simulated, "stages": {"wander": wall}}
        manifest = world.manifest("wander", wall, config)
        summary: dict[str, Any] = {"drives": contents, "timing": timing}
        if config.bag:
            with busy("bags"):
                names = [log.run for log in logs]
                summary["bags"] = write_bags(folder, names, logs, lambda log: bag_contents(config, world, log))
        write_results(folder, summary, manifest, logs)
        if config.rrd:
            with busy("recording"):
                record_all(folder, logs)
    source = config.source.poses()
    headings = "" if source.heading else ", without headings"
    print_table(
        f"Drives, with poses of {config.source.source} at {source.rate:g} Hz{headings}", _HEADER, _rows(contents)
    )
    if len(contents) > _MOST_ROWS:
        print(f"and {len(contents) - _MOST_ROWS} more")
    if config.bag:
        print(bags_text(config.out, summary["bags"]))
    print(f"{config.out / RUNS_FILE}: {wall:.1f} s; next: trackslip identify {shlex.quote(str(config.out))}")


def _rows(contents: list[DriveContents]) -> list[tuple[str, ...]]:
    """A row per drive."""
    return [
        (
            *(one.run, str(one.readings), str(one.poses), f"{one.way:.1f}"),
            *(f"{degrees(turned):.0f}" for turned in (one.turned_left, one.turned_right)),
            f"{one.standing:.0%}",
        )
        for one in contents[:_MOST_ROWS]
    ]
