"""`trackslip wander`: teleoperated drives, and logs of them as labs have."""

import shlex
from math import degrees
from typing import Any

from experiments.common.results import RUNS_FILE, bags_text, write_bags
from experiments.common.run import Run
from experiments.common.table import Table
from experiments.recorder import record_all
from experiments.simulate.world import Specification, World
from experiments.wander.config import _HEADER, _MOST_ROWS, Config
from experiments.wander.drives import bag_contents, drive_contents, wander
from trackslip.errors import counted
from trackslip.ros.messages import require_rosbags


def run(config: Config) -> None:
    """Drive, store and print."""
    if config.bag:
        require_rosbags()
    simulation, simulated = config.simulation(), config.drives * config.duration
    given = Specification.of(simulation)
    config.check(simulation.drive.changed(given.parameters.drive))
    world = World.of(simulation, given)
    with Run(config) as run:
        with run.progress(f"{config.driving}, {counted(config.drives, 'drive')}", simulated) as report:
            logs = wander(config, world, report)
        contents = [drive_contents(log) for log in logs]
        summary: dict[str, Any] = {"drives": contents}
        if config.bag:
            with run.busy("bags"):
                names = [log.run for log in logs]
                summary["bags"] = write_bags(run.folder, names, logs, lambda log: bag_contents(config, world, log))
        run.write(summary, logs, simulated, **world.about)
        if config.rrd:
            with run.busy("recording"):
                record_all(run.folder, logs)
    title = f"Drives, with poses of {config.source.source} at {config.source.poses().rate:g} Hz"
    rows = [
        (
            *(one["run"], str(one["readings"]), str(one["poses"]), f"{one['way']:.1f}"),
            *(f"{degrees(one[turned]):.0f}" for turned in ("turned_left", "turned_right")),
            f"{one['standing']:.0%}",
        )
        for one in contents[:_MOST_ROWS]
    ]
    Table(title, _HEADER, rows).print()
    if len(contents) > _MOST_ROWS:
        print(f"and {len(contents) - _MOST_ROWS} more")
    if config.bag:
        print(bags_text(config.out, summary["bags"]))
    print(f"{config.out / RUNS_FILE}: {run.wall:.1f} s; next: trackslip identify {shlex.quote(str(config.out))}")
