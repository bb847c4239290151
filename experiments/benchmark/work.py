"""Groups of runs, driven one after another or by several processes at once."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from experiments.benchmark.group import drive, measure
from experiments.benchmark.parts import Parts
from experiments.benchmark.setup import Setup
from experiments.benchmark_config import BenchmarkConfig, Case
from experiments.names import reference
from experiments.workers import deaf_children, workers
from trackslip.errors import TrackslipError

_SLOW = {"mpc": 4.0}  # how much longer a robot takes than under most controllers


def work_off(config: BenchmarkConfig, wanted: Mapping[Path, tuple[Case, ...]]) -> Iterator[Path]:
    """Make parts, in `config.jobs` processes; yields each when it is there. The longest are begun first."""
    order = sorted(wanted, key=lambda path: -_work(wanted[path]))
    jobs = min(config.jobs or _processors(), len(order))
    if jobs <= 1:
        for path in order:
            yield make(config, path, wanted[path])
        return
    try:
        with workers(jobs) as pool:
            with deaf_children():
                pending = [pool.submit(make, config, path, wanted[path]) for path in order]
            for future in as_completed(pending):
                yield future.result()
    except BrokenProcessPool as error:
        raise TrackslipError("a worker process died; the same command goes on from where it was") from error


def make(config: BenchmarkConfig, path: Path, cases: tuple[Case, ...]) -> Path:
    """Drive a group, store it as a part, and return its path."""
    setup = _setup(config)
    outcomes = drive(setup, cases)
    Parts.write(path, measure(setup, outcomes), [outcome.log for outcome in outcomes if outcome.log is not None])
    return path


@functools.lru_cache(maxsize=1)
def _setup(config: BenchmarkConfig) -> Setup:
    return Setup.of(config)


def _work(cases: tuple[Case, ...]) -> float:
    return reference(cases[0].reference).duration * sum(_SLOW.get(case.controller, 1.0) for case in cases)


def _processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
