"""All cases of the drive estimator, repeated in parallel; MuJoCo's own drives come first, as its case needs them."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.measuring.check import Check
from experiments.measuring.drive_cases import CASES, DURATION, ENCODER_RATE, LAW, SIMULATED, TRUE_LAW
from experiments.measuring.drive_coverage import (
    NOISE_FREE,
    Estimates,
    Repeat,
    Task,
    checks_of,
    estimated,
    measured,
    repeat,
)
from experiments.parallel.executors import Workers
from sim.fleet import Fleet
from sim.robot.robot import Robot
from sim.run_recorder import Description
from sim.runs import Progress, open_loop
from sim.seeds import generator
from sim.wander.commands import Driver, track_commands
from sim.wander.fleet_motion import drive_fleet
from trackslip.errors import LogError, TrackslipError
from trackslip.identification.fitted import fit_law
from trackslip.identification.true_samples import true_samples
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.paper import COMMANDED_RADII, SPEEDS

MAX_SIMULATED = 40
"""Drives in MuJoCo; each is measured again and again."""
_CIRCLES = 10.0  # duration of steady circles [s]
_OUTER, _INNER = (0.1, 0.2, 0.3), (0.1, 0.4, 0.7)  # speeds of the tracks [m/s], and relative to the outer one [-]
_PAPER = tuple((radius, speed) for radius in COMMANDED_RADII for speed in SPEEDS)  # [m], [m/s]


@dataclass(frozen=True)
class SimulatedDrives:
    """What MuJoCo's own drives tell of the law, without noise."""

    drives: int
    steady: Mapping[str, float]
    """The law's parameters from steady circles with the track speeds of the drives; errors are measured from them."""
    paper: Mapping[str, float]
    """Those from the paper's circles, most of which are slower and wider."""
    mean: Mapping[str, float]
    """Mean of the drives' parameters."""
    scatter: Mapping[str, float]
    """Their standard deviation between drives."""
    coverage_of_steady: Mapping[str, float]
    """Share of the measured drives whose 95 % intervals cover the steady law [-]."""


@dataclass(frozen=True)
class DriveStudy:
    """The checks of all cases."""

    repeats: int
    checks: list[Check]
    simulated: SimulatedDrives
    failures: list[str]
    """Why fits failed, once each."""

    def to_json(self) -> dict[str, Any]:
        """What summary.json contains."""
        return vars(self) | {"checks": [check.to_json() for check in self.checks]}


def simulated_drives(robot: Robot, count: int, seed: int, threads: int, progress: Progress) -> list[RunLog]:
    """Random drives in MuJoCo on hard ground, with true poses."""
    radius = robot.geometry.sprocket_radius
    driver = Driver(half_gauge=robot.geometry.half_gauge + TRUE_LAW["offset"])
    commands = [
        track_commands("random", DURATION, ENCODER_RATE, driver, generator(seed, f"simulated drive {k}")) / radius
        for k in range(count)
    ]
    fleet = Fleet(robot, np.zeros((count, 3)), threads=threads)
    about = [Description(f"drive {k}") for k in range(count)]
    return drive_fleet(fleet, np.stack(commands, axis=1), ENCODER_RATE, about, progress)


def steady_laws(robot: Robot, threads: int) -> tuple[dict[str, float], dict[str, float]]:
    """The law's parameters from true motion on steady circles: of the drives' track speeds, and the paper's.

    They differ because the ICRs of a simulated robot move outwards with the yaw rate, by 2.5 mm up to 1.4 rad/s.
    """
    same = [(inner * outer, outer) for outer in _OUTER for inner in _INNER]
    paper = [(v - robot.geometry.half_gauge * v / r, v + robot.geometry.half_gauge * v / r) for r, v in _PAPER]
    return _steady_law(robot, same, threads), _steady_law(robot, paper, threads)


