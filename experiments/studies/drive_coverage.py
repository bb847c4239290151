"""How well laws are estimated from whole drives: errors and intervals over drives whose law is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle, islice
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from experiments.driving.world import World
from experiments.measuring.check import Check
from experiments.studies.drive_bound import drive_bound
from experiments.studies.drive_cases import (
    CASES,
    DURATION,
    ENCODER_RATE,
    EXTRAS,
    LAW,
    NOISE_FREE,
    SIMULATED,
    TRUE_LAW,
    Case,
)
from experiments.studies.trials import Coverage, Errors, Estimate, Outcome, Trial, run_trials
from sim.fleet import Fleet
from sim.robot.robot import Robot
from sim.run_recorder import Description
from sim.runs import Progress, open_loop
from sim.seeds import generator
from sim.wander.commands import Driver, track_commands
from sim.wander.fleet_motion import drive_fleet
from sim.wander.law_motion import LawMotion, SlipVariation
from sim.wander.log import encoder_log, joined_log
from sim.wander.motion import Motion, steps_between
from sim.wander.pose_source import PoseSource
from trackslip.errors import LogError, TrackslipError
from trackslip.identification.drive.estimate import fit_drives
from trackslip.identification.drive.model import EXTRAS as EXTRA_PARAMETERS
from trackslip.identification.fitted import fit_law
from trackslip.identification.true_samples import true_samples
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.paper import COMMANDED_RADII, SPEEDS
from trackslip.slip.families import FAMILIES

if TYPE_CHECKING:
    from experiments.commands.coverage import Config
    from experiments.run import Run

MAX_SIMULATED = 40
"""Drives in MuJoCo; each is measured again and again."""
_KEY = "drive coverage {case} {number}"
_NORMAL = float(scipy.special.ndtri(0.975))
_LEAST_WAY = 1e-6  # of a step, for a robot at rest [m]
_CIRCLES = 10.0  # duration of steady circles [s]
_OUTER, _INNER = (0.1, 0.2, 0.3), (0.1, 0.4, 0.7)  # speeds of the tracks [m/s], and relative to the outer one [-]

Values = Mapping[str, float]  # by parameter


@dataclass(frozen=True)
class SimulatedDrives:
    """The law of MuJoCo's own drives, without noise."""

    drives: int
    steady: Values
    """The law's parameters from steady circles with the track speeds of the drives; errors are measured from them."""
    paper: Values
    """Those from the paper's circles, most of which are slower and wider."""
    mean: Values
    """Mean of the drives' parameters."""
    scatter: Values
    """Their standard deviation between drives."""
    coverage_of_steady: Values
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
        """The content of summary.json."""
        return vars(self) | {"checks": [check.to_json() for check in self.checks]}


def drive_study(config: Config, world: World, run: Run) -> DriveStudy:
    """Repeat every case; raises LogError if no drive in MuJoCo determines the law."""
    robot, repeats = world.robot, config.drive_repeats
    do = partial(fitted_drive, geometry=robot.geometry)
    count = min(repeats, MAX_SIMULATED)
    with run.progress(f"{count} drives and circles", count * DURATION) as report:
        steady, paper = steady_laws(robot, config.threads)
        drives = simulated_drives(robot, count, config.seed, config.threads, lambda s: report(count * s))
    fits = run_trials(run, do, [Trial(NOISE_FREE.name, k, log) for k, log in enumerate(drives)], _KEY)[NOISE_FREE.name]
    exact = {k: fit.estimates for k, fit in enumerate(fits) if _determined(fit)}
    if not exact:
        raise LogError("no drive in MuJoCo determines the law, even without noise")
    driven = list(islice(cycle(exact), repeats))  # measured in turn
    trials = [
        Trial(name, number, drives[driven[number]] if name == SIMULATED.name else None)
        for name in CASES
        for number in range(repeats)
    ]
    outcomes = run_trials(run, do, trials, _KEY)
    truths = [{name: one.value for name, one in exact[k].items()} for k in driven]
    checks = []
    for name, case in CASES.items():
        if case is SIMULATED:
            checks += checks_of(case, outcomes[name], truths, steady)
        else:
            checks += checks_of(case, outcomes[name], [{**TRUE_LAW, **EXTRAS}] * repeats)
    values = {name: np.array([one[name].value for one in exact.values()]) for name in steady}
    simulated = SimulatedDrives(
        len(exact),
        steady,
        paper,
        {name: float(found.mean()) for name, found in values.items()},
        {name: float(found.std(ddof=1)) if len(found) > 1 else 0.0 for name, found in values.items()},
        {name: coverage_of(name, outcomes[SIMULATED.name], [steady] * repeats).share for name in steady},
    )
    failures = sorted({note for ones in outcomes.values() for one in ones for note in one.notes})
    return DriveStudy(repeats, checks, simulated, failures)


