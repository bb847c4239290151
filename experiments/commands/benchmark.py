"""`trackslip benchmark`: compare controllers and slip compensations; drive what isn't driven yet, gather, report."""

import textwrap
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from experiments.options.base import Distinct, Excludes, Exclusion, Whole, default_is, refuse_changed
from experiments.options.choices import COMPENSATIONS, CONTROLLERS, GROUND_NAMES, REFERENCES, WITHOUT_LAWS
from experiments.options.world import MAX_JOBS, ClosedLoopOptions
from trackslip.errors import counted

EXAMPLES = (
    ("every controller, tuned, on drawn plants", "trackslip benchmark"),
    ("Sec. IV of the paper", "trackslip benchmark --suite paper"),
    ("two controllers on ice", "trackslip benchmark --controllers linear lqr --grounds ice --seeds 0 1"),
    ("Eq. 31 with another gain", "trackslip benchmark --controllers linear linear:stiffness=160"),
    ("your own controller, tuned by tune", "trackslip benchmark --controllers my:Controller linear --gains out/tune"),
)
PARTS = ".benchmark-parts"
"""Folder in OUT with the runs of a benchmark that isn't finished."""

_EQUIPMENT = tuple(option.name for option in fields(ClosedLoopOptions) if option.name not in ("overwrite", "rrd"))
_OF_SUITES = (
    "suite",
    "references",
    "grounds",
    "starts",
    "seeds",
    "plants",
    *_EQUIPMENT,
)  # what fair's numbers depend on
Start = Literal["zero", "paper", "random"]
_GROUNDS = f"{{{','.join(GROUND_NAMES)},robot,FILE.toml}} ..."
_COMPENSATIONS = default_is("the suite's", f"{COMPENSATIONS} ...")


@dataclass(frozen=True)
class Config(ClosedLoopOptions):
    """Compare controllers, with and without slip compensation, on paths and grounds, and print a leaderboard.

    The --suite chooses the runs; --controllers, --compensations, --references, --grounds, --starts and --seeds replace
    parts of it. An interrupted benchmark resumes when it is run again with the same options.
    """

    suite: Literal["paper", "fair", "full"] = "fair"
    """Runs: Sec. IV of the paper, tuned controllers on drawn plants, or these on all paths and three grounds."""
    controllers: Annotated[tuple[str, ...] | None, Distinct(), default_is("the suite's", f"{CONTROLLERS} ...")] = None
    """Controllers, such as linear or linear:stiffness=160; ppo:FOLDER of train, MODULE:CLASS of your own."""
    compensations: Annotated[tuple[str, ...] | None, Distinct(), _COMPENSATIONS] = None
    """LAW of --laws; online starts from icr_radius, online_cold from no slip, online_load from icr_load in --laws."""
    references: Annotated[tuple[str, ...] | None, Distinct(), default_is("the suite's", f"{REFERENCES} ...")] = None
    """Paths; a .csv file lists waypoints in the columns x, y [m]."""
    grounds: Annotated[tuple[str, ...] | None, Distinct(), default_is("the suite's", _GROUNDS)] = None
    """Grounds; sticky is stone whose friction rises after 20 s, robot is the ground of the --robot file."""
    starts: Annotated[tuple[Start, ...] | None, Distinct(), default_is("the suite's", "{zero,paper,random} ...")] = None
    """Start poses: on the path, beside it as in the paper (0.36 m, 30 deg), or at random (up to 0.15 m, 20 deg)."""
    seeds: Annotated[tuple[int, ...] | None, Distinct(), Whole(), default_is("the suite's", "INT ...")] = None
    """Seeds of plants, random starts and the scanner's noise, the same for all controllers and compensations."""
    plants: Annotated[Literal["nominal", "drawn"] | None, default_is("the suite's", "{nominal,drawn}")] = None
    """Robots: the one that the laws were identified on, or robots, grounds and scanners drawn around it."""
    gains: Annotated[str | None, default_is("the suite's", "{default,tuned,FOLDER}")] = None
    """Gains of the controllers: those of their classes, the tuned ones, or those that tune wrote."""
    submit: Annotated[Path | None, default_is("none", "FILE.json")] = None
    """Also write the rows of the suite fair with the scores of all their runs, for others to drive again."""
    jobs: Annotated[int, Whole(0, MAX_JOBS)] = 0
    """Number of processes, 0 for one per processor; the results don't depend on it."""
    out: Path = Path("out/benchmark")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (Excludes(_OF_SUITES, "submit"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.compensations and set(self.compensations) <= set(WITHOUT_LAWS):
            refuse_changed("laws", self.laws, None, f"with --compensations {' '.join(self.compensations)}")


def run(config: Config) -> None:
    """Drive what is missing, gather, store and print."""
    from experiments.benchmark.cases import SUITES, cases_of, identified
    from experiments.benchmark.drive import ClosedLoops, record_comparisons
    from experiments.benchmark.gains import Gains
    from experiments.benchmark.page import page
    from experiments.benchmark.rows import board, case_row, losses, over_seeds
    from experiments.benchmark.submission import submission
    from experiments.benchmark.table import BOARD_LEGEND, board_table, leaderboard
    from experiments.report.formats import stages_text
    from experiments.storage.manifest import relative
    from experiments.storage.plain_json import plain, write_json
    from experiments.storage.results import LEADERBOARD_FILE, REPORT_FILE, RUNS_FILE, write_output
    from experiments.sweep.engine import drive_missing, resumable
    from experiments.sweep.parts import StoredParts
    from sim.stopwatch import Stopwatch

    suite = SUITES[config.suite]
    gains = Gains.load(config.gains or suite.gains)
    loops = ClosedLoops(config, config.plants or suite.plants, gains, (config.seeds or (0,))[0])
    named, notes = cases_of(config)
    loops.check(named)
    cases = identified(named, loops)
    parts = StoredParts(config.out, PARTS)
    with resumable(config, cases, parts) as run:
        parts.take_current({case.id for case in cases})
        with run.watch.stage("driving"):
            unfinished = drive_missing(config, cases, parts, loops, Stopwatch())
        with run.watch.stage("gathering"):
            runs = [parts[case.id].row for case in cases]
            rows = over_seeds(runs)
            entries, lost = board(runs), [*losses(rows), *notes]
            parts.gather([(case.id, case.name) for case in cases], run.folder / RUNS_FILE)
        if config.rrd:
            with run.watch.stage("recordings"):
                record_comparisons(run.folder, cases, unfinished)
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
