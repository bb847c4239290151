"""Groups of runs that share a reference, each driven as one fleet, by one process or several at once."""

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from experiments.benchmark.measure import measure
from experiments.benchmark.setup import Setup
from experiments.driving.lookup import policy_path, reference, user_modules
from experiments.options.benchmark import BenchmarkConfig, Case
from experiments.parallel.executors import workers
from experiments.parallel.workers import processors
from experiments.storage.manifest import content, digest
from experiments.storage.results import SUMMARY_FILE
from experiments.sweep.engine import DrivenFleet, drive_isolating
from experiments.sweep.parts import Part
from trackslip.controllers.named import CONTROLLERS
from trackslip.errors import RunFailedError
from trackslip.logs.runlog import RunLog
from trackslip.slip.stored_laws import SHIPPED

GROUP_SIZE = 32
"""Robots in a fleet: larger fleets hardly gain speed, and smaller ones are shared better between processes."""
MAX_GROUP = 3 * GROUP_SIZE
"""Robots of one controller on one reference that are still driven as one fleet."""
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
        | ({"pull": world.pull} if world.pull.force > 0 else {})
    )
    contents = functools.cache(lambda name: content(Path(name)))
    modules = set(user_modules())

    def files(case: Case) -> dict[str, str]:
        names = {case.reference, case.ground, str(policy_path(case.controller) or "")}
        names |= set() if case.controller in CONTROLLERS else modules
        return {name: digest for name in sorted(names) if (digest := contents(name)) is not None}

    return {case: digest([common, vars(case), files(case)]) for case in cases}


def groups(cases: Iterable[Case]) -> list[tuple[Case, ...]]:
    """Cases by reference, in order: whole controllers, up to about GROUP_SIZE robots per group."""
    paths: dict[str, dict[str, list[Case]]] = {}
    for case in cases:
        paths.setdefault(case.reference, {}).setdefault(case.controller, []).append(case)
    found = []
    for controllers in paths.values():
        group: tuple[Case, ...] = ()
        for same in controllers.values():
            if group and len(group) + len(same) > GROUP_SIZE:
                found.append(group)
                group = ()
            group += tuple(same)
            while len(group) > MAX_GROUP:
                found.append(group[:GROUP_SIZE])
                group = group[GROUP_SIZE:]
        found.append(group)
    return found


def drive_groups(config: BenchmarkConfig, missing: Mapping[Case, str]) -> Iterator[DrivenFleet]:
    """Drive the cases, by their ids, in `config.jobs` processes, the longest groups first; each group when ready."""

    def work(group: Sequence[Case]) -> float:
        return seconds(group[:1]) * sum(_SLOW.get(case.controller, 1.0) for case in group)

    order = sorted(groups(missing), key=work, reverse=True)
    jobs = min(config.jobs or processors(), len(order))
    with workers("processes", jobs) as pool:
        tasks = [{case: missing[case] for case in group} for group in order]
        yield from pool.each(functools.partial(drive_group, config), tasks)


def drive_group(config: BenchmarkConfig, wanted: Mapping[Case, str]) -> DrivenFleet:
    """Drive and measure a group."""
    setup, cases = _setup(config), tuple(wanted)
    outcomes = drive_isolating(cases, setup.drive)
    rows = [row.to_part(wanted[row.case]) for row in measure(setup, cases, outcomes)]
    part = Part.of(rows, [one for one in outcomes if isinstance(one, RunLog)])
    unfinished = [log for one in outcomes if config.rrd and isinstance(one, RunFailedError) for log in one.logs]
    return DrivenFleet(part, unfinished, seconds(cases), {})


def seconds(cases: Iterable[Case]) -> float:
    """Simulated time of the cases together [s]."""
    return sum(reference(case.reference).duration for case in cases)


@functools.lru_cache(maxsize=1)
def _setup(config: BenchmarkConfig) -> Setup:
    return Setup.of(config)
