"""`trackslip sensitivity`: how disturbances of scanner, mounting and field affect the identified slip."""

import time
from dataclasses import replace

from experiments.driving.grid_runs import drive_grid
from experiments.driving.world import World
from experiments.measuring.sensitivity import DISTURBANCES, SensitivityRow
from experiments.options.sensitivity import SensitivityConfig
from experiments.recording import record_all
from experiments.report.formats import for_terminal
from experiments.report.sensitivity import HEADER, render, table
from experiments.report.terminal import busy, print_table, progress
from experiments.storage.manifest import command_line
from experiments.storage.results import REPORT_FILE, results_folder, write_results
from sim.runs import Progress
from trackslip.logs.runlog import RunLog


def run(config: SensitivityConfig) -> None:
    """Drive, evaluate, store and print."""
    began = time.perf_counter()
    with results_folder(config.out) as folder:
        world = World.of(config)
        grids = 1 + sum(disturbance.driven(config) != config for disturbance in DISTURBANCES)
        with progress(f"{grids} grids", grids * config.duration) as report:
            rows, examples = measure(config, world, report)
        wall = time.perf_counter() - began
        manifest = world.manifest("sensitivity", wall)
        render(rows, manifest, command_line("sensitivity")).write(folder, config.pdf)
        write_results(folder, {"rows": rows, "timing": {"wall_s": wall}}, manifest)
        if config.rrd:
            with busy("recordings"):
                record_all(folder, examples)
    print_table("Errors of slip over the runs, and of the poses (rms)", HEADER, for_terminal(table(rows)))
    for row in rows:
        if row.slip_error is None:
            print(f"warning: {row.effect}: {row.warnings[-1]}")
    print(f"{config.out / REPORT_FILE}: {len(rows)} grids in {wall:.1f} s")


def measure(
    config: SensitivityConfig, world: World, progress: Progress = lambda seconds: None
) -> tuple[list[SensitivityRow], list[RunLog]]:
    """One row per disturbance, all with the same random numbers, and the first run of each as an example."""
    nominal = drive_grid(config, world, progress)
    rows, examples = [], []
    for disturbance in DISTURBANCES:
        changed = disturbance.driven(config)
        logs = nominal if changed == config else drive_grid(changed, World.of(changed), progress)
        logs = [disturbance.evaluated(log) for log in logs]
        examples.append(replace(logs[0], run=f"{disturbance.name}, {logs[0].run}"))
        rows.append(SensitivityRow.of(disturbance, logs, world.robot.geometry, config.motion))
    return rows, examples
