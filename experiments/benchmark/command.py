"""`trackslip benchmark`: drive the missing runs, and compare controllers and slip compensations in
all runs.
"""

import shlex
import textwrap
from pathlib import Path

from experiments.benchmark.cases import SUITES, planned_cases
from experiments.benchmark.config import Config
from experiments.benchmark.drive import ClosedLoops
from experiments.benchmark.gains import Gains
from experiments.benchmark.page import BOARD_LEGEND, answer, board_table, page
from experiments.benchmark.rows import board, over_seeds, score, step_times
from experiments.common.choices import SHIPPED
from experiments.common.paths import is_file
from experiments.common.plain_json import plain
from experiments.common.results import REPORT_FILE, RUNS_FILE
from experiments.common.sweep import STEPS, Row, drive_missing, resumable
from experiments.common.table import stages_text
from experiments.simulate.motors import print_motors
from experiments.simulate.paths import PathSummary
from sim.runs.stopwatch import Stopwatch
from trackslip.errors import counted


def run(config: Config) -> None:
    """Drive the missing runs, and store, report and print all results."""
    suite = SUITES[config.suite]
    gains = Gains.load(config.gains or suite.gains)
    loops = ClosedLoops(config, config.plants or suite.plants, gains)
    world = loops.world
    plan = config.plan(world.robot.geometry.half_gauge, world.drive.top_speed)
    planned = planned_cases(config, plan)
    config.require_file(tuple(case.reference for case in planned), world.drive.top_speed)
    loops.check(planned)
    cases = loops.identified(planned)
    with resumable(config, {case.id for case in cases}) as (run, store):
        with run.watch.stage("driving"):
            drive_missing(cases, store, loops, Stopwatch(), config.jobs)
        store.gather(cases, run.folder / RUNS_FILE)
        runs = [store.rows[case.id] for case in cases]
        rows = over_seeds(runs)
        entries = board(runs)
        for entry in entries:
            entry |= gains.choice(entry["controller"], entry["compensation"])._asdict()
        failures = [
            {"run": row["run"], "error": row["error"]} for row in runs if row["error"] is not None
        ]
        grounds = {
            name: plain(loops.ground(name)) for name in dict.fromkeys(case.ground for case in cases)
        }
        seeds = sorted({case.seed for case in cases})
        files = {Path(name).name: digest for name, digest in loops.files(cases).items() if digest}
        about = run.manifest(
            **loops.world.about | {"ground": grounds, "seed": seeds, "files": files}
        )
        steps = step_times(runs)
        best = answer(
            entries, _track_command(config, gains, entries[0]), steps, config.scanner.period
        )
        lines = [f"{failure['run']}: {failure['error']}" for failure in failures]
        with run.watch.stage("report"):
            page(best, entries, rows, lines, steps, about).write(run.folder, config.pdf)
        # times differ each time that a run is driven, so they are kept apart
        scored = [
            {key: value for key, value in row.items() if key != STEPS} | {"score": score(row)}
            for row in runs
        ]
        summary = {
            "board": entries,
            "rows": rows,
            "cases": scored,
            "failures": failures,
            "runs": len(runs),
        }
        paths = [
            PathSummary.of(name, plan.path(name), plan.limits)
            for name in dict.fromkeys(case.reference for case in cases)
        ]
        summary["paths"] = paths
        summary["timing"] = {
            "step_s": {name: times.median for name, times in steps.items()},
            "p99_step_s": {name: times.p99 for name, times in steps.items()},
            "worst_step_s": {name: times.worst for name, times in steps.items()},
        }
        run.write(summary, manifest=about)
    print(f"{best.heading}.")
    for line in [*best.lines, *(f"Warning: {warning}." for warning in best.warnings)]:
        print(line)
    print()
    board_table(entries).print()
    for path in paths:
        if is_file(path.name):
            print(path)
        for warning in path.warnings(plan):
            print(f"Warning: {warning}.")
    print(textwrap.fill(BOARD_LEGEND, 120))
    print_motors(config.robot, loops.world.drive)
    for line in lines:
        print(f"failed: {line}")
    print(stages_text(run.watch.stages))
    print(f"{config.out / REPORT_FILE}: {counted(len(runs), 'run')} in {run.wall:.1f} s")


def _track_command(config: Config, gains: Gains, best: Row) -> str:
    """The command that drives and records the best entry on the paper's path."""
    controller = gains.specification(best["controller"], best["compensation"])
    words = [
        "trackslip",
        "track",
        "--controller",
        controller,
        "--compensation",
        best["compensation"],
        "--rrd",
    ]
    words += ["--laws", str(config.laws)] if config.laws else []
    words += ["--robot", config.robot] if config.robot != SHIPPED else []
    return shlex.join(words)
