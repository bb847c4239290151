"""`trackslip bench`: measure how fast the simulator is, store and print it."""

import contextlib
import math
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from experiments.measuring.check import Check
from experiments.options.bench import BenchConfig
from experiments.report.terminal import print_table
from experiments.speed.gpu import distance, measure_gpu
from experiments.speed.memory import peak_memory
from experiments.speed.shear import measure_shear
from experiments.speed.simulator import CASES, case_speeds, measure_simulator, thread_speedups
from experiments.storage.manifest import make_manifest
from experiments.storage.results import SUMMARY_FILE, results_folder, write_results
from experiments.validation.shear.cost import FEWEST, MOST
from sim.robot.robot import Robot, load_robot
from sim.warp.devices import GPU, require_available


def run(config: BenchConfig) -> None:
    """Measure, store and print."""
    began = perf_counter()
    with results_folder(config.out) as folder:
        robot = load_robot()
        chosen = {
            _environments: config.env,
            _terrain: config.terrain,
            _shear: config.shear,
            _gpu: config.gpu,
            _pipeline: config.pipeline,
            _scale: config.scale,
        }
        measure = next((one for one, wanted in chosen.items() if wanted), _simulator)
        summary, tables = measure(config, robot)
        memory = peak_memory()
        wall = perf_counter() - began
        summary |= {"peak_memory_mb": memory, "timing": {"wall_s": wall}}
        more = {"seed": config.seed, "model_sha256": robot.digest, "processors": os.cpu_count()}
        write_results(folder, summary, make_manifest("bench", config, wall, **more))
    for table in tables:
        print_table(*table)
    if memory is not None:
        print(f"peak memory {memory:.0f} MB")
    print(f"{config.out / SUMMARY_FILE}: {wall:.1f} s")


_Cells = tuple[str, ...]
_Table = tuple[str, _Cells, list[_Cells]]  # title, header, rows
_Measured = tuple[dict[str, Any], list[_Table]]  # entries of summary.json, and what is printed


def _simulator(config: BenchConfig, robot: Robot) -> _Measured:
    with _progress(len(config.sizes) * (1 + config.repeats)) as step:
        rates = measure_simulator(config, robot, step)
    speeds, speedups = case_speeds(rates, robot.model.opt.timestep), thread_speedups(rates)
    tables = [_speed_table("Speed of the simulation", speeds)]
    if speedups:
        found: dict[_Cells, _Cells] = {}
        for one in speedups:  # in the order of CASES
            size = str(one.n), str(one.threads)
            found[size] = (*found.get(size, size), f"{one.speedup:.2f}")
        tables.append(("Speed-up over one thread", ("robots", "threads", *CASES), list(found.values())))
    return {"rows": speeds, "thread_speedup": speedups}, tables


def _environments(config: BenchConfig, robot: Robot) -> _Measured:
    from experiments.speed.environments import env_speeds, measure_env  # late: it needs gymnasium
    from experiments.speed.traverse import measure_traverse

    with _progress(2 * (1 + config.repeats)) as step:
        speeds = env_speeds(measure_env(config, step), robot.model.opt.timestep)
        traverse = measure_traverse(config, step)
    title, header, rows = _speed_table("Speed of the learning environments", speeds)
    header = (*header[:-1], "ratio to SyncVectorEnv", header[-1])
    rows = [(*row[:-1], f"{one.ratio_to_single:.1f}", row[-1]) for row, one in zip(rows, speeds, strict=True)]
    return {"rows": speeds, "traverse": traverse}, [(title, header, rows), _speed_table("Speed on courses", traverse)]


def _terrain(config: BenchConfig, _: Robot) -> _Measured:
    from experiments.speed.terrain import CONDITIONS, measure_terrain  # late: only this needs tracks and terrain

    with _progress(CONDITIONS) as step:
        speeds = measure_terrain(config, step)
    header = ("preset", "terrain", "case", "robots", "threads", "steps/s", "ratio to bare", "real-time factor")
    rows: list[_Cells] = []
    for one in speeds:
        numbers = f"{one.steps_per_s:,.0f}", f"{one.ratio_to_bare:.2f}", f"{one.real_time_factor:.1f}"
        rows.append((one.preset, one.terrain, one.case, str(one.n), str(one.threads), *numbers))
    title = f"Speed on terrain of the robot {Path(config.terrain_robot).stem}"
    return {"rows": speeds}, [(title, header, rows)]


