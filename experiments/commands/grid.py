"""`trackslip grid`: drive a grid of runs, or what of it isn't driven yet, and sum up."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

from experiments.options.base import Distinct, Excludes, Exclusion, Needs, Whole, default_is
from experiments.options.choices import GROUNDS
from experiments.options.grid import GridConfig
from experiments.options.world import MAX_JOBS
from trackslip.errors import InvalidValueError, counted

EXAMPLES = (
    ("the paper's 25 runs", "trackslip grid"),
    ("six runs of 20 s", "trackslip grid --radii 0.5 1 2 --speeds 0.1 0.2 --duration 20"),
    ("on a gravel slope", "trackslip grid --ground gravel --ground.slope 0.1 --ground.uphill 1.57"),
    ("with a noisier scanner", "trackslip grid --scanner.noise 0.01 --obstacles posts --out out/noisy"),
    ("500 runs", "trackslip grid --grounds stone ice --seeds 0 1 2 3 4 --vary slope=0,0.05"),
    ("over any option", "trackslip grid --vary scanner.noise=0.005,0.02 robot.half_gauge=0.15,0.2"),
    ("on a Dask cluster", "trackslip grid --sweep sweep.toml --executor dask://host:8786"),
)
PARTS = ".grid-parts"
"""Folder in OUT with the runs of a grid that isn't finished."""


@dataclass(frozen=True)
class Config(GridConfig):
    """Drive a grid of runs, radius x speed x any other option, in front of the scanner, and store them.

    An interrupted grid resumes: runs that are already stored in OUT are not driven again.
    """

    grounds: Annotated[tuple[str, ...] | None, Distinct(), default_is("--ground", f"{GROUNDS} ...")] = None
    """Grounds to drive on, by name or .toml file."""
    seeds: Annotated[tuple[int, ...] | None, Distinct(), default_is("--seed", "INT ...")] = None
    """Seeds; every run is driven once with each."""
    vary: Annotated[tuple[str, ...] | None, Distinct(), default_is("nothing", "NAME=VALUE,... ...")] = None
    """Any other options, each with its values: scanner.noise=0.005,0.01 slope=0,0.1 friction_ratio=1,1.2."""
    sweep: Annotated[Path | None, default_is("none", "FILE")] = None
    """A .toml file of lists of values by name: radius, speed, ground, seed, or as for --vary."""
    executor: Annotated[str, default_is("processes", "{processes,inline,dask://HOST:PORT}")] = "processes"
    """Executor of the runs: worker processes, this process, or a Dask cluster."""
    jobs: Annotated[int, Whole(0, MAX_JOBS)] = 0
    """Number of processes, 0 for one per processor."""
    bag: bool = False
    """Also write a ROS 2 bag of each run to OUT/bags."""
    resume: bool = True
    """Keep the runs that OUT already has; --no-resume drives all of them again."""
    force: bool = False
    """Keep runs of OUT even if code, models or libraries have changed since."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Needs(("jobs",), "executor", ("processes",)),
        Excludes(("force",), "resume", (False,)),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.executor not in ("processes", "inline") and not re.fullmatch(r"dask://.+:\d+", self.executor):
            raise InvalidValueError("executor", self.executor, "processes, inline or dask://HOST:PORT")


def run(config: Config) -> None:
    """Drive what is missing, gather, store and print."""
    from experiments.driving.world import World
    from experiments.recording import record_all
    from experiments.report.formats import stages_text
    from experiments.storage.results import RECORDINGS_FOLDER, RUNS_FILE, TABLE_FILE, bags_text, write_bags
    from experiments.sweep.drive import GridRuns
    from experiments.sweep.engine import drive_missing, resumable
    from experiments.sweep.parts import StoredParts
    from experiments.sweep.plan import plan
    from experiments.sweep.summary import all_failed, grids_of, in_full, print_sweep, summary_of
    from experiments.sweep.table import renamed, write_table
    from trackslip.errors import TrackslipError
    from trackslip.logs.logfile import StoredRuns, read_runs
    from trackslip.ros.messages import require_rosbags

    if config.bag:
        require_rosbags()
    runs = plan(config)
    world = World.of(config)  # before its files can change
    ids = {one.id for one in runs}
    parts = StoredParts(config.out, PARTS)
    with resumable(config, runs, parts, "the same command" + " without --no-resume" * (not config.resume)) as run:
        if config.resume:
            parts.take(ids, config.force)
        else:
            parts.discard(ids)
        taken, began, file = len(parts), run.wall, run.folder / RUNS_FILE
        simulated = sum(one.duration for one in runs if one.id not in parts)
        unfinished = drive_missing(config, runs, parts, GridRuns(config.threads), run.watch, config.executor)
        timing = {"driving_s": run.wall - began, "driven": len(runs) - taken, "taken": taken}
        rows = [renamed(parts[one.id].row, one.name, one.axes) for one in runs]
        driven = [row["run"] for row in rows if row["error"] is None]
        failure: dict[str, Any] = {} if driven else {"error": all_failed(rows)}
        if failure and not unfinished:
            raise TrackslipError(failure["error"])
        with run.watch.stage("gathering"):
            parts.gather([(one.id, one.name) for one in runs], file)
            if config.rrd:
                record_all(run.folder, [*(read_runs(file) if driven else ()), *unfinished])
            write_table(rows, list(runs[0].axes), run.folder / TABLE_FILE)
        about: dict[str, Any] = {"timing": timing, "made_by": parts.made_by}
        if config.bag and driven:
            with run.watch.stage("bags"), run.progress("bags", len(driven), "bags") as done:
                about["bags"] = write_bags(run.folder, driven, map(StoredRuns(file).log, driven), done=done)
        grids = grids_of(runs, rows)
        whole = in_full(runs, rows, lambda: map(StoredRuns(file).log, driven), run.watch)
        run.write(summary_of(grids, whole, rows) | about, simulated=simulated, **world.about, **failure)
    if failure:
        raise TrackslipError(f"{failure['error']}; see {config.out / RECORDINGS_FOLDER}")
    print_sweep(grids, rows, runs[0].duration)
    print(stages_text(run.watch.stages))
    if config.bag:
        print(bags_text(config.out, about["bags"]))
    already = f", {taken} of them taken from before" if taken else ""
    print(f"{config.out / RUNS_FILE}: {counted(len(driven), 'run')} in {run.wall:.1f} s{already}")
