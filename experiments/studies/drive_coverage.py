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
from experiments.studies.trials import Estimate, Outcome, Results, Trial, Values, run_trials
from sim.fleet import Fleet
from sim.robot.robot import Robot
from sim.run_recorder import Description
from sim.runs import Progress, drive_fleet, open_loop
from sim.seeds import generator
from sim.wander.commands import Driver, track_commands
from sim.wander.log import encoder_log, joined_log
from sim.wander.motion import LawMotion, Motion, SlipVariation, steps_between
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


@dataclass(frozen=True)
class DriveStudy:
    """The results of all cases."""

    repeats: int
    results: Mapping[str, Results]
    """By the case's name."""
    drives: int
    """Number of MuJoCo's own drives that determine the law without noise."""
    laws: Mapping[str, Values]
    """Of MuJoCo: `steady`, from steady circles with the track speeds of the drives, which errors are measured from;
    `paper`, from the paper's circles, most of which are slower and wider; `mean` and `scatter`, the standard deviation,
    of the drives without noise; `coverage_of_steady`, the share of measured drives whose intervals cover `steady`."""

    @property
    def checks(self) -> list[Check]:
        """The checks of all cases."""
        return [check for name, results in self.results.items() for check in checks_of(CASES[name], results)]

    @property
    def failures(self) -> list[str]:
        """Why fits failed, once each."""
        return sorted({line for results in self.results.values() for line in results.failures})

    def to_json(self) -> dict[str, Any]:
        """The content of summary.json."""
        statistics = {
            name: {key: results.errors(key).to_json() | results.coverage(key).to_json() for key in CASES[name].covered}
            for name, results in self.results.items()
        }
        return {
            "repeats": self.repeats,
            "results": statistics,
            "checks": [check.to_json() for check in self.checks],
            "simulated": {"drives": self.drives, **self.laws},
            "failures": self.failures,
        }


def drive_study(config: Config, world: World, run: Run) -> DriveStudy:
    """Repeat every case; raises LogError if no drive in MuJoCo determines the law."""
    robot, repeats = world.robot, config.drive_repeats
    do = partial(fitted_drive, geometry=robot.geometry)
    count = min(repeats, MAX_SIMULATED)
    with run.progress(f"{count} drives and circles", count * DURATION) as report:
        steady, paper = steady_laws(robot, config.threads)
        drives = simulated_drives(robot, count, config.seed, config.threads, lambda s: report(count * s))
    fits = run_trials(run, do, [Trial(NOISE_FREE.name, k, log) for k, log in enumerate(drives)], _KEY)[NOISE_FREE.name]
    exact = {k: {name: one.value for name, one in fit.estimates.items()} for k, fit in enumerate(fits) if fit.estimates}
    if not exact:
        raise LogError("no drive in MuJoCo determines the law, even without noise")
    driven = list(islice(cycle(exact), repeats))  # measured in turn
    trials = [
        Trial(name, number, drives[k] if name == SIMULATED.name else None)
        for name in CASES
        for number, k in enumerate(driven)
    ]
    outcomes = run_trials(run, do, trials, _KEY)
    results = {name: Results(found, [{**TRUE_LAW, **EXTRAS}] * repeats) for name, found in outcomes.items()}
    measured = results[SIMULATED.name] = Results(outcomes[SIMULATED.name], [exact[k] for k in driven], steady)
    values = {name: np.array([one[name] for one in exact.values()]) for name in steady}
    laws = {
        "steady": steady,
        "paper": paper,
        "mean": {name: float(found.mean()) for name, found in values.items()},
        "scatter": {name: float(found.std(ddof=1)) if len(found) > 1 else 0.0 for name, found in values.items()},
        "coverage_of_steady": {name: measured.coverage(name, steady).share for name in steady},
    }
    return DriveStudy(repeats, results, len(exact), laws)


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
        estimates = Estimate.of(fit_drives(LAW, [log], geometry))
    except TrackslipError as error:
        return Outcome(numbers=bound, notes=(str(error),))
    return Outcome(estimates if TRUE_LAW.keys() <= estimates.keys() else {}, bound)


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


def checks_of(case: Case, results: Results) -> list[Check]:
    """Fits, errors and intervals within the bounds of a case."""
    failed = float(sum(not one.estimates for one in results.outcomes))
    rows: list[tuple[str, float, float | tuple[float, float], str]] = [("fits without D or epsilon", failed, 0.0, "1")]
    limits = dict(case.rms)
    if case.over_bound is not None:
        limits |= {name: case.over_bound * rms([one.numbers[name] for one in results.outcomes]) for name in TRUE_LAW}
    rows += [(f"rms error of {name}", results.errors(name).rms, most, unit_of(name)) for name, most in limits.items()]
    for name in case.covered:
        rows.append((f"coverage of {name}", results.coverage(name).share, case.coverage, "1"))
        pairs = results.pairs(name)
        if case.over_model is not None:
            widths = [(one.high - one.low) / 2 / (_NORMAL * one.stderr) for one, _ in pairs]
            over = float(np.median(widths)) if widths else np.nan
            rows.append((f"half width of {name} over the model's", over, case.over_model, "1"))
        if case.standard_errors is not None:
            largest = max((abs(one.value - aim) / one.stderr for one, aim in pairs), default=np.nan)
            rows.append((f"largest error of {name} in standard errors", largest, case.standard_errors, "1"))
    return [Check(case.name, *row) for row in rows]


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
