"""`trackslip bench`: physics steps per second, bare and with all that is built around them.

The machine may be shared and its clock may wander, so nothing is compared that wasn't measured side by side. Bare
physics, fleet and scanner take short turns, several in a round, at all numbers of threads; a round ends with the closed
loop, and every other round runs backwards. The first round isn't counted. A rate is the median over all turns; a ratio
is the median over the ratios to the bare rate of the same turn, or for the closed loop to those of the same round. What
slows the machine for longer than a turn cancels, and what disturbs one measurement is outvoted. The best of all would
flatter: a ratio of two bests sets one case's luckiest moment against another's, and nobody who waits for a result gets
either. So the quotient of two printed rates may differ a little from the printed ratio.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from time import perf_counter
from typing import Any

import numpy as np
from mujoco import batch
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from experiments.driving.grid_runs import before_scanner
from experiments.driving.lookup import locator
from experiments.options.bench import BenchConfig
from experiments.options.track import TrackConfig
from experiments.report.terminal import print_table
from experiments.storage.manifest import make_manifest
from experiments.storage.plain_json import write_json
from experiments.storage.results import MANIFEST_FILE, SUMMARY_FILE, results_folder
from sim.fleet import Fleet
from sim.robot.robot import Robot, load_robot
from sim.run_recorder import Description
from sim.runs import Pilot, closed_loop
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from trackslip.controllers.linear import LinearTimeVarying
from trackslip.kinematics import Array
from trackslip.slip.compensation import FixedLaw
from trackslip.slip.law_file import load_laws
from trackslip.trajectory.segmented import circle

BARE, FLEET, SCANNER, CLOSED_LOOP = CASES = ("bare", "fleet", "scanner", "closed loop")
Rates = Mapping[tuple[str, int, int], Array]
"""Physics steps per second (R, T) in R rounds of T turns, of a case, a number of robots and a number of threads."""

_RADIUS, _SPEED = TrackConfig.circle_radius, TrackConfig.circle_speed  # of the circle that all cases drive [m], [m/s]
_TURNS = 4  # in a round; the closed loop has one
_STEADY = 2.0  # time after which the sprockets turn at their set points to the last bit [s]
_CLOSED_LOOP_SHARE = 0.1  # of the simulated time: localisation takes so much longer
_MIN_SCANS = 2
_MIN_SCANS_CLOSED_LOOP = 6


def run(config: BenchConfig) -> None:
    """Measure, store and print."""
    began = perf_counter()
    with results_folder(config.out) as folder:
        robot = load_robot()
        summary = _measured(config, robot)
        summary["peak_memory_mb"] = peak_memory()
        wall = perf_counter() - began
        summary["timing"] = {"wall_s": wall}
        about = make_manifest(
            "bench", config, wall, seed=config.seed, model_sha256=robot.digest, processors=os.cpu_count()
        )
        write_json(folder / SUMMARY_FILE, summary)
        write_json(folder / MANIFEST_FILE, about)
    _print_out(config, summary)
    print(f"{config.out / SUMMARY_FILE}: {wall:.1f} s")


def _measured(config: BenchConfig, robot: Robot) -> dict[str, Any]:
    timestep = robot.model.opt.timestep
    if config.env:
        from experiments.speed.environments import env_rows, measure_env  # late: it needs gymnasium

        with _progress(1 + config.repeats) as step:
            return {"rows": env_rows(config, measure_env(config, step), timestep)}
    if config.grid:
        from experiments.speed.grid import measure_grid

        with _progress(len(config.thread_counts)) as step:
            return {"rows": measure_grid(config, step)}
    rates = measure(config, robot)
    return {"rows": bench_rows(rates, timestep), "thread_speedup": thread_speedup(rates)}


def _print_out(config: BenchConfig, summary: Mapping[str, Any]) -> None:
    if config.grid:
        from experiments.speed.grid import print_grid_summary

        print_grid_summary(summary)
    elif config.env:
        print_env_summary(summary)
    else:
        print_summary(summary)


class Rig:
    """N robots that drive on a circle in front of the scanner, and the ways to let a number of scan periods pass.

    They start where the circle is nearest to the scanner and drive on from case to case. Before the scanner's nearest
    point the plate takes up most beams, so the larger fleets, which don't get far, see the dearest part of the circle.
    """

    def __init__(self, robot: Robot, size: int, threads: int, seed: int) -> None:
        """`size` robots on `threads` worker threads, driving steadily."""
        self.size = size
        self.fleet = Fleet(robot, np.tile(before_scanner(robot), (size, 1)), threads=threads)
        self._law = load_laws()["icr_radius"]
        self._omega = self._law.sprocket_speeds([_SPEED, _SPEED / _RADIUS], robot.geometry)
        self.fleet.command(self._omega)
        self.fleet.advance(_STEADY)
        self.feed = ScannerFeed(LaserScanner(), self.fleet, [generator(seed, f"bench {k}") for k in range(size)])
        self._locator = locator("plate", robot)
        self._pilot = Pilot(LinearTimeVarying(), range(size), FixedLaw(self._law))
        self._descriptions = [Description(str(k)) for k in range(size)]
        self.bare = bare_batch(self.fleet)
        self.steps_per_period = round(self.feed.period / robot.model.opt.timestep)
        self.cases: dict[str, Callable[[int], float]] = {
            BARE: _timed(self._step),
            FLEET: _timed(self._advance),
            SCANNER: _timed(self._scan),
            CLOSED_LOOP: self._follow,
        }
        """Each lets scan periods pass and returns the time that they took [s]."""

    def rate(self, case: str, periods: int) -> float:
        """Physics steps per second, all robots together, in a number of scan periods of a case."""
        return self.size * periods * self.steps_per_period / self.cases[case](periods)

    def periods(self, case: str, seconds: float) -> int:
        """Scan periods in which the robots together simulate `seconds` [s] or a little more."""
        share, fewest = (_CLOSED_LOOP_SHARE, _MIN_SCANS_CLOSED_LOOP) if case == CLOSED_LOOP else (1.0, _MIN_SCANS)
        return max(fewest, math.ceil(share * seconds / (self.size * self.feed.period) - 1e-9))

    def _step(self, periods: int) -> None:
        self.bare.step(nstep=periods * self.steps_per_period)

    def _advance(self, periods: int) -> None:
        self.fleet.command(self._omega)
        self.fleet.advance(periods * self.feed.period)

    def _scan(self, periods: int) -> None:
        self.fleet.command(self._omega)
        for _ in range(periods):
            self.fleet.advance(self.feed.period)
            self.feed.measure(self.feed.true_ranges()[:, None, :])

    def _follow(self, periods: int) -> float:
        # the robots differ by the scanner's noise only: one circle, from where the first of them is, suits all
        reference = circle(_RADIUS, _SPEED, (periods + 1) * self.feed.period, self.fleet.pose()[0])
        passed: list[float] = []
        closed_loop(
            self.fleet,
            [self._pilot],
            reference,
            self.feed,
            self._locator,
            self._descriptions,
            lambda _: passed.append(perf_counter()),
        )
        # from period to period: the scan before the first would count as one too many
        return passed[-1] - passed[0]


def _timed(advance: Callable[[int], None]) -> Callable[[int], float]:
    def timed(periods: int) -> float:
        began = perf_counter()
        advance(periods)
        return perf_counter() - began

    return timed


def bare_batch(fleet: Fleet) -> batch.Batch:
    """The same physics with nothing around it: robots in the fleet's state, their belts at its speeds now."""
    bare = batch.Batch(fleet.robot.model, fleet.size, nthread=fleet.batch.nthread)
    for name in ("geom_surfacevel", "pair_friction"):
        bare.expand(name)[:] = fleet.batch.expand(name)
    bare.state[:] = fleet.batch.state
    return bare


