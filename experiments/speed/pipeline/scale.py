"""How time and memory grow with the number of robots and the length of runs.

The runs are written to Parquet while they last. Each case has a process of its own, whose peak memory is read at its
end. The cases take turns, so that a machine whose clock changes is as fast for one as for another. The time doesn't
include what happens once however long the runs are: until the robots drive at their speeds.
"""

import math
from collections.abc import Callable, Collection, Sequence

import numpy as np

from experiments.measuring.check import Check
from experiments.parallel.turns import take_turns
from experiments.speed.scale_case import ScaleCase, drive_case

Case = tuple[int, float, int]
"""Number of robots, duration of their runs [s], and how many times they are driven: short runs more often."""

_TIMES = {1: 50, 16: 12, 256: 1, 4096: 1}  # how often robots are driven for a short time
_SHORT, _LONG = 30.0, 1800.0  # [s]
_LONG_ENOUGH = {256: 120.0}  # to show whether memory grows, where 30 min would take long [s]
_QUICK_CASES: tuple[Case, ...] = (  # of `bench --pipeline`; those of many robots are recorded in two whole parts
    *((1, 30.0, 60), (1, 600.0, 3)),
    *((16, 30.0, 4), (16, 120.0, 1)),
    (256, 12.7, 1),
    (4096, 3.1, 1),
)
_BUSY = 16  # robots from which all processors have work
_FULL = 256  # robots from which the time per robot no longer depends on their number
_MOST_DEVIATION = 10.0  # [%]
_MOST_MEMORY = 20.0  # by which a longer run may exceed a shorter one [MB]


def measure(seed: int, repeats: int, step: Callable[[str], None]) -> tuple[Check, ...]:
    """The checks of a few cases, in less than a minute; `step` is called with a label from time to time.

    How often a case is driven is fixed, whatever `repeats` is.
    """
    return checks_of(measure_cases(_QUICK_CASES, seed, lambda label, _: step(label)))


def cases_of(long: Collection[int]) -> list[Case]:
    """The cases of `bench --scale`, with long runs of 30 min for `long` numbers of robots."""
    cases: list[Case] = []
    for robots, times in _TIMES.items():
        cases.append((robots, _SHORT, times))
        if robots in long:
            cases.append((robots, _LONG, 1))
        elif robots in _LONG_ENOUGH:
            cases.append((robots, _LONG_ENOUGH[robots], 1))
    return cases


def measure_cases(cases: Sequence[Case], seed: int, step: Callable[[str, float], None]) -> list[ScaleCase]:
    """Each case in a new process, in turns, on all processors.

    After each turn `step` is called with a label and the share of a case that it has added.
    """
    labels = [f"{_named(robots)}, {duration:g} s" for robots, duration, _ in cases]
    return take_turns(drive_case, [(*case, seed) for case in cases], lambda k, share: step(labels[k], share))


def checks_of(cases: Sequence[ScaleCase]) -> tuple[Check, ...]:
    """What the cases say, beside their bounds.

    A period of a fleet costs something however few robots there are, so that times are compared between durations,
    and between numbers of robots from 256 on. From 16 on they are compared with a + b N per simulated second; a single
    robot keeps a single processor busy.
    """
    checks = []
    for robots in dict.fromkeys(one.robots for one in cases):
        shortest, *_, longest = sorted((one for one in cases if one.robots == robots), key=lambda one: one.duration) * 2
        case = _named(robots)
        if longest.duration > shortest.duration:
            span = f"{longest.duration:g} s over {shortest.duration:g} s"
            change = longest.per_robot_second / shortest.per_robot_second - 1
            checks.append(Check(case, f"time per second, {span}", 100 * change, _within(_MOST_DEVIATION), "%"))
            checks.append(Check(case, f"memory, {span}", longest.memory - shortest.memory, _MOST_MEMORY, "MB"))
        elif not math.isnan(longest.memory_halfway):
            more = longest.memory - longest.memory_halfway
            checks.append(Check(case, "memory, whole run over half", more, _MOST_MEMORY, "MB"))
    full = [one.per_robot_second for one in cases if one.robots >= _FULL]
    spread = 100 * (max(full) / min(full) - 1)
    checks.append(Check(f"{_FULL} robots and more", "spread of the time per robot", spread, _MOST_DEVIATION, "%"))
    deviation = 100 * _deviation([one for one in cases if one.robots >= _BUSY])
    checks.append(Check(f"{_BUSY} robots and more", "deviation from a + b N", deviation, _MOST_DEVIATION, "%"))
    return tuple(checks)


def _named(robots: int) -> str:
    return f"{robots} robots" if robots > 1 else "1 robot"


def _within(most: float) -> tuple[float, float]:
    return -most, most


def _deviation(cases: Sequence[ScaleCase]) -> float:
    """Largest relative deviation of the times per simulated second from a line over the number of robots [-]."""
    time = np.array([one.seconds / one.duration for one in cases])
    line = np.column_stack([np.ones(len(cases)), [one.robots for one in cases]]) / time[:, None]
    fitted = line @ np.linalg.lstsq(line, np.ones(len(cases)))[0]
    return float(np.abs(fitted - 1).max())
