"""Groups of runs, driven one after another or by several processes at once."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.benchmark.group import drive, groups, measure
from experiments.benchmark.setup import Setup
from experiments.driving.lookup import policy_path, reference, user_modules
from experiments.options.benchmark import BenchmarkConfig, Case
from experiments.parallel.executors import processors, workers
from experiments.storage.manifest import content, digest
from experiments.storage.parts import Part
from experiments.storage.results import SUMMARY_FILE
from trackslip.controllers.named import CONTROLLERS
from trackslip.logs.runlog import RunLog
from trackslip.slip.law_file import SHIPPED

_SLOW = {"mpc": 4.0}  # how much longer a robot takes than under most controllers
_COMMON = ("robot", "radius_error", "drive", "scanner", "obstacles", "localization", "preview", "laws")


def ids(setup: Setup, cases: Sequence[Case]) -> dict[Case, str]:
    """For each case, a hash of everything its numbers depend on, the contents of files included."""
    config, world = setup.config, setup.world
    laws = config.laws or SHIPPED
    common = digest(
        {name: getattr(config, name) for name in _COMMON}
        | {
            "model": world.robot.digest,
            "world": [world.parameters, world.obstacles, world.radius_error],
            "laws": content(laws / SUMMARY_FILE if laws.is_dir() else laws),
        }
    )
    contents = functools.cache(lambda name: content(Path(name)))
    modules = user_modules()

    def files(case: Case) -> dict[str, str]:
        names = {case.reference, case.ground, str(policy_path(case.controller) or "")}
        names |= set(() if case.controller in CONTROLLERS else modules)
        return {name: digest for name in sorted(names) if (digest := contents(name)) is not None}

    return {case: digest([common, vars(case), files(case)]) for case in cases}


@dataclass(frozen=True)
class DrivenGroup:
    """What became of a group."""

    cases: tuple[Case, ...]
    part: Part
    """Rows (of CaseRow) and logs of its runs."""
    unfinished: list[RunLog]
    """What was recorded of runs that failed, until they did; empty unless recordings are wanted."""


def drive_groups(config: BenchmarkConfig, missing: Mapping[Case, str]) -> Iterator[DrivenGroup]:
    """Drive the cases, by their ids, in `config.jobs` processes, the longest groups first; each group when ready."""
    order = sorted(groups(list(missing)), key=_work, reverse=True)
    jobs = min(config.jobs or processors(), len(order))
    with workers("processes", jobs) as pool:
        tasks = [{case: missing[case] for case in group} for group in order]
        yield from pool.each(functools.partial(drive_group, config), tasks)


def drive_group(config: BenchmarkConfig, wanted: Mapping[Case, str]) -> DrivenGroup:
    """Drive and measure a group."""
    setup = _setup(config)
    outcomes = drive(setup, list(wanted))
    rows: list[dict[str, Any]] = [row.to_part(wanted[row.case]) for row in measure(setup, outcomes)]
    part = Part.of(rows, [outcome.log for outcome in outcomes if outcome.log is not None])
    return DrivenGroup(tuple(wanted), part, [log for one in outcomes for log in one.unfinished if config.rrd])


def seconds(cases: Sequence[Case]) -> float:
    """Simulated time of the cases together [s]."""
    return sum(reference(case.reference).duration for case in cases)


@functools.lru_cache(maxsize=1)
def _setup(config: BenchmarkConfig) -> Setup:
    return Setup.of(config)


def _work(cases: tuple[Case, ...]) -> float:
    return reference(cases[0].reference).duration * sum(_SLOW.get(case.controller, 1.0) for case in cases)
