"""The command: drive what isn't driven yet, gather, report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from experiments.benchmark.group import groups
from experiments.benchmark.jobs import work_off
from experiments.benchmark.setup import Setup, without_missing
from experiments.benchmark.table import (
    BOARD_HEADER,
    WHOLE_HEADER,
    Row,
    board,
    board_text,
    losses,
    markdown,
    over_seeds,
    whole_text,
)
from experiments.driving.lookup import reference
from experiments.options.benchmark import BenchmarkConfig, Case
from experiments.parallel.executors import WorkersFailedError
from experiments.recording import record_all
from experiments.report.benchmark import render
from experiments.report.formats import stages_text
from experiments.report.terminal import print_table, progress
from experiments.storage.benchmark_parts import Parts, complete, names_of, rows_of, runs_of
from experiments.storage.manifest import command_line
from experiments.storage.plain_json import plain, write_json
from experiments.storage.results import (
    LEADERBOARD_FILE,
    MANIFEST_FILE,
    REPORT_FILE,
    RUNS_FILE,
    SUMMARY_FILE,
    results_folder,
)
from sim.stopwatch import Stopwatch
from trackslip.logs import logfile
from trackslip.logs.logjoin import join_parquet
from trackslip.logs.runlog import RunLog


def run(config: BenchmarkConfig) -> None:
    """Drive, gather, store and print."""
    began = time.perf_counter()
    watch = Stopwatch()
    with results_folder(config.out) as folder:
        setup = Setup.of(config)
        cases, notes = without_missing(config)
        setup.check(cases)
        parts = Parts.of(setup)
        parts.discard_useless()
        paths = [parts.path(group) for group in groups(cases)]
        try:
            with watch.stage("driving"):
                _drive(setup, dict(zip(paths, groups(cases), strict=True)))
        except (KeyboardInterrupt, WorkersFailedError) as stop:
            done, said = sum(complete(path) for path in paths), str(stop) or "interrupted"
            raise type(stop)(
                f"{said} with {done} of {len(paths)} fleets driven; the same command goes on from there"
            ) from None
        finally:
            parts.discard_useless()
        with watch.stage("gathering"):
            runs = [row for path in paths for row in rows_of(path)]
            rows = over_seeds(runs)
            entries, lost = board(rows), [*losses(rows), *notes]
            _gather(paths, folder / RUNS_FILE)
        if config.rrd:
            with watch.stage("recordings"):
                _record(folder, cases)
        about = setup.world.manifest("benchmark", time.perf_counter() - began) | {
            "config": plain(config),
            "ground": {name: plain(setup.ground(name)) for name in dict.fromkeys(row["ground"] for row in rows)},
            "seed": sorted({run["seed"] for run in runs}),
        }
        with watch.stage("report"):
            (folder / LEADERBOARD_FILE).write_text(_markdown(entries, lost, rows), encoding="utf-8")
            page = render(folder / RUNS_FILE, entries, lost, rows, runs, about, command_line("benchmark"))
            page.write(folder, config.pdf)
        wall = time.perf_counter() - began
        timing = {"wall_s": wall, "stages": watch.stages}
        driven = [{key: value for key, value in run.items() if key != "compute_ms"} for run in runs]
        summary = {
            "rows": rows,
            "cases": driven,
            "failures": _failures(runs),
            "runs": len(runs),
            "wall_s": wall,
            "timing": timing,
        }
        write_json(folder / SUMMARY_FILE, summary)
        write_json(folder / MANIFEST_FILE, about)
    parts.discard(paths)
    print_table("Position errors, means over references, grounds and seeds", BOARD_HEADER, board_text(entries))
    for line in lost:
        print(line)
    for failure in _failures(runs):
        print(f"failed: {failure['run']}: {failure['error']}")
    print(stages_text(watch.stages))
    print(f"{config.out / REPORT_FILE}: {len(runs)} runs in {wall:.1f} s; all {len(rows)} rows in {LEADERBOARD_FILE}")


def _drive(setup: Setup, wanted: dict[Path, tuple[Case, ...]]) -> None:
    """Make the parts that aren't there yet."""
    missing = {path: group for path, group in wanted.items() if not complete(path)}
    total = sum(map(_seconds, wanted.values()))
    done = total - sum(map(_seconds, missing.values()))
    with progress(f"{sum(map(len, wanted.values()))} runs", total, done=done) as report:
        for path in work_off(setup.config, missing):
            report(_seconds(missing[path]))


def _gather(paths: Sequence[Path], file: Path) -> None:
    """The runs of all parts, if there are any, as one file."""
    if driven := [(runs_of(path), name, name) for path in paths for name in names_of(path)]:
        join_parquet(driven, file)


def _record(folder: Path, cases: Sequence[Case]) -> None:
    """A comparison a reference, ground and start: all controllers and compensations with the first seed."""
    if not (folder / RUNS_FILE).exists():
        return
    logs = {log.run: log for log in logfile.read_runs(folder / RUNS_FILE)}
    compared: dict[str, list[RunLog]] = {}
    for case in cases:
        if case.seed == cases[0].seed and case.run in logs:
            name = f"{Path(case.reference).stem} {Path(case.ground).stem} {case.start} seed {case.seed}"
            compared.setdefault(name, []).append(logs[case.run])
    record_all(folder, [], compared)


def _seconds(group: Sequence[Case]) -> float:
    """Driven in a group's runs together [s]."""
    return len(group) * reference(group[0].reference).duration


def _failures(runs: Sequence[Row]) -> list[dict[str, Any]]:
    return [
        {"run": Case(*(run[f.name] for f in fields(Case))).run, "error": run["error"]} for run in runs if run["error"]
    ]


def _markdown(entries: Sequence[Row], lost: Sequence[str], rows: Sequence[Row]) -> str:
    """The leaderboard as a file."""
    return "\n".join(
        [
            "# Leaderboard",
            "",
            "Position errors are distances of the true position from where the reference is at the time; means over"
            " references, grounds and seeds. Kept: share of the runs that stayed within 0.5 m.",
            "",
            markdown(BOARD_HEADER, board_text(entries)),
            *([] if not lost else ["## Where the path is lost", "", *(f"- {line}" for line in lost), ""]),
            "## All rows",
            "",
            "Means over seeds [95 % bootstrap interval].",
            "",
            markdown(WHOLE_HEADER, whole_text(rows)),
        ]
    )
