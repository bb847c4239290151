"""Groups of runs, driven one after another or by several processes at once."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from pathlib import Path

from experiments.benchmark.group import drive, measure
from experiments.benchmark.setup import Setup
from experiments.driving.lookup import reference
from experiments.options.benchmark import BenchmarkConfig, Case
from experiments.parallel.executors import processors, workers
from experiments.storage.benchmark_parts import Parts

_SLOW = {"mpc": 4.0}  # how much longer a robot takes than under most controllers


def work_off(config: BenchmarkConfig, wanted: Mapping[Path, tuple[Case, ...]]) -> Iterator[Path]:
    """Make parts, in `config.jobs` processes; yields each when it is there. The longest are begun first."""
    order = sorted(wanted, key=lambda path: -_work(wanted[path]))
    jobs = min(config.jobs or processors(), len(order))
    with workers("processes", jobs) as pool:
        yield from pool.each(functools.partial(make, config), [(path, wanted[path]) for path in order])


def make(config: BenchmarkConfig, task: tuple[Path, tuple[Case, ...]]) -> Path:
    """Drive a group, store it as a part, and return its path."""
    path, cases = task
    setup = _setup(config)
    outcomes = drive(setup, cases)
    Parts.write(path, measure(setup, outcomes), [outcome.log for outcome in outcomes if outcome.log is not None])
    return path


@functools.lru_cache(maxsize=1)
def _setup(config: BenchmarkConfig) -> Setup:
    return Setup.of(config)


def _work(cases: tuple[Case, ...]) -> float:
    return reference(cases[0].reference).duration * sum(_SLOW.get(case.controller, 1.0) for case in cases)
