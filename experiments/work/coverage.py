"""`trackslip coverage`: do the 95 % intervals cover the truth in 95 % of many repeats?"""

import time
from collections.abc import Mapping

from experiments.driving.grid_runs import cells_of, drive_grid
from experiments.driving.world import World
from experiments.measuring.coverage import (
    DRAWN_LAWS,
    RUN_LAW,
    Coverage,
    RunCoverage,
    drawn_coverage,
    generating_values,
    scanned_again,
)
from experiments.options.coverage import CoverageConfig
from experiments.parallel.executors import workers
from experiments.parallel.workers import processors
from experiments.recording import record_all
from experiments.report.laws import SYMBOLS
from experiments.report.terminal import print_table, progress
from experiments.storage.results import SUMMARY_FILE, results_folder, write_results
from trackslip.identification.comparison import compare_laws
from trackslip.identification.samples import SlipSamples
from trackslip.identification.true_samples import true_samples
from trackslip.slip.families import FAMILIES


def run(config: CoverageConfig) -> None:
    """Check the intervals of steady samples, or those of drives."""
    if config.drives:
        check_drives(config)
    else:
        check_grids(config)


def check_drives(config: CoverageConfig) -> None:
    """Drive in MuJoCo and by the law, fit every drive, store and print what has to hold."""
    # late: grids need none of it
    from experiments.measuring.drive_cases import DURATION
    from experiments.measuring.drive_study import MAX_SIMULATED, simulated_drives, size, steady_laws, study
    from experiments.report.drive_checks import CHECKS_HEADER, SIMULATED_HEADER, checks_table, simulated_table

    began = time.perf_counter()
    with results_folder(config.out) as folder:
        world = World.of(config)
        count = min(config.drive_repeats, MAX_SIMULATED)
        with progress(f"{count} drives and circles", count * DURATION) as report:
            steady = steady_laws(world.robot, config.threads)
            drives = simulated_drives(world.robot, count, config.seed, config.threads, lambda s: report(count * s))
        jobs = config.threads or processors()
        fits = size(count, config.drive_repeats)
        with progress("fits of drives", fits, "fits") as step, workers("processes", jobs) as pool:
            found = study(drives, steady, world.robot.geometry, config.drive_repeats, config.seed, pool, step)
        wall = time.perf_counter() - began
        timing = {"wall_s": wall, "stages": {"coverage": wall}}
        write_results(folder, found.to_json() | {"timing": timing}, world.manifest("coverage", wall, config))
    print_table(f"{found.repeats} drives in each case", CHECKS_HEADER, checks_table(found.checks))
    print_table("MuJoCo's drives without noise, and steady circles", SIMULATED_HEADER, simulated_table(found.simulated))
    for line in found.failures:
        print(f"a fit failed: {line}")
    held = sum(check.holds for check in found.checks)
    print(f"{held} of {len(found.checks)} checks hold")
    print(f"{config.out / SUMMARY_FILE}: {wall:.1f} s")


def check_grids(config: CoverageConfig) -> None:
    """Drive grids without noise, repeat what is random, store and print."""
    began = time.perf_counter()
    with results_folder(config.out) as folder:
        world = World.of(config.grid(0))
        geometry = world.robot.geometry
        repeats: list[tuple[SlipSamples, SlipSamples]] = []
        size = len(cells_of(config))
        stage = f"{config.grids} grids of {size} runs, {config.run_repeats} scans"
        with progress(stage, 2 * config.grids, "stages") as step:
            for k in range(config.grids):
                count = len(range(k, config.run_repeats, config.grids))
                logs = drive_grid(config.grid(k), world)
                step(1.0)
                if k == 0 and config.rrd:
                    record_all(folder, logs)
                truth = true_samples(logs, geometry, of_plate=True)
                again = scanned_again(logs, geometry, config, count, lambda _: step(1.0 / size))
                repeats += [(samples, truth) for samples in again]
        design = repeats[0][0]
        with progress("fits", 2 * len(DRAWN_LAWS) + 2, "fits") as step:
            fitted = compare_laws(design, geometry)
            step(1.0)
            values = {name: generating_values(name, fitted) for name in DRAWN_LAWS}
            known, unknown = drawn_coverage(config, design, values, geometry, step)
            runs = RunCoverage.of(repeats, true_samples(logs, geometry), geometry)
            step(1.0)
        found = Coverage(config.repeats, known, unknown, runs)
        wall = time.perf_counter() - began
        timing = {"wall_s": wall, "stages": {"coverage": wall}}
        write_results(folder, vars(found) | {"timing": timing}, world.manifest("coverage", wall, config))
    header = ("law", "parameter", "drawn from", "errors known", "errors unknown")
    print_table(
        f"Share of {config.repeats} repeats whose 95 % interval covers the parameter", header, _rows(found, values)
    )
    title = f"Share of {runs.repeats} grids whose {RUN_LAW} interval covers the value fitted to the true motion"
    rows = [(SYMBOLS[key], f"{runs.noise[key]:.3f}", f"{runs.interval95[key]:.3f}") for key in runs.noise]
    print_table(title, ("parameter", "noise alone", "95 % interval"), rows)
    bias = " and ".join(f"{SYMBOLS[key]} by {value:+.6f}" for key, value in runs.bias_by_lean.items())
    print(f"The true motion here is the plate's, which leans outwards with the robot. This changes {bias}.")
    print(f"{config.out / SUMMARY_FILE}: {wall:.1f} s")


def _rows(found: Coverage, values: Mapping[str, Mapping[str, float]]) -> list[tuple[str, ...]]:
    """One row per parameter, with the value that the samples were drawn with [SI]."""
    rows: list[tuple[str, ...]] = []
    for name, shares in found.laws.items():
        for k, (key, share) in enumerate(shares.items()):
            symbol = f"{SYMBOLS[key]} [{FAMILIES[name].parameters[key].unit or '-'}]"
            drawn, unknown = values[name][key], found.laws_errors_unknown[name][key]
            rows.append((name if k == 0 else "", symbol, f"{drawn:+.4f}", f"{share:.3f}", f"{unknown:.3f}"))
    return rows