def fitted_drive(trial: Trial, rng: np.random.Generator, geometry: RobotGeometry) -> Outcome:
    """Drive by the law unless the trial has a drive in MuJoCo, measure and fit; `numbers` are the case's bounds."""
    case = NOISE_FREE if trial.case == NOISE_FREE.name else CASES[trial.case]
    bound: Values = {}
    if case.slip is None:
        motion = Motion(trial.given.time, trial.given.pose)
        log = joined_log(trial.given, *case.source.measure(motion, rng))
    else:
        log, bound = _driven_by_law(case, case.slip, geometry, rng)
    try:
        found = fit_drives(LAW, [log], geometry)
    except TrackslipError as error:
        return Outcome(numbers=bound, notes=(str(error),))
    values = found.values | found.extras
    return Outcome(
        {name: Estimate(values[name], error, *found.interval95[name]) for name, error in found.stderr.items()}, bound
    )


def _driven_by_law(
    case: Case, slip: SlipVariation, geometry: RobotGeometry, rng: np.random.Generator
) -> tuple[RunLog, dict[str, float]]:
    """The log of a drive, and the Cramér-Rao bounds if the case asks for them."""
    omega = _commands(geometry, rng)
    motion, twist = _law_motion(np.array([*TRUE_LAW.values()]), geometry, slip).drive(omega, ENCODER_RATE, rng)
    stamps, poses = case.source.measure(motion, rng)
    log = joined_log(encoder_log("drive", ENCODER_RATE, omega, motion, twist, {}), stamps, poses)
    return log, {} if case.over_bound is None else _bound(omega, stamps, case.source, slip, geometry)


def _commands(geometry: RobotGeometry, rng: np.random.Generator) -> Array:
    """Sprocket speeds (T, 2) of a random drive [rad/s]."""
    driver = Driver(half_gauge=geometry.half_gauge + TRUE_LAW["offset"])
    return track_commands("random", DURATION, ENCODER_RATE, driver, rng) / geometry.sprocket_radius


def _law_motion(values: Array, geometry: RobotGeometry, slip: SlipVariation) -> LawMotion:
    return LawMotion(FAMILIES[LAW].law(values, geometry), geometry, slip)


def _bound(
    omega: Array, stamps: Array, source: PoseSource, slip: SlipVariation, geometry: RobotGeometry
) -> dict[str, float]:
    """The Cramér-Rao bounds of the law's parameters, for poses stamped by the encoders' clock and white slip."""

    def steps(values: Array) -> Array:
        silent = _law_motion(values, geometry, SlipVariation())
        return steps_between(silent.drive(omega, ENCODER_RATE, np.random.default_rng(0))[0].at(stamps))

    speed = geometry.sprocket_radius * np.abs(omega[1:]).mean(axis=1)
    way = np.concatenate([[0.0], np.cumsum(speed / ENCODER_RATE)])
    between = np.diff(np.interp(stamps, np.arange(len(way)) / ENCODER_RATE, way))
    white = np.array([slip.along, slip.across, slip.turning])
    noise = np.array([source.position_noise, source.position_noise, source.heading_noise])
    truth = np.array([*TRUE_LAW.values()])
    found = drive_bound(steps, truth, np.sqrt(np.maximum(between, _LEAST_WAY))[:, None] * white, noise)
    return dict(zip(TRUE_LAW, found.tolist(), strict=True))