def _steady_law(robot: Robot, speeds: Sequence[tuple[float, float]], threads: int) -> dict[str, float]:
    """The same from circles with these track speeds [m/s], and from the mirrored ones."""
    both = np.array([*speeds, *((right, left) for left, right in speeds)])
    fleet = Fleet(robot, np.zeros((len(both), 3)), threads=threads)
    logs = open_loop(fleet, both / robot.geometry.sprocket_radius, _CIRCLES)
    return dict(fit_law(LAW, true_samples(logs, robot.geometry), robot.geometry, bootstraps=0).values)


def study(
    drives: Sequence[RunLog],
    steady: tuple[Mapping[str, float], Mapping[str, float]],
    geometry: RobotGeometry,
    repeats: int,
    seed: int,
    pool: Workers,
    step: Callable[[float], None],
) -> DriveStudy:
    """Repeat every case; `drives` are those in MuJoCo, `steady` as by `steady_laws`.

    `step(1.0)` is called after each of `size` fits. Raises LogError if no drive in MuJoCo determines the law.
    """
    exact: dict[int, Estimates] = {}
    for number, estimates in pool.each(_exact, [(k, log, geometry) for k, log in enumerate(drives)]):
        if TRUE_LAW.keys() <= estimates.keys():
            exact[number] = estimates
        step(1.0)
    if not exact:
        raise LogError("no drive in MuJoCo determines the law, even without noise")
    tasks = [
        task for case in range(len(CASES)) for task in _tasks(case, drives, exact, steady[0], geometry, repeats, seed)
    ]
    found: dict[tuple[int, int], Repeat] = {}
    for one in pool.each(repeat, tasks):
        found[one.task.case, one.task.number] = one
        step(1.0)
    by_case = [[found[case, number] for number in range(repeats)] for case in range(len(CASES))]
    checks = [check for case, ones in zip(CASES, by_case, strict=True) for check in checks_of(case, ones)]
    failures = sorted({one.failure for ones in by_case for one in ones if one.failure is not None})
    return DriveStudy(repeats, checks, _simulated(exact, by_case[CASES.index(SIMULATED)], *steady), failures)


def size(drives: int, repeats: int) -> int:
    """Number of fits in a study with so many drives in MuJoCo."""
    return drives + repeats * len(CASES)


def _tasks(
    case: int,
    drives: Sequence[RunLog],
    exact: Mapping[int, Estimates],
    steady: Mapping[str, float],
    geometry: RobotGeometry,
    repeats: int,
    seed: int,
) -> list[Task]:
    """The repeats of a case; those in MuJoCo take the drives in turn."""
    if CASES[case] is not SIMULATED:
        return [Task(case, number, seed, geometry) for number in range(repeats)]
    truths = {k: {name: one.value for name, one in exact[k].items()} for k in sorted(exact)}
    turns = itertools.islice(itertools.cycle(truths), repeats)
    return [Task(case, number, seed, geometry, drives[k], truths[k], steady) for number, k in enumerate(turns)]


def _exact(job: tuple[int, RunLog, RobotGeometry]) -> tuple[int, Estimates]:
    """A drive's number, and what it tells without noise; nothing if it can't be fitted."""
    number, log, geometry = job
    try:
        return number, estimated(measured(log, NOISE_FREE, np.random.default_rng(number)), geometry)
    except TrackslipError:
        return number, {}


def _simulated(
    exact: Mapping[int, Estimates],
    repeats: Sequence[Repeat],
    steady: Mapping[str, float],
    paper: Mapping[str, float],
) -> SimulatedDrives:
    values = {name: np.array([one[name].value for one in exact.values()]) for name in steady}
    covered = {
        name: float(np.mean([name in one.estimates and _within(one, name, steady[name]) for one in repeats]))
        for name in steady
    }
    return SimulatedDrives(
        drives=len(exact),
        steady=steady,
        paper=paper,
        mean={name: float(found.mean()) for name, found in values.items()},
        scatter={name: float(found.std(ddof=1)) if len(found) > 1 else 0.0 for name, found in values.items()},
        coverage_of_steady=covered,
    )


def _within(one: Repeat, name: str, value: float) -> bool:
    return one.estimates[name].low <= value <= one.estimates[name].high
