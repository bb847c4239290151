"""`trackslip validate`: compare the simulator with theory."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from experiments.driving.grid_runs import sample_runs
from experiments.options.validate import ValidateConfig
from experiments.recording import record_all
from experiments.report.terminal import busy, progress
from experiments.report.validation import page, table_of
from experiments.storage.manifest import command_line, make_manifest
from experiments.storage.plain_json import plain
from experiments.storage.results import REPORT_FILE, results_folder, write_results
from experiments.validation.convergence import converge
from experiments.validation.energy import account
from experiments.validation.results import Validation, ValidationSummary
from experiments.validation.standing import creep, loads, slide, straight_drift
from experiments.validation.turning import turn
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters, load_robot_file
from sim.robot.robot import load_robot
from sim.runs import Progress
from sim.seeds import generator
from sim.stopwatch import Stopwatch


def run(config: ValidateConfig) -> None:
    """Compare the shipped robot with theory, or tracks on terrain, or ground that shears."""
    if config.terrain:
        validate_terrain(config)
    elif config.shear:
        validate_shear(config)
    else:
        validate_robot(config)


def validate_terrain(config: ValidateConfig) -> None:
    """Measure tracks on terrain; store and print what has to hold."""
    # late: the other validation needs none of it
    from experiments.report import terrain as report
    from experiments.validation.terrain.bounds import BOUNDS, checks_of
    from experiments.validation.terrain.findings import STAGES, TerrainValidation, by_default, measure, summary_of
    from experiments.validation.terrain.subjects import subjects

    began = time.perf_counter()
    robots = subjects(config.robot)
    with results_folder(config.out) as folder:
        with progress("tracks on terrain", len(robots) * (len(BOUNDS) * STAGES + 1), "stages") as done:
            findings = [measure(one, preset, config.seed, config.threads, done) for one in robots for preset in BOUNDS]
            naive = []
            for one in robots:
                naive.append(by_default(one, config.threads))
                done(1.0)
        found = TerrainValidation(tuple(findings), tuple(naive))
        checks = [check for one in findings for check in checks_of(one)]
        wall = time.perf_counter() - began
        manifest = make_manifest("validate", config, wall, seed=config.seed)
        with busy("report"):
            report.page(found, checks, manifest, command_line("validate")).write(folder, config.pdf)
        summary = {"checks": [check.to_json() for check in checks], **summary_of(found)}
        write_results(folder, plain(summary) | {"timing": {"wall_s": wall, "stages": {"terrain": wall}}}, manifest)
    report.checks_table(found, checks).print()
    report.default_table(found).print()
    print(f"{sum(check.holds for check in checks)} of {len(checks)} checks hold")
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def validate_shear(config: ValidateConfig) -> None:
    """Measure robots on ground that shears; store and print what has to hold."""
    # late: the other validations need none of it
    from experiments.report import shear as report
    from experiments.report.checks import checks_table
    from experiments.validation.shear.findings import STAGES, checks_of, measure, subjects, summary_of

    began = time.perf_counter()
    parameters, ground = load_robot_file(config.robot)
    robots = subjects(parameters, config.robot is not None)
    ground = Ground(ground.along, ground.across)
    with results_folder(config.out) as folder:
        with progress("ground that shears", len(robots) * STAGES, "stages") as done:
            findings = [measure(name, one, ground, config.seed, config.threads, done) for name, one in robots.items()]
        checks = [check for found in findings for check in checks_of(found)]
        wall = time.perf_counter() - began
        manifest = make_manifest("validate", config, wall, seed=config.seed, robots=robots, ground=ground)
        with busy("report"):
            report.page(findings, checks, manifest, command_line("validate")).write(folder, config.pdf)
        summary = {
            "checks": [check.to_json() for check in checks],
            "robots": {one.robot: summary_of(one) for one in findings},
        }
        write_results(folder, plain(summary) | {"timing": {"wall_s": wall, "stages": {"shear": wall}}}, manifest)
    checks_table(report.TITLE, checks).print()
    print(f"{sum(check.holds for check in checks)} of {len(checks)} checks hold")
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def validate_robot(config: ValidateConfig) -> None:
    """Measure, store and print."""
    began = time.perf_counter()
    parameters, ground = load_robot_file(config.robot)
    ground = Ground(ground.along, ground.across)  # theory knows no slopes, patches or changes
    with results_folder(config.out) as folder:
        watch = Stopwatch()
        found = validate(parameters, ground, config, watch)
        wall = time.perf_counter() - began
        summary = ValidationSummary.of(found)
        world = {"robot": parameters, "ground": ground, "model_sha256": load_robot(parameters=parameters).digest}
        manifest = make_manifest("validate", config, wall, seed=config.seed, **world)
        with busy("report"):
            page(found, summary, manifest, command_line("validate")).write(folder, config.pdf)
        write_results(folder, plain(summary) | {"timing": {"wall_s": wall, "stages": watch.stages}}, manifest)
        if config.rrd:
            with busy("recordings"):
                record_all(folder, sample_runs(config.robot, config))
    table_of(found, summary).print()
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def validate(parameters: RobotParameters, ground: Ground, config: ValidateConfig, watch: Stopwatch) -> Validation:
    """Make all measurements; `watch` takes the time of each stage."""
    world, threads = (parameters, ground), config.threads
    with _stage(watch, "turning") as report:
        turns = turn(*world, threads, False, report)
    with _stage(watch, "turning, default contact") as report:
        naive_turns = turn(*world, threads, True, report)
    with _stage(watch, "standing"):
        weights, naive_weights = (loads(*world, threads, default) for default in (False, True))
        creeping, sliding = creep(*world, threads), slide(*world, threads)
        drift = straight_drift(*world, threads)
    with _stage(watch, "convergence") as report:
        convergence = converge(*world, generator(config.seed, "convergence"), threads, report)
    with _stage(watch, "energy"):
        energy = account(*world, generator(config.seed, "energy"), threads)
    return Validation(*world, turns, naive_turns, weights, naive_weights, creeping, sliding, drift, convergence, energy)


@contextmanager
def _stage(watch: Stopwatch, name: str) -> Iterator[Progress]:
    with watch.stage(name), progress(name, 1.0, "of the stage") as report:
        yield report
