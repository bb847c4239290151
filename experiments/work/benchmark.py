"""`trackslip benchmark`: drive what isn't driven yet, gather, report."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from experiments.benchmark.jobs import drive_groups, ids, seconds
from experiments.benchmark.page import render
from experiments.benchmark.rows import CaseRow, board, losses, over_seeds
from experiments.benchmark.setup import Setup, without_missing
from experiments.benchmark.table import BOARD_HEADER, board_text, leaderboard
from experiments.options.benchmark import BenchmarkConfig, Case
from experiments.parallel.executors import WorkersFailedError
from experiments.recording import record_all
from experiments.report.formats import stages_text
from experiments.report.terminal import print_table, progress
from experiments.storage.manifest import command_line, relative
from experiments.storage.plain_json import plain
from experiments.storage.results import LEADERBOARD_FILE, REPORT_FILE, RUNS_FILE, results_folder, write_results
from experiments.sweep.parts import Parts
from sim.stopwatch import Stopwatch
from trackslip.logs.logfile import read_runs
from trackslip.logs.runlog import RunLog

PARTS = ".benchmark-parts"


def run(config: BenchmarkConfig) -> None:
    """Drive, gather, store and print."""
    began = time.perf_counter()
    watch = Stopwatch()
    parts = Parts(config.out, PARTS)
    wanted: dict[Case, str] = {}
    with results_folder(config.out, then=lambda: parts.discard({*wanted.values()})) as folder:
        setup = Setup.of(config)
        cases, notes = without_missing(config)
        setup.check(cases)
        wanted |= ids(setup, cases)
        parts.take_current({*wanted.values()})
        try:
            with watch.stage("driving"):
                unfinished = _drive(config, parts, wanted)
        except (KeyboardInterrupt, WorkersFailedError) as stop:
            raise _resumable(stop, sum(id in parts for id in wanted.values()), len(wanted)) from None
        with watch.stage("gathering"):
            runs = [CaseRow.from_part(parts[id].row) for id in wanted.values()]
            rows = over_seeds(runs)
            entries, lost = board(rows), [*losses(rows), *notes]
            parts.gather([(id, case.run) for case, id in wanted.items()], folder / RUNS_FILE)
        if config.rrd:
            with watch.stage("recordings"):
                _record(folder, cases, unfinished)
        grounds = dict.fromkeys(case.ground for case in cases)
        about = setup.world.manifest("benchmark", time.perf_counter() - began, config) | {
            "ground": {relative(name): plain(setup.ground(name)) for name in grounds},
            "seed": sorted({case.seed for case in cases}),
        }
        with watch.stage("report"):
            (folder / LEADERBOARD_FILE).write_text(leaderboard(entries, lost, rows), encoding="utf-8")
            page = render(folder / RUNS_FILE, entries, lost, rows, runs, about, command_line("benchmark"))
            page.write(folder, config.pdf)
        wall = time.perf_counter() - began
        failures = [run for run in runs if run.error is not None]
        summary = {
            "rows": [row.to_json() for row in rows],
            "cases": [run.to_json() for run in runs],
            "failures": [{"run": run.case.run, "error": run.error} for run in failures],
        }
        timing = {"runs": len(runs), "wall_s": wall, "timing": {"wall_s": wall, "stages": watch.stages}}
        write_results(folder, summary | timing, about)
    print_table("Position errors, means over references, grounds and seeds", BOARD_HEADER, board_text(entries))
    for line in lost:
        print(line)
    for failure in failures:
        print(f"failed: {failure.case.run}: {failure.error}")
    print(stages_text(watch.stages))
    print(f"{config.out / REPORT_FILE}: {len(runs)} runs in {wall:.1f} s; all {len(rows)} rows in {LEADERBOARD_FILE}")


def _drive(config: BenchmarkConfig, parts: Parts, wanted: Mapping[Case, str]) -> list[RunLog]:
    """Drive and keep the runs that aren't there yet; returns what was recorded of runs that failed."""
    unfinished = []
    missing = {case: id for case, id in wanted.items() if id not in parts}
    total = seconds(list(wanted))
    with progress(f"{len(wanted)} runs", total, done=total - seconds(list(missing))) as report:
        for group in drive_groups(config, missing) if missing else ():
            parts.keep(group.part)
            unfinished += group.unfinished
            report(group.duration)
    return unfinished


def _record(folder: Path, cases: Sequence[Case], unfinished: Sequence[RunLog]) -> None:
    """For each reference, ground and start, compare all controllers and compensations with the first seed.

    Runs that failed are recorded on their own, as far as they went.
    """
    logs = {log.run: log for log in read_runs(folder / RUNS_FILE)} if (folder / RUNS_FILE).exists() else {}
    compared: dict[str, list[RunLog]] = {}
    for case in cases:
        if case.seed == cases[0].seed and case.run in logs:
            name = f"{Path(case.reference).stem} {Path(case.ground).stem} {case.start} seed {case.seed}"
            compared.setdefault(name, []).append(logs[case.run])
    order = [case.run for case in cases]
    record_all(folder, sorted(unfinished, key=lambda log: order.index(log.run)), compared)


def _resumable(stop: BaseException, driven: int, runs: int) -> BaseException:
    said = str(stop) or "interrupted"
    return type(stop)(f"{said} with {driven} of {runs} runs driven; the same command resumes" if driven else said)
