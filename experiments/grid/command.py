"""`trackslip grid`: drive a grid of runs, or what of it isn't driven yet, and sum up."""

from typing import Any

from experiments.common.formats import stages_text
from experiments.common.parts import StoredParts
from experiments.common.results import RUNS_FILE, TABLE_FILE, bags_text, write_bags
from experiments.common.sweep import drive_missing, resumable
from experiments.grid.config import PARTS, Config
from experiments.grid.plan import plan
from experiments.grid.runs import GridRuns
from experiments.grid.summary import all_failed, grids_of, print_sweep, summary_of
from experiments.grid.table import renamed, write_table
from experiments.recorder import record_all
from experiments.simulate.world import World
from trackslip.errors import RunFailedError, counted
from trackslip.logs.logfile import StoredRuns, read_runs
from trackslip.ros.messages import require_rosbags


def run(config: Config) -> None:
    """Drive what is missing, gather, store and print."""
    if config.bag:
        require_rosbags()
    runs = plan(config)
    world = World.of(config)  # before its files can change
    ids = {one.id for one in runs}
    parts = StoredParts(config.out, PARTS)
    with resumable(config, runs, parts, "the same command" + " without --no-resume" * (not config.resume)) as run:
        if config.resume:
            parts.take(ids, force=False)
        else:
            parts.discard(ids)
        taken, began, file = len(parts), run.wall, run.folder / RUNS_FILE
        simulated = sum(one.duration for one in runs if one.id not in parts)
        unfinished = drive_missing(config, runs, parts, GridRuns(config.threads), run.watch, config.executor)
        timing = {"driving_s": run.wall - began, "driven": len(runs) - taken, "taken": taken}
        rows = [renamed(parts[one.id].row, one.name, one.axes) for one in runs]
        driven = [row["run"] for row in rows if row["error"] is None]
        if not driven:
            failure = RunFailedError(all_failed(rows))
            failure.logs = unfinished
            raise failure
        with run.watch.stage("gathering"):
            parts.gather([(one.id, one.name) for one in runs], file)
            if config.rrd:
                record_all(run.folder, [*read_runs(file), *unfinished])
            write_table(rows, list(runs[0].axes), run.folder / TABLE_FILE)
        about: dict[str, Any] = {"timing": timing, "made_by": parts.made_by}
        if config.bag:
            with run.watch.stage("bags"), run.progress("bags", len(driven), "bags") as done:
                about["bags"] = write_bags(run.folder, driven, map(StoredRuns(file).log, driven), done=done)
        grids = grids_of(runs, rows)
        summary = summary_of(grids, runs, rows, lambda: map(StoredRuns(file).log, driven), run.watch)
        run.write(summary | about, simulated=simulated, **world.about)
    print_sweep(grids, rows, runs[0].duration)
    print(stages_text(run.watch.stages))
    if config.bag:
        print(bags_text(config.out, about["bags"]))
    already = f", {taken} of them taken from before" if taken else ""
    print(f"{config.out / RUNS_FILE}: {counted(len(driven), 'run')} in {run.wall:.1f} s{already}")
