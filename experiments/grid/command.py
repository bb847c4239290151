"""`trackslip grid`: drive the missing runs of a grid, and summarize all runs."""

from typing import Any

from experiments.common.plain_json import plain
from experiments.common.results import (
    REPORT_FILE,
    RUNS_FILE,
    TABLE_FILE,
    bags_text,
    write_bags,
)
from experiments.common.sweep import drive_missing, resumable
from experiments.common.table import stages_text
from experiments.grid.config import Config
from experiments.grid.drawbar import drawbar_tests
from experiments.grid.page import page
from experiments.grid.plan import plan
from experiments.grid.runs import GridRuns
from experiments.grid.summary import all_failed, grids_of, print_sweep, summary_of
from experiments.grid.table import write_table
from experiments.recorder import record_all
from experiments.simulate.motors import without_motors
from experiments.simulate.world import Specification, World
from trackslip.bags.open import require_rosbags
from trackslip.errors import TrackslipError, counted
from trackslip.logs.logfile import read_runs


def run(config: Config) -> None:
    """Drive the missing runs, and store, summarize and print all runs."""
    if config.bag:
        require_rosbags()
    runs = plan(config)
    # read before its files can change; the plan has checked the load, which may be an axis
    world = World.of(config, Specification.of(config))
    with resumable(config, {case.id for case in runs}) as (run, store):
        resumed = len(store.rows)
        began = run.wall
        file = run.folder / RUNS_FILE
        simulated = sum(case.duration for case in runs if case.id not in store.rows)
        drive_missing(
            runs,
            store,
            GridRuns(config.threads),
            run.watch,
            config.jobs,
            config.executor,
            config.wait,
        )
        timing = {"driving_s": run.wall - began, "driven": len(runs) - resumed, "resumed": resumed}
        rows = [store.rows[case.id] | {"run": case.name, **plain(case.axes)} for case in runs]
        driven = [row["run"] for row in rows if row["error"] is None]
        if not driven:
            raise TrackslipError(all_failed(rows))
        with run.watch.stage("gathering"):
            store.gather(runs, file)
            if config.rrd:
                record_all(run.folder, read_runs(file))
            write_table(rows, list(runs[0].axes), run.folder / TABLE_FILE)
        about: dict[str, Any] = {"timing": timing}
        if config.bag:
            with run.watch.stage("bags"), run.progress("bags", len(driven), "bags") as done:
                about["bags"] = write_bags(run.folder, driven, read_runs(file), done=done)
        grids = grids_of(runs, rows)
        tests = drawbar_tests(runs, rows)
        if tests:
            about["drawbar"] = plain([test.summary() for test in tests])
        manifest = run.manifest(**world.about)
        run.write(summary_of(grids, rows) | about, simulated=simulated, manifest=manifest)
        notes = without_motors(config.robot, world.drive)
        duration = runs[0].duration
        with run.watch.stage("report"):
            report = page(grids, rows, duration, config.out, notes, manifest, tests)
            report.write(run.folder, config.pdf)
    print_sweep(grids, rows, duration)
    for test in tests:
        test.table().print()
    for note in notes:
        print(f"Note: {note}.")
    print(stages_text(run.watch.stages))
    if config.bag:
        print(bags_text(config.out, about["bags"]))
    before = f", {resumed} of them before it was stopped" if resumed else ""
    print(f"{config.out / REPORT_FILE}: {counted(len(driven), 'run')} in {run.wall:.1f} s{before}")
