"""`trackslip grid`: drive what isn't driven yet, gather, sum up."""

import functools
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from experiments.driving.world import World
from experiments.options.grid import SweepConfig
from experiments.parallel.executors import WorkersFailedError, workers
from experiments.parallel.workers import processors
from experiments.recording import record_all
from experiments.report.formats import stages_text
from experiments.report.terminal import progress
from experiments.storage.bags import bags_text, write_bags
from experiments.storage.parts import Parts, resumable
from experiments.storage.results import (
    RECORDINGS_FOLDER,
    RUNS_FILE,
    TABLE_FILE,
    arrow_errors,
    results_folder,
    write_results,
)
from experiments.sweep.drive import drive
from experiments.sweep.plan import Run, fleets, plan
from experiments.sweep.rows import RunRow, is_row
from experiments.sweep.summary import SweepSummary, Timing, grids_of, numbers_in_full, print_out, warnings_of
from experiments.sweep.table import write_table
from sim.stopwatch import Stopwatch
from trackslip.errors import OutputError, TrackslipError
from trackslip.logs.logfile import StoredRuns, read_runs
from trackslip.logs.runlog import RunLog
from trackslip.ros.decode import require_rosbags

PARTS = ".grid-parts"


def run(config: SweepConfig) -> None:
    """Drive, gather, store and print."""
    summary = drive_and_store(config)
    timing = summary.timing
    print_out(config, summary)
    print(stages_text(timing.stages))
    if config.bag:
        print(bags_text(config.out, summary.bags))
    already = f", {timing.taken} of them taken from before" if timing.taken else ""
    driven = len(summary.runs) - len(summary.failures)
    print(f"{config.out / RUNS_FILE}: {driven} runs in {timing.wall_s:.1f} s{already}")


def drive_and_store(config: SweepConfig) -> SweepSummary:
    """Drive what isn't driven yet, and store everything."""
    began = time.perf_counter()
    if config.bag:
        require_rosbags()
    runs = plan(config)
    world = World.of(config)  # before its files can change
    parts = Parts(config.out, PARTS, is_row)
    try:
        with results_folder(config.out, then=parts.discard) as folder:
            summary = _drive_and_gather(config, runs, parts, folder)
            wall = time.perf_counter() - began
            summary = replace(summary, timing=replace(summary.timing, wall_s=wall))
            failed = len(summary.failures) == len(runs)
            manifest = world.manifest("grid", wall) | ({"error": _all_failed(summary.failures)} if failed else {})
            write_results(folder, summary.to_json(), manifest)
    except (KeyboardInterrupt, WorkersFailedError, OutputError) as stop:
        same = "the same command" if config.resume else "the same command without --no-resume"
        raise resumable(stop, sum(run.id in parts for run in runs), len(runs), same) from None
    if failed:
        raise TrackslipError(f"{_all_failed(summary.failures)}; see {config.out / RECORDINGS_FOLDER}")
    return summary


def _drive_and_gather(config: SweepConfig, runs: Sequence[Run], parts: Parts, folder: Path) -> SweepSummary:
    """Logs and rows of all runs in `folder`, and their summary."""
    watch = Stopwatch()
    if config.resume:
        parts.take({run.id for run in runs}, config.force)
    else:
        parts.discard()
    missing = [run for run in runs if run.id not in parts]
    began = time.perf_counter()
    unfinished = _drive(config, parts, runs, missing, watch) if missing else []
    driving = time.perf_counter() - began
    stored = [parts[run.id] for run in runs]
    rows = [_row_of(run, RunRow.from_json(one.row)) for run, one in zip(runs, stored, strict=True)]
    failures = [row for row in rows if row.error is not None]
    if len(failures) == len(rows) and not unfinished:
        raise TrackslipError(_all_failed(failures))
    file = folder / RUNS_FILE
    with watch.stage("gathering"):
        parts.gather([(run.id, run.name) for run in runs], file)
        if config.rrd:
            record_all(folder, [*(read_runs(file) if file.exists() else ()), *unfinished])
        with arrow_errors(folder / TABLE_FILE):
            write_table(rows, list(runs[0].axes), folder / TABLE_FILE)
    bags = {}
    if config.bag and file.exists():
        names = [row.run for row in rows if row.error is None]
        with watch.stage("bags"), progress("bags", len(names), "bags") as done:
            bags = write_bags(folder, names, _logs(file, rows), done=done)
    in_full = numbers_in_full(config, runs, rows, lambda: _logs(file, rows), watch)
    made_by = {one.row["made_by"]: one.made_by for one in sorted(stored, key=lambda one: one.row["made_by"])}
    simulated = sum(one.setting.config.duration for one in missing)
    timing = Timing(simulated, driving, watch.stages, len(missing), len(runs) - len(missing), wall_s=0.0)
    return SweepSummary(grids_of(runs, rows), warnings_of(rows), in_full, rows, made_by, timing, bags)


def _drive(
    config: SweepConfig, parts: Parts, runs: Sequence[Run], missing: Sequence[Run], watch: Stopwatch
) -> list[RunLog]:
    """Drive what is missing and keep it, part by part; `watch` takes the work of all workers together.

    Returns what was recorded of runs that failed, until they did.
    """
    unfinished: list[RunLog] = []
    jobs = config.jobs or processors()
    jobs = min(jobs, len(fleets(missing, jobs)))
    total, left = (sum(one.setting.config.duration for one in some) for some in (runs, missing))
    with (
        progress(f"{len(runs)} runs, scans and poses", total, done=total - left) as report,
        workers(config.executor, jobs) as pool,
    ):
        task = functools.partial(drive, threads=config.threads or 1)
        if pool.inline:
            task = functools.partial(drive, threads=config.threads, report=report)
        for fleet in pool.each(task, fleets(missing, pool.count)):
            parts.keep(fleet.part)
            if not pool.inline:
                report(fleet.duration)
            unfinished += fleet.unfinished
            for name, seconds in fleet.stages.items():
                watch.stages[name] = watch.stages.get(name, 0.0) + seconds
    return unfinished


def _logs(file: Path, rows: Sequence[RunRow]) -> Iterator[RunLog]:
    """The logs of the runs that did not fail, one by one."""
    stored = StoredRuns(file)
    return (stored.log(row.run) for row in rows if row.error is None)


def _row_of(run: Run, row: RunRow) -> RunRow:
    """A row that may have been stored under the name that the run has in another sweep; its note uses that name."""
    note = row.note and row.note.replace(repr(row.run), repr(run.name))
    return replace(row, run=run.name, axes=run.axes, note=note)


def _all_failed(failures: Sequence[RunRow]) -> str:
    """What to say if there is no run."""
    first, *others = failures
    return f"all {len(failures)} runs fail, the first, {first.run!r}: {first.error}" if others else str(first.error)