def checks_of(
    case: Case, outcomes: Sequence[Outcome], truths: Sequence[Values], aim: Values | None = None
) -> list[Check]:
    """Checks of a case: intervals must cover the truth of each trial, and errors are measured from `aim`, if given."""
    good = [(one, aim or truth) for one, truth in zip(outcomes, truths, strict=True) if _determined(one)]
    checks = [Check(case.name, "fits without D or epsilon", float(len(outcomes) - len(good)), 0.0, "1")]
    limits = dict(case.rms)
    if case.over_bound is not None:
        limits |= {name: case.over_bound * rms([one.numbers[name] for one in outcomes]) for name in TRUE_LAW}
    for name, limit in limits.items():
        error = Errors(np.array([one.estimates[name].value - true[name] for one, true in good])).rms
        checks.append(Check(case.name, f"rms error of {name}", error, limit, unit_of(name)))
    for name in case.covered:
        share = coverage_of(name, outcomes, truths).share
        checks.append(Check(case.name, f"coverage of {name}", share, case.coverage, "1"))
        found = [(one.estimates[name], true[name]) for one, true in good if name in one.estimates]
        if case.over_model is not None:
            widths = [(one.high - one.low) / 2 / (_NORMAL * one.stderr) for one, _ in found]
            over = float(np.median(widths)) if widths else np.nan
            checks.append(Check(case.name, f"half width of {name} over the model's", over, case.over_model, "1"))
        if case.standard_errors is not None:
            largest = max((abs(one.value - true) / one.stderr for one, true in found), default=np.nan)
            what = f"largest error of {name} in standard errors"
            checks.append(Check(case.name, what, largest, case.standard_errors, "1"))
    return checks


def coverage_of(name: str, outcomes: Sequence[Outcome], truths: Sequence[Values]) -> Coverage:
    """How often the intervals of a parameter contain the truth; one that was not estimated doesn't."""
    pairs = zip(outcomes, truths, strict=True)
    covered = sum(name in one.estimates and one.estimates[name].covers(truth[name]) for one, truth in pairs)
    return Coverage(covered, len(outcomes))


def _determined(outcome: Outcome) -> bool:
    """Whether a drive determined the law."""
    return TRUE_LAW.keys() <= outcome.estimates.keys()


def unit_of(name: str) -> str:
    """Unit of a parameter of the law or of the drive, 1 for a pure number."""
    parameters = FAMILIES[LAW].parameters
    return (parameters[name].unit if name in parameters else EXTRA_PARAMETERS[name].unit) or "1"


def simulated_drives(robot: Robot, count: int, seed: int, threads: int, progress: Progress) -> list[RunLog]:
    """Random drives in MuJoCo on hard ground, with true poses."""
    commands = [_commands(robot.geometry, generator(seed, f"simulated drive {k}")) for k in range(count)]
    fleet = Fleet(robot, np.zeros((count, 3)), threads=threads)
    about = [Description(f"drive {k}") for k in range(count)]
    return drive_fleet(fleet, np.stack(commands, axis=1), ENCODER_RATE, about, progress)


def steady_laws(robot: Robot, threads: int) -> tuple[Values, Values]:
    """The law's parameters from true motion on steady circles: of the drives' track speeds, and the paper's.

    They differ because the ICRs of a simulated robot move outwards with the yaw rate, by 2.5 mm up to 1.4 rad/s.
    """
    b = robot.geometry.half_gauge
    same = [(inner * outer, outer) for outer in _OUTER for inner in _INNER]
    paper = [(v - b * v / radius, v + b * v / radius) for radius in COMMANDED_RADII for v in SPEEDS]
    return _steady_law(robot, same, threads), _steady_law(robot, paper, threads)


def _steady_law(robot: Robot, speeds: Sequence[tuple[float, float]], threads: int) -> Values:
    """The law's parameters from circles with these track speeds [m/s], and from the mirrored ones."""
    both = np.array([*speeds, *((right, left) for left, right in speeds)])
    fleet = Fleet(robot, np.zeros((len(both), 3)), threads=threads)
    logs = open_loop(fleet, both / robot.geometry.sprocket_radius, _CIRCLES)
    return dict(fit_law(LAW, true_samples(logs, robot.geometry), robot.geometry, bootstraps=0).values)