def measure(config: BenchConfig, robot: Robot) -> Rates:
    """Every case with every number of robots and threads, in rounds."""
    rates: dict[tuple[str, int, int], list[float]] = {}
    rounds = 1 + config.repeats  # the first warms up
    with _progress(len(config.sizes) * rounds) as step:
        for size in config.sizes:
            rigs = {threads: Rig(robot, size, threads, config.seed) for threads in config.thread_counts}
            order = list(itertools.product(config.thread_counts, (BARE, FLEET, SCANNER))) * _TURNS
            order += [(threads, CLOSED_LOOP) for threads in config.thread_counts]
            for k in range(rounds):
                for threads, case in order if k % 2 else reversed(order):
                    rig = rigs[threads]
                    rate = rig.rate(case, rig.periods(case, config.seconds))
                    if k > 0:
                        rates.setdefault((case, size, threads), []).append(rate)
                step(f"{size} robots" if size > 1 else "1 robot")
    return {key: np.reshape(measured, (config.repeats, -1)) for key, measured in rates.items()}


def bench_rows(rates: Rates, timestep: float) -> list[dict[str, Any]]:
    """A row for each case; the real-time factor is simulated robot-seconds per second, at `timestep` [s] a step."""
    order = sorted(rates, key=lambda key: (key[1], key[2], CASES.index(key[0])))
    return [
        {
            "case": case,
            "n": n,
            "threads": threads,
            "steps_per_s": float(np.median(rates[case, n, threads])),
            "ratio_to_bare": float(np.median(rates[case, n, threads] / rates[BARE, n, threads])),
            "real_time_factor": float(np.median(rates[case, n, threads])) * timestep,
        }
        for case, n, threads in order
    ]


