"""`trackslip wander`: simulate teleoperated drives, and log them as labs do."""

import shlex
from functools import partial
from typing import Any

from experiments.common.results import REPORT_FILE, bags_text, write_bags
from experiments.common.run import Run
from experiments.recorder import record_all
from experiments.simulate.grid_summary import soil_warnings
from experiments.simulate.motors import without_motors
from experiments.simulate.world import World
from experiments.wander.config import Config
from experiments.wander.drives import bag_contents, drive_contents, wander
from experiments.wander.page import drives_table, page
from trackslip.bags.open import require_rosbags
from trackslip.errors import counted


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
        manifest = run.manifest(**world.about)
        run.write(summary, logs, simulated, manifest)
        notes = [*without_motors(config.robot, world.drive), *soil_warnings(logs)]
        with run.busy("report"):
            page(config, logs, contents, notes, manifest).write(run.folder, config.pdf)
        if config.rrd:
            with run.busy("recording"):
                record_all(run.folder, logs)
    drives_table(config, contents).print()
    for note in notes:
        print(f"Note: {note}.")
    if config.bag:
        print(bags_text(config.out, summary["bags"]))
    print(
        f"{config.out / REPORT_FILE}: {run.wall:.1f} s; next: trackslip identify "
        f"{shlex.quote(str(config.out))}"
    )
