"""`trackslip bench`: measure how fast the simulator is, store and print it."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from experiments.commands import grid
from experiments.options.bench import BenchConfig
from experiments.options.grid import SweepConfig
from experiments.report.terminal import print_table
from experiments.speed.grid import GridSpeed, measure_grid
from experiments.speed.simulator import (
    CASES,
    CaseSpeed,
    ThreadSpeedup,
    case_speeds,
    measure_simulator,
    thread_speedups,
)
from experiments.storage.manifest import make_manifest
from experiments.storage.plain_json import write_json
from experiments.storage.results import MANIFEST_FILE, SUMMARY_FILE, results_folder
from experiments.sweep.summary import Timing
from sim.robot.robot import Robot, load_robot


def run(config: BenchConfig) -> None:
    """Measure, store and print."""
    began = perf_counter()
    with results_folder(config.out) as folder:
        robot = load_robot()
        measure = _environments if config.env else _grid if config.grid else _simulator
        summary, print_out = measure(config, robot)
        memory = peak_memory()
        wall = perf_counter() - began
        about = make_manifest(
            "bench", config, wall, seed=config.seed, model_sha256=robot.digest, processors=os.cpu_count()
        )
        write_json(folder / SUMMARY_FILE, summary | {"peak_memory_mb": memory, "timing": {"wall_s": wall}})
        write_json(folder / MANIFEST_FILE, about)
    print_out()
    if memory is not None and not config.grid:
        print(f"peak memory {memory:.0f} MB")
    print(f"{config.out / SUMMARY_FILE}: {wall:.1f} s")


_Measured = tuple[dict[str, Any], Callable[[], None]]  # entries of summary.json, and what prints them


def _simulator(config: BenchConfig, robot: Robot) -> _Measured:
    with _progress(len(config.sizes) * (1 + config.repeats)) as step:
        rates = measure_simulator(config, robot, step)
    speeds, speedups = case_speeds(rates, robot.model.opt.timestep), thread_speedups(rates)
    return {"rows": speeds, "thread_speedup": speedups}, lambda: _print_simulator(speeds, speedups)


def _environments(config: BenchConfig, robot: Robot) -> _Measured:
    from experiments.speed.environments import env_speeds, measure_env  # late: it needs gymnasium

    with _progress(1 + config.repeats) as step:
        speeds = env_speeds(measure_env(config, step), robot.model.opt.timestep)
    header = ("case", "robots", "threads", "steps/s", "ratio to bare", "ratio to SyncVectorEnv", "real-time factor")
    rows = [(*_speed_cells(one), f"{one.ratio_to_single:.1f}", f"{one.real_time_factor:.1f}") for one in speeds]
    return {"rows": speeds}, lambda: print_table("Speed of the learning environments", header, rows)


def _grid(config: BenchConfig, robot: Robot) -> _Measured:
    with _progress(len(config.thread_counts)) as step:
        speeds = measure_grid(config, _drive_grid, step)
    return {"rows": speeds}, lambda: _print_grid(speeds)


def _drive_grid(sweep: SweepConfig) -> Timing:
    """Drive a grid into a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        return grid.drive_and_store(replace(sweep, out=Path(folder) / "grid")).timing


def _speed_cells(speed: Any) -> tuple[str, ...]:
    return (
        speed.case,
        str(speed.n),
        str(speed.threads),
        f"{speed.steps_per_s:,.0f}",
        f"{speed.ratio_to_bare:.2f}",
    )


def _print_simulator(speeds: Sequence[CaseSpeed], speedups: Sequence[ThreadSpeedup]) -> None:
    header = ("case", "robots", "threads", "steps/s", "ratio to bare", "real-time factor")
    rows = [(*_speed_cells(one), f"{one.real_time_factor:.1f}") for one in speeds]
    print_table("Speed of the simulation", header, rows)
    speedup = {(one.n, one.threads, one.case): one.speedup for one in speedups}
    if speedup:
        print_table(
            "Speed-up over one thread",
            ("robots", "threads", *CASES),
            [
                (str(n), str(threads), *(f"{speedup[n, threads, case]:.2f}" for case in CASES))
                for n, threads in dict.fromkeys(key[:2] for key in speedup)
            ],
        )


def _print_grid(speeds: Sequence[GridSpeed]) -> None:
    one = next((speed.wall_s for speed in speeds if speed.processes == 1), None)
    print_table(
        "Speed of a grid",
        ("processes", "runs", "wall [s]", "speed-up", "bare [s]", "without scans, poses, slips / bare"),
        [
            (
                str(speed.processes),
                str(speed.runs),
                f"{speed.wall_s:.1f}",
                "-" if one is None else f"{one / speed.wall_s:.2f}",
                f"{speed.bare_s:.1f}",
                f"{speed.ratio_to_bare:.2f}",
            )
            for speed in speeds
        ],
    )
    stages = list(dict.fromkeys(name for speed in speeds for name in speed.stages))
    print_table(
        "Seconds of work by stage, all processes together",
        ("processes", *stages),
        [(str(speed.processes), *(f"{speed.stages.get(name, 0.0):.1f}" for name in stages)) for speed in speeds],
    )


def peak_memory() -> float | None:
    """The most memory that this process has used so far [MB]; None where the system doesn't tell."""
    if sys.platform == "win32":
        return None
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6  # Linux counts in KiB


@contextlib.contextmanager
def _progress(rounds: int) -> Iterator[Callable[[str], None]]:
    """A progress bar on standard error; call what it yields after each round.

    Unlike the bars of other commands it draws only between measurements: a thread that redraws would be measured, too.
    """
    columns = (TextColumn("{task.description:<34}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not console.is_terminal, auto_refresh=False) as bar:
        task = bar.add_task("warming up", total=rounds)
        try:
            yield lambda stage: bar.update(task, advance=1, description=stage, refresh=True)
        except BaseException:
            bar.live.transient = True  # leave the terminal to the error message
            raise
