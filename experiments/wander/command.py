"""`trackslip wander`: simulate teleoperated drives, and log them as labs do."""

import shlex
from functools import partial
from math import degrees
from typing import Any, Final

from experiments.common.results import RUNS_FILE, bags_text, write_bags
from experiments.common.run import Run
from experiments.common.table import Table
from experiments.recorder import record_all
from experiments.simulate.motors import print_motors
from experiments.simulate.world import World
from experiments.wander.config import Config
from experiments.wander.drives import bag_contents, drive_contents, wander
from trackslip.bags.open import require_rosbags
from trackslip.errors import counted

_HEADER: Final = (
    "drive",
    "rows",
    "poses",
    "distance [m]",
    "turned left [deg]",
    "right [deg]",
    "at rest",
)


def run(config: Config) -> None:
    """Simulate the drives, store them, and print their contents."""
    if config.bag:
        require_rosbags()
    world = World.of(config)
    simulated = config.drives * config.duration
    with Run(config) as run:
        with run.progress(
            f"{config.driving}, {counted(config.drives, 'drive')}", simulated
        ) as report:
            logs = wander(config, world, report)
        contents = [drive_contents(log) for log in logs]
        summary: dict[str, Any] = {"drives": contents}
        if config.bag:
            with run.busy("bags"):
                names = [log.run for log in logs]
                about = partial(bag_contents, config, world)
                summary["bags"] = write_bags(run.folder, names, logs, about)
        run.write(summary, logs, simulated, **world.about)
        if config.rrd:
            with run.busy("recording"):
                record_all(run.folder, logs)
    rows = []
    for drive in contents:
        turns = (f"{degrees(drive['turned_left']):.0f}", f"{degrees(drive['turned_right']):.0f}")
        counts = (str(drive["readings"]), str(drive["poses"]))
        rows.append(
            (drive["run"], *counts, f"{drive['way']:.1f}", *turns, f"{drive['standing']:.0%}")
        )
    title = f"Drives, with poses of {config.source.source} at {config.source.poses().rate:g} Hz"
    Table(title, _HEADER, rows).print()
    print_motors(config.robot, world.drive)
    if config.bag:
        print(bags_text(config.out, summary["bags"]))
    print(
        f"{config.out / RUNS_FILE}: {run.wall:.1f} s; next: trackslip identify "
        f"{shlex.quote(str(config.out))}"
    )
