"""`trackslip benchmark`: compare controllers and slip compensations; drive what isn't driven yet, gather, report."""

import textwrap

from experiments.benchmark.cases import SUITES, cases_of, identified
from experiments.benchmark.config import Config
from experiments.benchmark.drive import ClosedLoops, record_comparisons
from experiments.benchmark.gains import Gains
from experiments.benchmark.page import page
from experiments.benchmark.rows import board, case_row, losses, over_seeds
from experiments.benchmark.submission import submission
from experiments.benchmark.table import BOARD_LEGEND, board_table, leaderboard
from experiments.common.formats import stages_text
from experiments.common.manifest import relative
from experiments.common.plain_json import plain, write_json
from experiments.common.results import LEADERBOARD_FILE, REPORT_FILE, RUNS_FILE, write_output
from experiments.common.sweep import drive_missing, resumable
from sim.stopwatch import Stopwatch
from trackslip.errors import counted


def run(config: Config) -> None:
    """Drive what is missing, gather, store and print."""
    suite = SUITES[config.suite]
    gains = Gains.load(config.gains or suite.gains)
    loops = ClosedLoops(config, config.plants or suite.plants, gains, (config.seeds or (0,))[0])
    named, notes = cases_of(config)
    loops.check(named)
    cases = identified(named, loops)
    with resumable(config, {case.id for case in cases}) as (run, store):
        with run.watch.stage("driving"):
            drive_missing(cases, store, loops, Stopwatch(), config.jobs)
        with run.watch.stage("gathering"):
            runs = [store.rows[case.id] for case in cases]
            rows = over_seeds(runs)
            entries, lost = board(runs), [*losses(rows), *notes]
            store.gather(cases, run.folder / RUNS_FILE)
        if config.rrd:
            with run.watch.stage("recordings"):
                record_comparisons(run.folder, cases)
        grounds = {relative(name): plain(loops.ground(name)) for name in dict.fromkeys(case.ground for case in cases)}
        seeds = sorted({case.seed for case in cases})
        about = run.manifest(**loops.world.about | {"ground": grounds, "seed": seeds})
        driven = [case for case, row in zip(cases, runs, strict=True) if row["error"] is None]
        with run.watch.stage("report"):
            (run.folder / LEADERBOARD_FILE).write_text(leaderboard(entries, lost, rows, about), encoding="utf-8")
            page(run.folder / RUNS_FILE, entries, lost, rows, driven, about).write(run.folder, config.pdf)
        failures = [{"run": row["run"], "error": row["error"]} for row in runs if row["error"] is not None]
        summary = {"board": entries, "rows": rows, "cases": [case_row(one) for one in runs], "failures": failures}
        run.write(summary | {"runs": len(runs), "wall_s": run.wall}, manifest=about)
        if config.submit is not None:
            rows_of_board = submission(runs, entries, gains, about)
            write_output(config.submit, lambda draft: write_json(draft, rows_of_board))
    board_table(entries).print()
    print(textwrap.fill(BOARD_LEGEND, 120))
    for line in [*lost, *(f"failed: {failure['run']}: {failure['error']}" for failure in failures)]:
        print(line)
    print(stages_text(run.watch.stages))
    told = f"{counted(len(runs), 'run')} in {run.wall:.1f} s; {counted(len(rows), 'row')} in {LEADERBOARD_FILE}"
    print(f"{config.out / REPORT_FILE}: {told}")
