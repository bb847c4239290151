"""`trackslip validate`: compare the simulator with theory."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from experiments.options.base import Excludes, Exclusion
from experiments.options.help import default_is
from experiments.options.world import Repeatable

if TYPE_CHECKING:
    from experiments.measuring.check import Check
    from experiments.report.page import Page
    from experiments.report.table import Table
    from experiments.run import Run

EXAMPLES = (
    ("the shipped robot", "trackslip validate"),
    ("a calibrated robot", "trackslip validate --robot out/calibrate/robot.toml"),
    ("tracks on terrain", "trackslip validate --terrain"),
    ("ground that shears", "trackslip validate --shear"),
)


@dataclass(frozen=True)
class Config(Repeatable):
    """Compare the simulator with theory: turning, loads, slopes, time step, solver, energy.

    With --terrain it is tracks made with sim.tracks, on a box and the rescue robot: turning, climbing, tipping over,
    stairs, rough ground.
    """

    robot: Annotated[Path | None, default_is("the shipped robot", "FILE")] = None
    """Robot file as written by calibrate; with --terrain, a tracked robot's instead of the box and the rescue robot."""
    terrain: bool = False
    """Instead compare tracks on terrain with theory, and check their bounds."""
    shear: bool = False
    """Instead compare ground that shears with theory, under two robots or --robot, and check its bounds."""
    rrd: bool = False
    """Also record the robot turning at the paper's radii, for the rerun viewer, in OUT/recordings."""
    out: Path = Path("out/validate")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Excludes(("shear", "rrd"), "terrain"),
        Excludes(("rrd",), "shear"),
    )


def run(config: Config) -> None:
    """Measure robots, tracks on terrain, or ground that shears; store and print what was found and what has to hold."""
    from experiments.driving.grid_runs import sample_runs
    from experiments.recording import record_all
    from experiments.run import Run
    from experiments.storage.manifest import command_line
    from experiments.storage.results import REPORT_FILE

    suite = _terrain if config.terrain else _shear if config.shear else _robot
    with Run(config) as run:
        found = suite(config, run)
        manifest = run.manifest(seed=config.seed, **found.about)
        with run.busy("report"):
            found.page(manifest, command_line("validate")).write(run.folder, config.pdf)
        checks = {"checks": [check.to_json() for check in found.checks]} if found.checks else {}
        run.write({**checks, **found.summary}, manifest=manifest)
        if config.rrd:
            with run.busy("recordings"):
                record_all(run.folder, sample_runs(config.robot, config))
    for table in found.tables:
        table.print()
    if found.checks:
        print(f"{sum(check.holds for check in found.checks)} of {len(found.checks)} checks hold")
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")


@dataclass(frozen=True)
class _Found:
    """What a suite has found."""

    summary: Mapping[str, Any]
    page: Callable[[Mapping[str, Any], str], Page]
    """Makes the page from the manifest and the command line."""
    tables: Sequence[Table]
    """What is printed."""
    checks: Sequence[Check] = ()
    about: Mapping[str, Any] = field(default_factory=dict)
    """More of the manifest."""


def _robot(config: Config, run: Run) -> _Found:
    """Compare a robot on Coulomb ground with theory."""
    from experiments.report.validation import page, table_of
    from experiments.storage.plain_json import plain
    from experiments.validation.results import ValidationSummary, measure
    from sim.ground.ground import Ground
    from sim.robot.parameters import load_robot_file
    from sim.robot.robot import load_robot

    parameters, ground = load_robot_file(config.robot)
    ground = Ground(ground.along, ground.across)  # theory knows no slopes, patches or changes
    found = measure(parameters, ground, config.seed, config.threads, run.watch, run.progress)
    summary = ValidationSummary.of(found)
    return _Found(
        plain(summary),
        lambda manifest, command: page(found, summary, manifest, command),
        [table_of(found, summary)],
        about={"robot": parameters, "ground": ground, "model_sha256": load_robot(parameters=parameters).digest},
    )


def _terrain(config: Config, run: Run) -> _Found:
    """Measure tracks on terrain."""
    from experiments.report.terrain import checks_table, default_table, page
    from experiments.validation.terrain.bounds import BOUNDS, checks_of
    from experiments.validation.terrain.findings import STAGES, TerrainValidation, by_default, measure, summary_of
    from experiments.validation.terrain.subjects import subjects

    robots = subjects(config.robot)
    with (
        run.watch.stage("terrain"),
        run.progress("tracks on terrain", len(robots) * (len(BOUNDS) * STAGES + 1), "stages") as done,
    ):
        findings = [measure(one, preset, config.seed, config.threads, done) for one in robots for preset in BOUNDS]
        naive = []
        for one in robots:
            naive.append(by_default(one, config.threads))
            done(1.0)
    found = TerrainValidation(tuple(findings), tuple(naive))
    checks = [check for one in findings for check in checks_of(one)]
    tables = [checks_table(found, checks), default_table(found)]
    return _Found(summary_of(found), lambda manifest, command: page(found, checks, manifest, command), tables, checks)


def _shear(config: Config, run: Run) -> _Found:
    """Measure robots on ground that shears."""
    from experiments.report.checks import checks_table
    from experiments.report.shear import TITLE, page
    from experiments.validation.shear.findings import STAGES, checks_of, measure, subjects, summary_of
    from sim.ground.ground import Ground
    from sim.robot.parameters import load_robot_file

    parameters, ground = load_robot_file(config.robot)
    robots = subjects(parameters, config.robot is not None)
    ground = Ground(ground.along, ground.across)
    with run.watch.stage("shear"), run.progress("ground that shears", len(robots) * STAGES, "stages") as done:
        found = [measure(name, one, ground, config.seed, config.threads, done) for name, one in robots.items()]
    checks = [check for one in found for check in checks_of(one)]
    return _Found(
        {"robots": {one.robot: summary_of(one) for one in found}},
        lambda manifest, command: page(found, checks, manifest, command),
        [checks_table(TITLE, checks)],
        checks,
        {"robots": robots, "ground": ground},
    )
