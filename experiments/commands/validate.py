"""`trackslip validate`: compare the simulator with theory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from experiments.driving.grid_runs import sample_runs
from experiments.options.validate import ValidateConfig
from experiments.recording import record_all
from experiments.report.formats import for_terminal
from experiments.report.terminal import busy, print_table, progress
from experiments.report.validation import TABLE_HEADER, TITLE, render, table_of
from experiments.storage.manifest import command_line, make_manifest
from experiments.storage.plain_json import plain, write_json
from experiments.storage.results import MANIFEST_FILE, REPORT_FILE, SUMMARY_FILE, results_folder
from experiments.validation.convergence import converge
from experiments.validation.energy import account
from experiments.validation.results import Validation, ValidationSummary
from experiments.validation.standing import creep, loads, slide, straight_drift
from experiments.validation.turning import turn
from sim.ground.ground import Ground
from sim.robot.file import load_robot_file
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from sim.runs import Progress
from sim.seeds import generator
from sim.stopwatch import Stopwatch


def run(config: ValidateConfig) -> None:
    """Measure, store and print."""
    began = time.perf_counter()
    parameters, ground = load_robot_file(config.robot)
    ground = Ground(ground.along, ground.across)  # theory knows no slopes, patches or changes
    with results_folder(config.out) as folder:
        watch = Stopwatch()
        found = validate(parameters, ground, config, watch)
        wall = time.perf_counter() - began
        summary = ValidationSummary.of(found)
        manifest = make_manifest(
            "validate",
            config,
            wall,
            seed=config.seed,
            model_sha256=load_robot(parameters=parameters).digest,
            robot=parameters,
            ground=ground,
        )
        with busy("report"):
            render(found, summary, manifest, command_line("validate")).write(folder, config.pdf)
        timing = {"wall_s": wall, "stages": watch.stages}
        write_json(folder / SUMMARY_FILE, plain(summary) | {"timing": timing})
        write_json(folder / MANIFEST_FILE, manifest)
        if config.rrd:
            with busy("recordings"):
                record_all(folder, sample_runs(config.robot, config))
    print_table(TITLE, TABLE_HEADER, for_terminal(table_of(found, summary)))
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def validate(parameters: RobotParameters, ground: Ground, config: ValidateConfig, watch: Stopwatch) -> Validation:
    """Make all measurements; `watch` takes the time of each stage."""
    threads = config.threads
    with _stage(watch, "turning") as report:
        turns = turn(parameters, ground, threads, False, report)
    with _stage(watch, "turning, default contact") as report:
        naive_turns = turn(parameters, ground, threads, True, report)
    with _stage(watch, "standing"):
        found_loads, naive_loads = (loads(parameters, ground, threads, default) for default in (False, True))
        found_creep, found_slide = creep(parameters, ground, threads), slide(parameters, ground, threads)
        drift = straight_drift(parameters, ground, threads)
    with _stage(watch, "convergence") as report:
        convergence = converge(parameters, ground, generator(config.seed, "convergence"), threads, report)
    with _stage(watch, "energy"):
        energy = account(parameters, ground, generator(config.seed, "energy"), threads)
    return Validation(
        parameters=parameters,
        ground=ground,
        turns=turns,
        naive_turns=naive_turns,
        loads=found_loads,
        naive_loads=naive_loads,
        creep=found_creep,
        slide=found_slide,
        drift=drift,
        convergence=convergence,
        energy=energy,
    )


@contextmanager
def _stage(watch: Stopwatch, name: str) -> Iterator[Progress]:
    with watch.stage(name), progress(name, 1.0, "of the stage") as report:
        yield report