def thread_speedup(rates: Rates) -> list[dict[str, Any]]:
    """How many times faster each case is than on one thread; nothing where one thread wasn't measured."""
    order = sorted(rates, key=lambda key: (key[1], key[2], CASES.index(key[0])))
    return [
        {"case": case, "n": n, "threads": threads, "speedup": float(np.median(rates[case, n, threads] / one))}
        for case, n, threads in order
        if threads > 1 and (one := rates.get((case, n, 1))) is not None
    ]


def peak_memory() -> float | None:
    """The most memory that this process has held so far [MB]; None where the system doesn't tell."""
    if sys.platform == "win32":
        return None
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6  # Linux counts in KiB


def print_summary(summary: Mapping[str, Any]) -> None:
    """Print the tables and the memory."""
    print_table(
        "Speed of the simulation",
        ("case", "robots", "threads", "steps/s", "ratio to bare", "real-time factor"),
        [
            (
                row["case"],
                str(row["n"]),
                str(row["threads"]),
                f"{row['steps_per_s']:,.0f}",
                f"{row['ratio_to_bare']:.2f}",
                f"{row['real_time_factor']:.1f}",
            )
            for row in summary["rows"]
        ],
    )
    speedup = {(row["n"], row["threads"], row["case"]): row["speedup"] for row in summary["thread_speedup"]}
    if speedup:
        print_table(
            "Times as fast as on one thread",
            ("robots", "threads", *CASES),
            [
                (str(n), str(threads), *(f"{speedup[n, threads, case]:.2f}" for case in CASES))
                for n, threads in dict.fromkeys(key[:2] for key in speedup)
            ],
        )
    _print_memory(summary)


def print_env_summary(summary: Mapping[str, Any]) -> None:
    """Print the table of the environments, and the memory."""
    print_table(
        "Speed of the learning environments",
        ("case", "robots", "threads", "steps/s", "ratio to bare", "ratio to SyncVectorEnv", "real-time factor"),
        [
            (
                row["case"],
                str(row["n"]),
                str(row["threads"]),
                f"{row['steps_per_s']:,.0f}",
                f"{row['ratio_to_bare']:.2f}",
                f"{row['ratio_to_single']:.1f}",
                f"{row['real_time_factor']:.1f}",
            )
            for row in summary["rows"]
        ],
    )
    _print_memory(summary)


def _print_memory(summary: Mapping[str, Any]) -> None:
    if summary["peak_memory_mb"] is not None:
        print(f"peak memory {summary['peak_memory_mb']:.0f} MB")


@contextlib.contextmanager
def _progress(rounds: int) -> Iterator[Callable[[str], None]]:
    """A progress bar on standard error; call what it yields after each round.

    Unlike other commands' bars it draws between measurements only: a thread that redraws would be measured too.
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