def _shear(config: BenchConfig, robot: Robot) -> _Measured:
    with _progress(len(config.shear_sizes) * len(config.thread_counts)) as step:
        costs = measure_shear(config, robot, step)
    header = ("robots", "threads", "Coulomb ground, steps/s", "ground that shears", "cost ratio")
    rows: list[_Cells] = []
    for one in costs:
        speeds = f"{one.coulomb_steps_per_s:,.0f}", f"{one.shear_steps_per_s:,.0f}"
        rows.append((str(one.n), str(one.threads), *speeds, f"{one.cost_ratio:.2f}"))
    checks = [
        Check(f"{one.n} robots, {one.threads} threads", "cost ratio", one.cost_ratio, MOST, "1")
        for one in costs
        if one.n >= FEWEST and one.threads == 1  # on more, those that wait for work may use time, too
    ]
    return {"rows": costs, "checks": [one.to_json() for one in checks]}, [("Cost of shear", header, rows)]


def _gpu(config: BenchConfig, robot: Robot) -> _Measured:
    require_available(GPU)
    with _progress(len(config.gpu_sizes) * (1 + config.repeats)) as step:
        check = distance(robot)
        speeds = measure_gpu(config.gpu_sizes, config, robot, step)
    header = ("robots", "processor, steps/s", "MuJoCo Warp", "fleet", "fleet / processor", "real-time factor")
    rows: list[_Cells] = []
    for one in speeds:
        rates = one.processor_steps_per_s, one.warp_steps_per_s, one.fleet_steps_per_s
        ratios = f"{one.ratio_to_processor:.1f}", f"{one.real_time_factor:,.0f}"
        rows.append((f"{one.n:,}", *(f"{rate:,.0f}" for rate in rates), *ratios))
    apart = f"{check.case}: {check.what}", *_value_and_bound(check)
    return {"rows": speeds, "checks": [check.to_json()]}, [
        ("Speed on a GPU", header, rows),
        ("Beside the processor", ("what", "value", "bound", "unit", ""), [apart]),
    ]


def _pipeline(config: BenchConfig, _: Robot) -> _Measured:
    from experiments.speed.pipeline.areas import AREAS, measure_of  # late: only this needs laws and reports

    checks: list[Check] = []
    with _progress(len(AREAS)) as step:
        for area in AREAS:
            checks += measure_of(area)(config.seed, config.repeats, lambda label: step(label, 0))
            step(area, 1)
    return {"checks": [one.to_json() for one in checks]}, [_check_table("The pipeline beside its bounds", checks)]


def _scale(config: BenchConfig, _: Robot) -> _Measured:
    from experiments.speed.pipeline import scale  # late: only this needs processes

    chosen = scale.cases_of(config.scale_long)
    with _progress(len(chosen)) as step:
        cases = scale.measure_cases(chosen, config.seed, step)
    header = ("robots", "duration [s]", "wall [s]", "per robot and second [ms]", "peak memory [MB]", "file [MB]")
    rows: list[_Cells] = []
    for one in cases:
        times = f"{one.seconds:.3g}", f"{1e3 * one.per_robot_second:.3g}"
        rows.append((str(one.robots), f"{one.duration:g}", *times, f"{one.memory:.0f}", f"{one.file_size:.3g}"))
    checks = scale.checks_of(cases)
    tables = [("Runs written to Parquet while they last", header, rows), _check_table("Scale", checks)]
    return {"rows": cases, "checks": [one.to_json() for one in checks]}, tables


def _check_table(title: str, checks: Sequence[Check]) -> _Table:
    rows: list[_Cells] = [(f"{one.case}: {one.what}", *_value_and_bound(one)) for one in checks]
    return title, ("what", "value", "bound", "unit", ""), rows


def _value_and_bound(check: Check) -> _Cells:
    low, high = check.ends
    limits = [text for end, text in ((low, f"at least {low:g}"), (high, f"at most {high:g}")) if math.isfinite(end)]
    return f"{check.value:.3g}", ", ".join(limits), check.unit, "holds" if check.holds else "does not hold"


def _speed_table(title: str, speeds: Sequence[Any]) -> _Table:
    rows: list[_Cells] = []
    for one in speeds:
        numbers = f"{one.steps_per_s:,.0f}", f"{one.ratio_to_bare:.2f}", f"{one.real_time_factor:.1f}"
        rows.append((one.case, str(one.n), str(one.threads), *numbers))
    return title, ("case", "robots", "threads", "steps/s", "ratio to bare", "real-time factor"), rows


@contextlib.contextmanager
def _progress(rounds: int) -> Iterator[Callable[..., None]]:
    """A progress bar on standard error; call what it yields with a label after each round, or after so many.

    Unlike the bars of other commands it draws only between measurements: a thread that redraws would be measured, too.
    """
    columns = (TextColumn("{task.description:<34}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not console.is_terminal, auto_refresh=False) as bar:
        task = bar.add_task("warming up", total=rounds)
        try:
            yield lambda stage, rounds=1: bar.update(task, advance=rounds, description=stage, refresh=True)
        except BaseException:
            bar.live.transient = True  # leave the terminal to the error message
            raise
