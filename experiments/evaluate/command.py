"""`trackslip evaluate`: how far odometry by slip laws is off on a log."""

from dataclasses import asdict
from functools import partial

from experiments.common.manifest import command_line
from experiments.common.results import REPORT_FILE, TABLE_FILE, TRAJECTORIES_FOLDER
from experiments.common.run import Run
from experiments.common.run_table import chosen
from experiments.evaluate import odometry
from experiments.evaluate.config import Config
from experiments.evaluate.odometry_page import page, print_errors, sensing_lines
from trackslip.identification.source import origin
from trackslip.se2 import Mounting


def run(config: Config) -> None:
    """Evaluate the laws, store and print their errors."""
    specs = odometry.law_files(config)
    with Run(config) as run, run.progress("odometry", 2 + len(specs), "stages") as step:
        select = partial(chosen, where=config.where) if config.where else None
        source = odometry.read_drives(config, specs, select)
        for line in source.taken:
            print(line)
        laws = odometry.labelled_laws(specs, source.geometry)
        step(1.0)
        sensor = None if config.sensor is None else Mounting(*config.sensor)
        found = odometry.evaluated(laws, source.logs, sensor, config.clock_offset, step)
        sensing = sensing_lines(found, config.sensor is not None, config.clock_offset is not None)
        notes = [*source.notes, *map(str, source.refused), *found[0].errors.notes]
        notes += odometry.identified_from(config.path, specs)
        notes += odometry.clock_doubt(found, source.logs) or odometry.pose_doubts(found)
        summary = {
            "geometry": asdict(source.geometry),
            "laws": {one.label: odometry.summary_of(one) for one in found},
            "drives": {one.label: one.errors.drives for one in found},
            "warnings": notes,
        }
        manifest = run.manifest(**origin(source.logs))
        run.write(summary, manifest=manifest)
        odometry.write_error_table(found, run.folder / TABLE_FILE)
        if config.tum:
            odometry.write_trajectories(found, run.folder / TRAJECTORIES_FOLDER)
        title = f"Odometry by slip laws on “{config.path.resolve().name}”"
        page(found, notes, sensing, manifest, command_line("evaluate"), title).write(run.folder, config.pdf)
        step(1.0)
    print_errors(found, notes, sensing)
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")
