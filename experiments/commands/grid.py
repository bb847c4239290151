"""The command: drive what isn't driven yet, gather, sum up."""

from __future__ import annotations

import functools
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.driving.world import World
from experiments.options.grid import SweepConfig
from experiments.parallel.executors import WorkersFailedError, processors, workers
from experiments.recording import record_all
from experiments.report.formats import stages_text
from experiments.report.terminal import progress
from experiments.storage.plain_json import write_json
from experiments.storage.results import MANIFEST_FILE, RUNS_FILE, SUMMARY_FILE, TABLE_FILE, arrow_errors, results_folder
from experiments.storage.sweep_parts import Archive
from experiments.sweep import summary
from experiments.sweep.drive import drive
from experiments.sweep.plan import Run, fleets, plan
from experiments.sweep.table import write_table
from sim.stopwatch import Stopwatch
from trackslip.errors import OutputError, TrackslipError
from trackslip.logs import logfile


def run(config: SweepConfig) -> None:
    """Drive, gather, store and print."""
    began = time.perf_counter()
    watch = Stopwatch()
    runs = plan(config)
    world = World.of(config)  # before its files can change
    there = Archive(config.out)
    try:
        with results_folder(config.out, then=there.discard) as folder:
            found = _drive_and_gather(config, runs, there, folder, watch)
            wall = found["timing"]["wall_s"] = time.perf_counter() - began
            write_json(folder / SUMMARY_FILE, found)
            write_json(folder / MANIFEST_FILE, world.manifest("grid", wall))
    except (KeyboardInterrupt, WorkersFailedError, OutputError) as stop:
        raise type(stop)(_how_to_go_on(stop, config, len(runs), len(runs) - len(there.missing(runs)))) from None
    summary.print_out(config, runs, found)
    print(stages_text(watch.stages))
    taken = found["timing"]["taken"]
    already = f", {taken} of them taken from before" if taken else ""
    print(f"{config.out / RUNS_FILE}: {len(runs) - len(found['failures'])} runs in {wall:.1f} s{already}")


def _drive_and_gather(
    config: SweepConfig, runs: Sequence[Run], there: Archive, folder: Path, watch: Stopwatch
) -> dict[str, Any]:
    """Files of runs and rows in `folder`; the summary."""
    if config.resume:
        there.take(runs, config.force)
    else:
        there.discard()
    missing = there.missing(runs)
    driving = time.perf_counter()
    watch.stages |= _drive(config, there, runs, missing)
    driving = time.perf_counter() - driving
    rows, made_by = there.rows(runs)
    failures = [row for row in rows if row["error"] is not None]
    if len(failures) == len(rows):
        raise TrackslipError(_all_failed(failures))
    with watch.stage("gathering"):
        there.gather(runs, folder / RUNS_FILE)
        if config.rrd:
            record_all(folder, logfile.read_runs(folder / RUNS_FILE))
        with arrow_errors(folder / TABLE_FILE):
            write_table(rows, list(runs[0].axes), folder / TABLE_FILE)
    return summary.of(config, runs, rows, lambda: logfile.read_runs(folder / RUNS_FILE), watch) | {
        "runs": rows,
        "made_by": made_by,
        "failures": [{"run": row["run"], "error": row["error"]} for row in failures],
        "timing": {
            "simulated_s": sum(one.config.duration for one in missing),
            "driving_s": driving,
            "stages": watch.stages,
            "driven": len(missing),
            "taken": len(runs) - len(missing),
        },
    }


def _drive(config: SweepConfig, there: Archive, runs: Sequence[Run], missing: Sequence[Run]) -> dict[str, float]:
    """Drive what is missing and keep it, part by part; seconds of work by stage, all workers together."""
    if not missing:
        return {}
    stages: dict[str, float] = {}
    jobs = config.jobs or processors()
    jobs = min(jobs, len(fleets(missing, jobs)))
    total, left = (sum(one.config.duration for one in some) for some in (runs, missing))
    with (
        progress(f"{len(runs)} runs, scans and poses", total, done=total - left) as report,
        workers(config.executor, jobs) as pool,
    ):
        task = functools.partial(drive, threads=config.threads, report=report) if pool.inline else drive
        for part in pool.each(task, fleets(missing, pool.count)):
            there.keep(part)
            if not pool.inline:
                report(part.duration)
            for name, seconds in part.stages.items():
                stages[name] = stages.get(name, 0.0) + seconds
    return stages


def _how_to_go_on(stop: BaseException, config: SweepConfig, runs: int, driven: int) -> str:
    """What to say when the command is stopped: as it is said of `stop`, and what is kept."""
    said = str(stop) or "interrupted"
    if driven == 0:
        return said
    same = "the same command" if config.resume else "the same command without --no-resume"
    return f"{said} with {driven} of {runs} runs driven; {same} goes on from there"


def _all_failed(failures: Sequence[dict[str, Any]]) -> str:
    """What to say when there is no run."""
    first = failures[0]
    if len(failures) == 1:
        return str(first["error"])
    return f"all {len(failures)} runs fail, the first, {first['run']!r}: {first['error']}"
